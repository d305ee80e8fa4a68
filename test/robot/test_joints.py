"""Joint positions and velocities are measured exactly, whatever the robot."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import forward_kinematics
from robots import chains, world_poses

from g1_description.robot.joint_angles import measure, measured_joints
from g1_description.robot.urdf import parse_urdf

SIGNS = st.lists(st.sampled_from([1.0, -1.0]), min_size=9, max_size=9)
TURNING = st.sampled_from(["revolute", "continuous", "fixed"])


def signed(poses, signs):
    poses = poses.copy()
    poses[:, 3:] *= np.array(signs[: len(poses)])[:, np.newaxis]
    return poses


def measure_placed(text, positions, root_pose, lumped, signs):
    """Place the links by scipy, publish some of them, measure the joints."""
    robot = parse_urdf(text)
    placed = forward_kinematics(text, root_pose, positions)
    fixed = {joint.child for joint in robot.joints if joint.kind == "fixed"}
    links = [link for link in robot.link_names if not (lumped and link in fixed)]
    joints = measured_joints(robot, links)
    poses = signed(np.array([placed[link] for link in links]), signs)
    assert not joints.missing
    twists = np.zeros((len(links), 6))
    return dict(zip(joints.names, measure(poses, twists, joints)[0]))


@settings(max_examples=20)
@given(chains(), world_poses(), st.booleans(), SIGNS)
def test_recovers_the_position_that_placed_the_links(chain, root_pose, lumped, signs):
    text, positions = chain
    measured = measure_placed(text, positions, root_pose, lumped, signs)
    assert measured.keys() == positions.keys()
    joints = {joint.name: joint for joint in parse_urdf(text).joints}
    # A limit span beyond a whole turn leaves the turn open: allow whole turns there.
    for name, expected in positions.items():
        error = measured[name] - expected
        joint = joints[name]
        if joint.kind == "revolute" and joint.upper - joint.lower > 2 * np.pi - 1e-6:
            error -= 2 * np.pi * np.round(error / (2 * np.pi))
        assert abs(error) < 1e-9


@settings(max_examples=20)
@given(chains(TURNING), world_poses(), st.integers(-3, 3))
def test_continuous_joints_go_on_from_their_last_position(chain, root_pose, turns):
    text, positions = chain
    robot = parse_urdf(text)
    placed = forward_kinematics(text, root_pose, positions)
    joints = measured_joints(robot, robot.link_names)
    poses = np.array([placed[link] for link in robot.link_names])
    last = np.array([positions[name] for name in joints.names]) + turns * 2 * np.pi
    twists = np.zeros((len(poses), 6))
    previous = np.array([last + 0.01, np.zeros(len(last)), np.zeros(len(last))])
    measured, _, _ = measure(poses, twists, joints, previous)
    free = np.isinf(joints.upper)
    np.testing.assert_allclose(measured[free], last[free], atol=1e-9)


@settings(max_examples=20)
@given(chains(), world_poses(), st.randoms(use_true_random=False))
def test_velocities_are_the_slopes_of_positions(chain, root_pose, random):
    """Twists by finite differences of scipy's poses, no formula of ours."""
    text, positions = chain
    robot = parse_urdf(text)
    speed = {name: random.uniform(-1.0, 1.0) for name in positions}
    root_speed = np.array([random.uniform(-1.0, 1.0) for _ in range(3)])
    dt = 1e-5

    def placed(time):
        moved = {name: positions[name] + speed[name] * time for name in positions}
        root = np.concatenate([root_pose[:3] + root_speed * time, root_pose[3:]])
        poses = forward_kinematics(text, root, moved)
        return np.array([poses[link] for link in robot.link_names])

    from scipy.spatial.transform import Rotation

    before, now, after = placed(-dt), placed(0.0), placed(dt)
    linear = (after[:, :3] - before[:, :3]) / (2 * dt)
    turn = Rotation.from_quat(after[:, 3:]) * Rotation.from_quat(before[:, 3:]).inv()
    twists = np.hstack([linear, turn.as_rotvec() / (2 * dt)])
    joints = measured_joints(robot, robot.link_names)
    expected = [speed[name] for name in joints.names]
    _, velocity, residual = measure(now, twists, joints)
    np.testing.assert_allclose(velocity, expected, atol=1e-6)
    np.testing.assert_allclose(residual, 0.0, atol=1e-12)


def test_a_joint_whose_link_is_missing_is_left_out_by_name():
    text = (
        '<robot name="r"><link name="a"/><link name="b"/><link name="c"/>'
        '<joint name="ab" type="continuous"><parent link="a"/><child link="b"/></joint>'
        '<joint name="bc" type="continuous"><parent link="b"/><child link="c"/></joint>'
        "</robot>"
    )
    joints = measured_joints(parse_urdf(text), ["a", "b"])
    assert joints.names == ("ab",)
    assert joints.missing == ("c",)


def test_poses_of_the_wrong_width_are_refused():
    robot = parse_urdf('<robot name="r"><link name="a"/></robot>')
    with pytest.raises(ValueError, match="7 wide"):
        measure(np.zeros((1, 6)), np.zeros((1, 6)), measured_joints(robot, ["a"]))
