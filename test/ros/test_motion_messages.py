"""A JointTrajectory is the same trajectory in memory, or one sentence."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

trajectory_msgs = pytest.importorskip(
    "trajectory_msgs.msg", reason="trajectory_msgs is not there"
)

from genpy import Duration  # noqa: E402

from g1_description.errors import G1DescriptionError, MotionError, UnknownNameError  # noqa: E402
from g1_description.ros.motion_messages import trajectory_from_message  # noqa: E402

JOINTS = ("knee", "elbow", "wrist")
NUMBERS = st.floats(-10.0, 10.0)
ROWS = st.lists(st.tuples(NUMBERS, NUMBERS), min_size=1, max_size=5)


def message_of(rows, velocities=None, names=("wrist", "knee")):
    """Make a message with a point each half a second, the first one at zero."""
    velocities = velocities or [()] * len(rows)
    return trajectory_msgs.JointTrajectory(
        joint_names=[*names],
        points=[
            trajectory_msgs.JointTrajectoryPoint(
                positions=[*row],
                velocities=[*velocity],
                time_from_start=Duration(number // 2, number % 2 * 500_000_000),
            )
            for number, (row, velocity) in enumerate(zip(rows, velocities))
        ],
    )


@given(ROWS)
def test_numbers_stay_to_the_last_bit(rows):
    found = trajectory_from_message(message_of(rows, rows), JOINTS)
    assert found.joint_names == ("wrist", "knee")
    assert found.positions.tolist() == [[*row] for row in rows]
    assert found.velocities.tolist() == [[*row] for row in rows]
    assert found.times.tolist() == [number / 2 for number in range(len(rows))]


def test_nanoseconds_count():
    message = message_of([(0.0, 0.0)])
    message.points[0].time_from_start = Duration(3, 1)
    assert trajectory_from_message(message, JOINTS).times.tolist() == [3.000000001]


def test_without_velocities_there_are_none():
    assert trajectory_from_message(message_of([(0.0, 1.0)]), JOINTS).velocities is None


TWO = [(0.0, 1.0), (2.0, 3.0)]


@pytest.mark.parametrize(
    ("message", "kind", "words"),
    [
        (message_of(TWO, names=("knee", "nose")), UnknownNameError, "nose"),
        (message_of(TWO, names=()), UnknownNameError, "has no joint names"),
        (message_of([]), MotionError, "no points"),
        (
            message_of(TWO, names=("knee", "knee")),
            MotionError,
            "duplicate joints: knee",
        ),
        (
            message_of([TWO[0], (1.0,)]),
            MotionError,
            "Point 2 must have 2 positions .got 1",
        ),
        (
            message_of(TWO, [(1.0,), (1.0,)]),
            MotionError,
            "Point 1 must have 2 velocities .got 1",
        ),
        (message_of(TWO, [(1.0, 1.0), ()]), MotionError, "Point 2 has no velocities"),
        (message_of([(0.0, np.nan)]), MotionError, "position of .*nan"),
        (message_of([(0.0, np.inf)]), MotionError, "position of .*inf"),
        (message_of(TWO, [(0.0, np.nan)] * 2), MotionError, "velocity of .*nan"),
    ],
)
def test_what_no_joint_can_do_is_told_in_a_sentence(message, kind, words):
    with pytest.raises(kind, match=words) as told:
        trajectory_from_message(message, JOINTS)
    assert str(told.value).endswith(".")
    assert len(str(told.value).splitlines()) == 1


@pytest.mark.parametrize("seconds", [0, 1, -1])
def test_times_that_do_not_rise_are_told(seconds):
    message = message_of(TWO)
    message.points[0].time_from_start = Duration(1)
    message.points[1].time_from_start = Duration(seconds)
    with pytest.raises(G1DescriptionError, match="must increase"):
        trajectory_from_message(message, JOINTS)
