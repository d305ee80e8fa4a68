"""Joints are measured exactly, whatever the robot; one at zero reads 0.0."""

import numpy as np
import pytest
from conftest import REPOSITORY
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from oracle import forward_kinematics
from robots import chains, world_poses

from g1_description.bridge.estimator import JointStateEstimator
from g1_description.robot.joint_angles import measure, measured_joints
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.lumping import lump_fixed_joints
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


G1 = parse_urdf((REPOSITORY / "urdf" / "g1_29dof.urdf").read_text())


BODIES = lump_fixed_joints(G1)


KINEMATICS = Kinematics(BODIES.description)


JOINTS = BODIES.description.movable_joints


FRACTIONS = st.lists(
    st.one_of(st.none(), st.floats(0.0, 1.0)), min_size=29, max_size=29
)


FAR = st.sampled_from([1.0, 1e3])


def seen(root_pose, root_twist, position, velocity):
    """Let the bridge's estimator see the G1; give what it measures by joint."""
    poses, twists = KINEMATICS.link_states(root_pose, position, root_twist, velocity)
    names = [f"g1::{link}" for link in BODIES.link_names]
    (measured,) = JointStateEstimator({"g1": G1}).update(names, poses, twists, 0)
    pairs = zip(measured.positions.tolist(), measured.velocities.tolist())
    return dict(zip(measured.names, pairs))


def is_zero(number):
    """Tell whether it is 0.0, which -0.0 is not."""
    return str(number) == "0.0"


@settings(max_examples=20)
@given(
    world_poses(), FAR, FRACTIONS, st.lists(st.floats(-9, 9), min_size=6, max_size=6)
)
def test_joints_at_zero_are_zero_whatever_base_and_others_do(
    root_pose, far, fractions, twist
):
    root_pose[:3] *= far
    position, velocity = np.zeros(29), np.zeros(29)
    for row, (joint, share) in enumerate(zip(JOINTS, fractions)):
        if share is not None:
            position[row] = joint.lower + share * (joint.upper - joint.lower)
            velocity[row] = 10.0 * share - 5.0
    told = seen(root_pose, np.array(twist), position, velocity)
    for joint, share, expected in zip(JOINTS, fractions, position):
        if share is None:
            assert all(map(is_zero, told[joint.name])), (joint.name, told[joint.name])
        else:
            assert told[joint.name][0] == pytest.approx(expected, abs=1e-14)


@settings(max_examples=15)
@given(world_poses(), st.sampled_from([1e-12, -1e-12, 1e-13]))
def test_a_small_position_is_no_zero(root_pose, small):
    told = seen(root_pose, np.zeros(6), np.full(29, small), np.full(29, small))
    for position, velocity in told.values():
        assert position == pytest.approx(small, abs=5e-15)
        assert velocity == pytest.approx(small, abs=5e-15)


@settings(max_examples=20)
@given(chains(), world_poses(), st.randoms(use_true_random=False))
def test_any_joint_at_zero_is_zero(chain, root_pose, random):
    """Links placed by scipy, joints that slide among them."""
    text, positions = chain
    robot = parse_urdf(text)
    still = [
        joint.name
        for joint in robot.movable_joints
        if joint.lower < 0.0 < joint.upper and random.random() < 0.7
    ]
    assume(still)
    placed = forward_kinematics(
        text, root_pose, {**positions, **dict.fromkeys(still, 0.0)}
    )
    poses = np.array([placed[link] for link in robot.link_names])
    joints = measured_joints(robot, robot.link_names)
    measured = measure(poses, np.zeros((len(poses), 6)), joints)
    told = dict(zip(joints.names, zip(*(part.tolist() for part in measured[:2]))))
    for name in still:
        position, velocity = told[name]
        # Where the limits leave turns open, it may be one of the others.
        assert is_zero(position) or abs(position) > 6.0, position
        assert is_zero(velocity)
