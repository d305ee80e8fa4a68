"""Centre of mass, Jacobians and inverse dynamics agree with Pinocchio."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import chains, world_poses

from g1_description.errors import DescriptionError
from g1_description.robot.dynamics import (
    Masses,
    RobotMotion,
    inverse_dynamics,
)
from g1_description.robot.jacobians import Jacobians
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.rotation import normalized
from g1_description.robot.urdf import parse_urdf

pinocchio = pytest.importorskip(
    "pinocchio", reason="pinocchio is not there, as its wheels need numpy 1.23"
)

G1 = (Path(__file__).parents[2] / "urdf" / "g1_29dof.urdf").read_text()


class Oracle:
    """Pinocchio's model of a robot whose root floats."""

    def __init__(self, text):
        free = pinocchio.JointModelFreeFlyer()
        self.model = pinocchio.buildModelFromXML(text, free)
        self.data = self.model.createData()
        self.model.gravity.linear = np.array([0.0, 0.0, -9.8])
        names = [*self.model.names][2:]
        own = [joint.name for joint in parse_urdf(text).movable_joints]
        self.order = [own.index(name) for name in names]

    def configuration(self, pose, positions):
        return np.concatenate([pose, positions[self.order]])

    def tangent(self, pose, root, joints):
        """Convert along the world's axes to along the root's, as Pinocchio has it."""
        turn = pinocchio.Quaternion(*pose[[6, 3, 4, 5]]).toRotationMatrix()
        return np.concatenate(
            [turn.T @ root[:3], turn.T @ root[3:], joints[self.order]]
        )


def batch(n_joints, n=3, seed=0):
    """Draw configurations and how they change."""
    rng = np.random.default_rng(seed)
    pose = rng.normal(size=(n, 7))
    pose[:, 3:] = normalized(pose[:, 3:])
    return RobotMotion(
        pose,
        *(rng.normal(size=(n, size)) for size in (n_joints, 6, n_joints, 6, n_joints)),
    )


def test_center_of_mass_is_pinocchios():
    robot, motion, oracle = parse_urdf(G1), batch(29), Oracle(G1)
    poses = Kinematics(robot).link_poses(motion.T_world_root, motion.positions)
    centers = Masses(robot).robot_center(poses)
    for pose, positions, center in zip(motion.T_world_root, motion.positions, centers):
        q = oracle.configuration(pose, positions)
        wanted = pinocchio.centerOfMass(oracle.model, oracle.data, q)
        np.testing.assert_allclose(center, wanted, rtol=0, atol=1e-12)


def test_efforts_and_root_wrench_are_pinocchios():
    robot, motion, oracle = parse_urdf(G1), batch(29), Oracle(G1)
    found = inverse_dynamics(Kinematics(robot), Masses(robot), motion)
    for n in range(3):
        pose = motion.T_world_root[n]
        q = oracle.configuration(pose, motion.positions[n])
        v = oracle.tangent(pose, motion.root_twists[n], motion.velocities[n])
        root = motion.root_accelerations[n].copy()
        linear, angular = motion.root_twists[n, :3], motion.root_twists[n, 3:]
        root[:3] -= np.cross(angular, linear)
        a = oracle.tangent(pose, root, motion.accelerations[n])
        wanted = pinocchio.rnea(oracle.model, oracle.data, q, v, a)
        np.testing.assert_allclose(
            found.efforts[n][oracle.order], wanted[6:], rtol=0, atol=1e-9
        )
        turn = pinocchio.Quaternion(*pose[[6, 3, 4, 5]]).toRotationMatrix()
        force, moment = turn @ wanted[:3], turn @ wanted[3:6]
        at_origin = np.concatenate([force, moment + np.cross(pose[:3], force)])
        np.testing.assert_allclose(found.root_wrench[n], at_origin, rtol=0, atol=1e-9)


@settings(max_examples=12)
@given(chains(), world_poses(), st.integers(0, 1000))
def test_any_chain_has_pinocchios_frames_and_jacobians(chain, pose, seed):
    """Prismatic and continuous joints, fixed ones, axes and origins of any kind."""
    text, _ = chain
    text = text.replace('type="continuous"', 'type="revolute"')
    robot = parse_urdf(text)
    if not robot.movable_joints:
        return
    oracle = Oracle(text)
    positions = np.random.default_rng(seed).uniform(-1, 1, len(robot.movable_joints))
    q = oracle.configuration(pose, positions)
    pinocchio.computeJointJacobians(oracle.model, oracle.data, q)
    pinocchio.updateFramePlacements(oracle.model, oracle.data)
    rows = np.arange(len(robot.link_names))
    jacobians = Jacobians(Kinematics(robot), pose, positions).of_links(rows)
    columns = [*range(6), *(6 + n for n in oracle.order)]
    turn = pinocchio.Quaternion(*pose[[6, 3, 4, 5]]).toRotationMatrix()
    to_root = np.kron(np.eye(2), turn)
    for row, name in enumerate(robot.link_names):
        frame = oracle.model.getFrameId(name, pinocchio.FrameType.BODY)
        wanted = pinocchio.getFrameJacobian(
            oracle.model,
            oracle.data,
            frame,
            pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED,
        )
        found = jacobians[row][:, columns]
        found[:, :6] = found[:, :6] @ to_root
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-9)


def test_the_center_of_mass_jacobian_is_pinocchios():
    robot, motion, oracle = parse_urdf(G1), batch(29, n=1), Oracle(G1)
    pose, positions = motion.T_world_root[0], motion.positions[0]
    q = oracle.configuration(pose, positions)
    wanted = pinocchio.jacobianCenterOfMass(oracle.model, oracle.data, q)
    jacobians = Jacobians(Kinematics(robot), pose, positions)
    found = jacobians.of_center_of_mass(Masses(robot))
    turn = pinocchio.Quaternion(*pose[[6, 3, 4, 5]]).toRotationMatrix()
    found = found[:, [*range(6), *(6 + n for n in oracle.order)]]
    found[:, :6] = found[:, :6] @ np.kron(np.eye(2), turn)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12)


def test_a_batch_is_its_configurations():
    robot, motion = parse_urdf(G1), batch(29, n=6)
    kinematics, masses = Kinematics(robot), Masses(robot)
    together = inverse_dynamics(kinematics, masses, motion)
    for n in range(6):
        rows = {name: array[n] for name, array in vars(motion).items()}
        alone = inverse_dynamics(kinematics, masses, RobotMotion(**rows))
        for name, array in vars(together).items():
            np.testing.assert_allclose(array[n], vars(alone)[name], rtol=0, atol=1e-9)


def test_a_robot_without_masses_has_no_center():
    robot = parse_urdf('<robot name="ghost"><link name="a"/></robot>')
    with pytest.raises(DescriptionError, match=r"ghost has no centre of mass"):
        Masses(robot).robot_center(np.array([[0.0, 0, 0, 0, 0, 0, 1]]))
