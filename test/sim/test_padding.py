"""Motions come from a pose and end in one, on the floor and within limits."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from g1_description import Robot
from g1_description.errors import InvalidValueError, MotionError
from g1_description.motion.edit import joint_speeds
from g1_description.sim.padding import padded
from g1_description.sim.standing import lowest_height, lowest_heights, on_floor


@pytest.fixture(scope="module")
def robot():
    return Robot()


def walk(robot, velocities=False):
    """Make a motion that begins bent, turned, and in the air."""
    bend = np.linspace(
        robot.named_configuration("squat"), robot.named_configuration("wave"), 31
    )
    turn = Rotation.from_euler("xyz", [[0.1, 0.2, 1.0]] * 31).as_quat()
    base = np.hstack([np.tile([1.0, 2.0, 0.9], (31, 1)), turn])
    rates = np.ones_like(bend) if velocities else None
    return robot.trajectory(1.0 + np.arange(31) / 30, bend, rates, base)


def of(robot, name):
    return dict(zip(robot.joint_names, robot.named_configuration(name)))


@pytest.mark.parametrize("velocities", [False, True])
def test_the_robot_comes_from_a_pose_and_goes_to_one(robot, velocities):
    motion = walk(robot, velocities)
    stand = of(robot, "stand")
    found = padded(robot.description, motion, stand, stand)
    np.testing.assert_allclose(np.diff(found.times), 1 / 30.0)
    assert found.times[0] == 0.0
    np.testing.assert_array_equal(found.positions[30:61], motion.positions)
    np.testing.assert_array_equal(found.base_poses[30:61], motion.base_poses)
    for row in (0, -1):
        np.testing.assert_allclose(
            found.positions[row], robot.named_configuration("stand")
        )
        upright = Rotation.from_quat(found.base_poses[row, 3:]).apply([0, 0, 1])
        np.testing.assert_allclose(upright, [0, 0, 1], atol=1e-12)
    links = robot.link_poses(found.positions, found.base_poses)
    for way in (slice(0, 31), slice(60, None)):  # on the right foot
        places = links["right_ankle_roll_link"][way, :2]
        np.testing.assert_allclose(places - places[0], 0.0, atol=1e-9)
    heights = lowest_heights(robot.description, found)
    np.testing.assert_allclose(heights[[0, -1]], 0.0, atol=1e-9)
    assert (np.diff(heights[:31]) >= -1e-9).all()  # never below, steadily up
    steps = np.abs(np.diff(found.positions, axis=0)).max(axis=1)
    assert steps[[0, -1]].max() < 1e-3  # from rest
    if velocities:
        slopes = np.gradient(found.positions, found.times, axis=0)
        for ways in (slice(1, 28), slice(63, -1)):
            np.testing.assert_allclose(
                found.velocities[ways], slopes[ways], atol=0.05, rtol=0.05
            )


def test_a_way_takes_longer_where_a_joint_would_be_too_fast(robot):
    motion = walk(robot)
    found = padded(robot.description, motion, of(robot, "stand"), seconds=0.001)
    limits = robot.velocity_limits
    shares = joint_speeds(replace(motion, velocities=None)) / limits
    way = replace(
        found, times=found.times[:-30], positions=found.positions[:-30], base_poses=None
    )
    top = (joint_speeds(way) / limits).max()
    assert shares.max() < 0.5 < top <= 1.0


def test_only_what_is_asked_for_is_added(robot):
    motion = replace(walk(robot), base_poses=None)
    found = padded(robot.description, motion, end={}, seconds=0.5)
    assert len(found.times) == 31 + 15
    np.testing.assert_array_equal(found.positions[-1], 0.0)
    assert found.base_poses is None
    with pytest.raises(InvalidValueError, match="greater than 0"):
        padded(robot.description, motion, end={}, seconds=0.0)


def test_a_pose_is_as_far_from_its_ways_as_their_samples(robot):
    zero = of(robot, "zero")
    pose = robot.trajectory(np.zeros(1), robot.named_configuration("squat")[np.newaxis])
    found = padded(robot.description, pose, zero, zero)
    np.testing.assert_allclose(np.diff(found.times), 1 / 30.0)


def test_a_way_of_too_many_samples_is_refused(robot):
    motion = walk(robot).at_speed(1e6)
    with pytest.raises(
        InvalidValueError, match=r"at the motion's 3e\+07 Hz; the limit"
    ):
        padded(robot.description, motion, of(robot, "zero"))


def test_a_joint_that_cannot_move_is_told(robot):
    joints = [replace(joint, velocity=0.0) for joint in robot.description.joints]
    stuck = replace(robot.description, joints=tuple(joints))
    with pytest.raises(MotionError, match="cannot move: its velocity limit is 0"):
        padded(stuck, walk(robot), begin={})


def test_a_whole_motion_is_set_on_the_floor(robot):
    found = on_floor(robot.description, walk(robot))
    assert lowest_height(robot.description, found) == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_array_equal(found.positions, walk(robot).positions)
    with pytest.raises(MotionError, match="has no base"):
        on_floor(robot.description, replace(found, base_poses=None))
