"""Jacobians: how links, and the centre of mass, move with base and joints."""

from __future__ import annotations

import numpy as np

from g1_description.core.robot.kinematics import Kinematics
from g1_description.core.rotation import cross

from .masses import Masses


def link_jacobian(
    kinematics: Kinematics, T_world_root: np.ndarray, position: np.ndarray, link: int
) -> np.ndarray:
    """Compute the geometric Jacobian of a link's origin.

    Source: Featherstone, Rigid Body Dynamics Algorithms, 2008, section 2.10.

    Args:
        kinematics: Of a robot with one tree.
        T_world_root: Pose of the root link in the world, shape (..., 7).
        position: Positions of the movable joints in [rad] or [m], shape
            (..., n_joints).
        link: Row of the link.

    Returns:
        J such that J @ (root's linear velocity, root's angular velocity, joints'
        velocities) is the twist of the link's origin, linear then angular, along the
        world's axes, shape (..., 6, 6 + n_joints).
    """
    poses, origin, axis = kinematics.place(T_world_root, position)
    screws = kinematics.joint_screws(origin, axis)
    screws = screws * kinematics.joints_above[link][:, np.newaxis]
    moved = _with_root(screws, T_world_root)
    moved[..., :3] -= cross(poses[..., link, np.newaxis, :3], moved[..., 3:])
    return np.swapaxes(moved, -1, -2)


def center_of_mass_jacobian(
    kinematics: Kinematics,
    masses: Masses,
    T_world_root: np.ndarray,
    position: np.ndarray,
) -> np.ndarray:
    """Compute the Jacobian of the centre of mass.

    Args:
        kinematics: Of a robot with one tree.
        masses: Of the same robot.
        T_world_root: Pose of the root link in the world, shape (..., 7).
        position: Positions of the movable joints in [rad] or [m], shape
            (..., n_joints).

    Returns:
        J such that J @ (root's linear velocity, root's angular velocity, joints'
        velocities) is the velocity of the centre of mass along the world's axes, shape
        (..., 3, 6 + n_joints).
    """
    poses, origin, axis = kinematics.place(T_world_root, position)
    screws = _with_root(kinematics.joint_screws(origin, axis), T_world_root)
    n_links = len(masses.mass)
    moves = np.concatenate([np.ones((n_links, 6)), kinematics.joints_above], axis=1)
    share = masses.mass / masses.total
    carried = (share @ moves)[:, np.newaxis]
    levers = np.swapaxes(moves * share[:, np.newaxis], 0, 1) @ masses.centers(poses)
    moved = carried * screws[..., :3] - cross(levers, screws[..., 3:])
    return np.swapaxes(moved, -1, -2)


def _with_root(screws: np.ndarray, T_world_root: np.ndarray) -> np.ndarray:
    """Put the six ways to move the root before the screws of the joints.

    Args:
        screws: Of the joints, at the world's origin, shape (..., n_joints, 6).
        T_world_root: Pose of the root, shape (..., 7).

    Returns:
        Shape (..., 6 + n_joints, 6).
    """
    root = np.zeros((*screws.shape[:-2], 6, 6))
    root[...] = np.eye(6)
    root[..., 3:, :3] = cross(T_world_root[..., np.newaxis, :3], np.eye(3))
    return np.concatenate([root, screws], axis=-2)
