"""What is clamped and what is ignored of commands is counted by joint."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from g1_description.bridge.sender import split_command
from g1_description.bridge.status import MAX_NAME_LENGTH, MAX_NAMES, CommandTally

LIMITS = {"knee": (-0.1, 2.9), "wheel": (-math.inf, math.inf)}


def tally(*commands):
    made = CommandTally(LIMITS)
    for time, (names, positions) in enumerate(commands):
        made.count(names, positions, float(time))
    return made


@pytest.mark.parametrize(
    ("names", "positions", "clamped", "ignored"),
    [
        (["knee"], [2.9], {}, {}),
        (["knee"], [2.91], {"knee": 1}, {}),
        (["knee", "wheel"], [-0.2, 1e9], {"knee": 1}, {}),
        (["wing", "knee"], [0.0, 4.0], {"knee": 1}, {"wing": 1}),
        (["knee", "wheel"], [math.nan, math.inf], {}, {"knee": 1, "wheel": 1}),
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
def test_a_command_that_is_obeyed_in_full_counts_nothing(names, positions):
    """What split_command complains of is counted, but for a message without names."""
    problems = [c for c in split_command(names, positions, LIMITS)[1] if names]
    ignored = sum(tally((names, positions)).ignored.values())
    assert bool(ignored) == bool(problems or len(positions) > len(names))


def test_what_was_clamped_lately_is_named():
    made = tally((["knee"], [4.0]), (["knee"], [0.0]), (["wheel"], [0.0]))
    assert made.clamped_since(-0.5) == ["knee"]
    assert made.clamped_since(0.0) == []


def test_a_million_names_take_the_room_of_a_few():
    made = CommandTally(LIMITS)
    names = [f"{'x' * 100}{n}" for n in range(10)] + [f"n{n}" for n in range(100_000)]
    made.count(names, [0.0] * len(names), 0.0)
    made.count(["n3", "n99999"], [0.0, 0.0], 1.0)
    assert len(made.ignored) == MAX_NAMES
    assert max(map(len, made.ignored)) == MAX_NAME_LENGTH
    assert made.ignored["x" * MAX_NAME_LENGTH] == 10
    assert made.ignored["n3"] == 2
    assert sum(made.ignored.values()) + made.other_ignored == len(names) + 2
