"""Forward kinematics agrees with scipy, and twists with finite differences."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import assert_poses_close, forward_kinematics
from robots import chains, world_poses
from scipy.spatial.transform import Rotation

from g1_description.robot.kinematics import Kinematics
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.urdf import parse_urdf


def lumped_positions(lumped, positions):
    return np.array([positions[joint.name] for joint in lumped.description.joints])


@settings(max_examples=20)
@given(chains(), world_poses())
def test_links_are_where_scipy_puts_them(chain, root_pose):
    text, positions = chain
    lumped = lump_fixed_joints(parse_urdf(text))
    kinematics = Kinematics(lumped.description)
    poses = kinematics.link_poses(root_pose, lumped_positions(lumped, positions))
    expected = forward_kinematics(text, root_pose, positions)
    wanted = np.array([expected[link] for link in lumped.description.link_names])
    assert_poses_close(poses, wanted, 1e-12)


@settings(max_examples=20)
@given(chains(), world_poses(), st.randoms(use_true_random=False))
def test_twists_are_the_slopes_of_poses(chain, root_pose, random):
    text, positions = chain
    lumped = lump_fixed_joints(parse_urdf(text))
    kinematics = Kinematics(lumped.description)
    start = lumped_positions(lumped, positions)
    velocity = np.array([random.uniform(-1, 1) for _ in start])
    root_twist = np.array([random.uniform(-1, 1) for _ in range(6)])
    dt = 1e-5

    def placed(time):
        turn = Rotation.from_rotvec(root_twist[3:] * time)
        q = (turn * Rotation.from_quat(root_pose[3:])).as_quat()
        root = np.concatenate([root_pose[:3] + root_twist[:3] * time, q])
        return kinematics.link_poses(root, start + velocity * time)

    before, after = placed(-dt), placed(dt)
    turn = Rotation.from_quat(after[:, 3:]) * Rotation.from_quat(before[:, 3:]).inv()
    slopes = np.hstack(
        [(after[:, :3] - before[:, :3]) / (2 * dt), turn.as_rotvec() / (2 * dt)]
    )
    poses, twists = kinematics.link_states(root_pose, start, root_twist, velocity)
    np.testing.assert_array_equal(poses, kinematics.link_poses(root_pose, start))
    np.testing.assert_allclose(twists, slopes, atol=1e-6)


def test_the_root_stays_to_the_last_bit():
    text = (
        '<robot name="r"><link name="a"/><link name="b"/>'
        '<joint name="ab" type="continuous"><parent link="a"/><child link="b"/>'
        '<origin rpy="0.1 0.2 0.3"/></joint></robot>'
    )
    root_pose = np.array([0.1, 0.2, 0.793, 0.1, 0.7, -0.1, 0.7])
    poses = Kinematics(parse_urdf(text)).link_poses(root_pose, np.array([1.0]))
    assert (poses[0] == root_pose).all()


@settings(max_examples=12)
@given(chains(), world_poses(), st.integers(0, 1000))
def test_a_batch_is_its_configurations(chain, root_pose, seed):
    text, _ = chain
    robot = parse_urdf(text)
    kinematics = Kinematics(robot)
    rng = np.random.default_rng(seed)
    position, velocity = rng.normal(size=(2, 4, len(robot.movable_joints)))
    roots, twists = np.tile(root_pose, (4, 1)), rng.normal(size=(4, 6))
    together = kinematics.link_states(roots, position, twists, velocity)
    for n in range(4):
        alone = kinematics.link_states(roots[n], position[n], twists[n], velocity[n])
        for found, wanted in zip(together, alone):
            np.testing.assert_allclose(found[n], wanted, rtol=0, atol=1e-12)
