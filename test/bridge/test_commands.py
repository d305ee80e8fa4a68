"""Of a command, what can be obeyed is; the rest is named, and counted by joint."""

import math
from unittest import mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("rospy", reason="rospy is not installed")

from sensor_msgs.msg import JointState

from g1_description.bridge.commands import CommandTally, JointCommands
from g1_description.robot.description import Joint

INF = math.inf
POSE = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
JOINTS = [
    Joint(name, kind, "thigh", "shank", POSE, lower=lower, upper=upper)
    for name, kind, lower, upper in (
        ("knee", "revolute", -0.1, 2.9),
        ("wheel", "continuous", -INF, INF),
        ("slide", "prismatic", 0.0, 0.5),
    )
]


def tally(*commands):
    made = CommandTally(JOINTS)
    for time, (names, positions) in enumerate(commands):
        made.take(names, positions, float(time))
    return made


@pytest.mark.parametrize(
    ("names", "positions", "accepted", "problem"),
    [
        (["knee"], [0.5], {"knee": 0.5}, None),
        (["knee", "knee"], [0.5, 0.7], {"knee": 0.7}, "knee more than once"),
        (["knee"], [4.0], {"knee": 4.0}, None),
        (["knee", "tail"], [0.5, 1.0], {"knee": 0.5}, "unknown joint tail"),
        (["knee", "wheel"], [0.5], {"knee": 0.5}, "no position for wheel"),
        (["knee"], [0.5, 0.6], {"knee": 0.5}, "2 positions for 1 name"),
        (["knee", "wheel"], [math.nan, 1.0], {"wheel": 1.0}, "knee = nan"),
        (["knee", "wheel"], [0.1, -INF], {"knee": 0.1}, "wheel = -inf"),
        ([], [], {}, "it has no joint names"),
        ([], [0.5, 0.6], {}, "it has no joint names"),
        ([""], [1.0], {}, "unknown joint ''"),
        (["kne"], [1.0], {}, "unknown joint kne (did you mean knee?)"),
    ],
)
def test_each_fault_is_named_and_the_rest_obeyed(names, positions, accepted, problem):
    made = CommandTally(JOINTS)
    found, ignored, _ = made.take(names, positions, 7.0)
    assert found == accepted
    assert ignored == "" if problem is None else problem in ignored
    assert "0 names" not in ignored
    assert made.last_ignored == ((7.0, ignored) if ignored else None)


@pytest.mark.parametrize(
    ("names", "told"),
    [
        (["knee", "tail"], "Part of a joint command to post is ignored: unknown joint"),
        (["wing", "tail"], "A joint command to post is ignored: unknown joint"),
    ],
)
def test_a_command_is_ignored_in_part_or_as_a_whole(monkeypatch, names, told):
    log = mock.Mock()
    commands, kept = JointCommands("/gazebo", "post", CommandTally(JOINTS), log), []
    monkeypatch.setattr(commands, "put", lambda positions: None)
    commands._note = lambda positions: None
    commands._record = lambda message, accepted, ignored: kept.append(ignored)
    commands._on_command(JointState(name=names, position=[0.5, 0.5]))
    assert len(kept) == 1 and "unknown joint" in kept[0]
    assert log.warn.call_args[0][1].startswith(told)


@pytest.mark.parametrize(
    ("names", "positions", "told"),
    [
        (["knee", "wheel"], [2.9, 100.0], ""),
        (
            ["knee", "slide"],
            [3.0, -1.0],
            "clamped to the limits: knee from 3 to 2.9, slide from -1 to 0",
        ),
        (
            ["slide", "knee"],
            [90.0, 90.0],
            "clamped to the limits: slide from 90 to 0.5, knee from 90 to 2.9 "
            "(90 looks like degrees, positions are in radians)",
        ),
    ],
)
def test_what_is_clamped_is_told_with_its_limit(names, positions, told):
    assert CommandTally(JOINTS).take(names, positions, 0.0)[2] == told


def test_a_thousand_faults_make_one_short_sentence():
    names = [f"joint_{number}" for number in range(1000)]
    _, ignored, _ = CommandTally(JOINTS).take(names, [0.0] * 1000, 0.0)
    assert "and 992 more" in ignored
    assert len(ignored) < 200


@pytest.mark.parametrize(
    ("names", "positions", "clamped", "ignored"),
    [
        (["knee"], [2.9], {}, {}),
        (["knee"], [2.91], {"knee": 1}, {}),
        (["knee", "wheel"], [-0.2, 1e9], {"knee": 1}, {}),
        (["wing", "knee"], [0.0, 4.0], {"knee": 1}, {"wing": 1}),
        (["knee", "wheel"], [math.nan, INF], {}, {"knee": 1, "wheel": 1}),
        (["knee", "wheel"], [0.0], {}, {"wheel": 1}),
        (["knee"], [0.0, 1.0, 2.0], {}, {"": 2}),
        ([], [], {}, {}),
    ],
)
def test_each_position_counts_for_its_name(names, positions, clamped, ignored):
    once, twice = (
        tally((names, positions)),
        tally((names, positions), (names, positions)),
    )
    for made, times in ((once, 1), (twice, 2)):
        assert made.clamped == {name: times * n for name, n in clamped.items()}
        assert made.ignored == {name: times * n for name, n in ignored.items()}
        assert made.is_empty is not bool(clamped or ignored)


@given(
    st.lists(st.sampled_from(["knee", "wheel", "wing"]), max_size=4),
    st.lists(st.sampled_from([0.0, 3.0, math.nan]), max_size=4),
)
def test_what_is_told_is_counted(names, positions):
    """But for a message without names, in which nothing is ignored."""
    made = CommandTally(JOINTS)
    _, ignored, clamped = made.take(names, positions, 0.0)
    assert bool(made.ignored) == bool(ignored and (names or positions))
    assert bool(made.clamped) == bool(clamped)


def test_what_was_clamped_lately_is_named():
    made = tally((["knee"], [4.0]), (["knee"], [0.0]), (["wheel"], [0.0]))
    assert made.clamped_since(-0.5) == ["knee"]
    assert made.clamped_since(0.0) == []
