"""A JointTrajectory is the same trajectory in memory, or one sentence."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

trajectory_msgs = pytest.importorskip(
    "trajectory_msgs.msg", reason="trajectory_msgs is not there"
)

from genpy import Duration, Time  # noqa: E402

from g1_description import Robot  # noqa: E402
from g1_description.errors import (  # noqa: E402
    G1DescriptionError,
    InvalidValueError,
    MotionError,
    UnknownNameError,
)
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
            message_of([TWO[0], (1.0,)]),
            MotionError,
            "Point 2 must have 2 positions .got 1",
        ),
        (message_of(TWO, [(1.0, 1.0), ()]), MotionError, "Point 2 has no velocities"),
        (message_of([(0.0, np.nan)]), MotionError, "position of .*nan"),
    ],
)
def test_what_no_joint_can_do_is_told_in_a_sentence(message, kind, words):
    with pytest.raises(kind, match=words) as told:
        trajectory_from_message(message, JOINTS)
    assert str(told.value).endswith(".")
    assert len(str(told.value).splitlines()) == 1


def test_times_that_do_not_rise_are_told():
    message = message_of(TWO)
    message.points[0].time_from_start = Duration(1)
    message.points[1].time_from_start = Duration(0)
    with pytest.raises(G1DescriptionError, match="must increase"):
        trajectory_from_message(message, JOINTS)


ROBOT = Robot()
BASE = [0.1, -0.2, 0.8, 0.0, 0.0, 0.6, 0.8]


def test_a_motion_survives_its_message():
    squat = ROBOT.read_motion("squat.csv")
    message = ROBOT.trajectory_message(squat, Time(5, 7))
    found = ROBOT.from_message(message)
    for name in ("times", "positions", "base"):
        np.testing.assert_array_equal(getattr(found, name), getattr(squat, name))
    assert found.joint_names == squat.joint_names
    parts = message.joint_trajectory, message.multi_dof_joint_trajectory
    assert [part.header.stamp for part in parts] == [Time(5, 7)] * 2
    arms = ROBOT.from_message(message.joint_trajectory)
    np.testing.assert_array_equal(arms.positions, squat.positions)
    assert arms.base is None


def test_a_configuration_names_only_what_is_given():
    found = ROBOT.from_message(ROBOT.to_message({"left_elbow_joint": 0.5}, BASE))
    assert (found.joint_names, found.times.tolist()) == (("left_elbow_joint",), [0.0])
    assert (found.positions.tolist(), found.base.tolist()) == ([[0.5]], [BASE])
    assert ROBOT.from_message(ROBOT.to_message(ROBOT.neutral)).base is None
    assert ROBOT.from_message(ROBOT.to_message(None, BASE)).joint_names == ()


def test_a_base_elsewhere_than_in_the_map_is_told():
    message = ROBOT.to_message(None, BASE)
    message.multi_dof_joint_trajectory.header.frame_id = "odom"
    with pytest.raises(MotionError, match="must be in the frame map"):
        ROBOT.from_message(message)


def test_a_point_without_a_pose_of_the_base_is_named():
    message = ROBOT.trajectory_message(ROBOT.read_motion("squat.csv"))
    message.multi_dof_joint_trajectory.points[4].transforms = []
    with pytest.raises(MotionError, match="Point 5 of the base must have 1 transform"):
        ROBOT.from_message(message)


@pytest.mark.parametrize(
    ("positions", "base", "kind", "words"),
    [
        ({"left_elbow": 1.0}, None, UnknownNameError, "left_elbow_joint"),
        (np.zeros((2, 29)), None, InvalidValueError, "single configuration"),
        (None, [BASE, BASE], InvalidValueError, "single pose"),
        (None, [0, 0, 1, 0, 0, 0, 2], InvalidValueError, "length 1"),
    ],
)
def test_a_wrong_configuration_makes_no_message(positions, base, kind, words):
    with pytest.raises(kind, match=words):
        ROBOT.to_message(positions, base)
