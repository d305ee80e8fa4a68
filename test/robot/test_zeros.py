"""A joint at zero reads 0.0, and what is merely small is told as it is."""

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
