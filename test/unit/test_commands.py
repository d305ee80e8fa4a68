"""Of a command, what can be obeyed is, and the rest is named."""

import math

import pytest

from g1_description.bridge.sender import split_command

JOINTS = ("elbow", "knee")


@pytest.mark.parametrize(
    ("names", "positions", "accepted", "problem"),
    [
        (["elbow"], [0.5], {"elbow": 0.5}, None),
        (["elbow", "elbow"], [0.5, 0.7], {"elbow": 0.7}, None),
        (["elbow", "tail"], [0.5, 1.0], {"elbow": 0.5}, "is called tail"),
        (["elbow", "knee"], [0.5], {"elbow": 0.5}, "no position for knee"),
        (["elbow"], [0.5, 0.6], {"elbow": 0.5}, "2 positions for 1 names"),
        (["elbow", "knee"], [math.nan, 1.0], {"knee": 1.0}, "elbow = nan"),
        (["elbow", "knee"], [0.1, -math.inf], {"elbow": 0.1}, "knee = -inf"),
        ([], [], {}, "names no joint"),
        ([""], [1.0], {}, "is called ''"),
    ],
)
def test_each_fault_is_named_and_the_rest_obeyed(names, positions, accepted, problem):
    assert split_command(names, positions, JOINTS)[0] == accepted
    problems = "; ".join(split_command(names, positions, JOINTS)[1])
    assert problems == "" if problem is None else problem in problems


def test_a_thousand_faults_make_one_short_sentence():
    names = [f"joint_{number}" for number in range(1000)]
    (problem,) = split_command(names, [0.0] * 1000, JOINTS)[1]
    assert "and 992 more" in problem
    assert len(problem) < 200
