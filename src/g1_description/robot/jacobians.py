"""Jacobians of links, points and the centre of mass, from one forward kinematics.

A Jacobian J has a column per degree of freedom: the linear and angular velocity of the
root link along the world's axes, then the velocities of the movable joints. Source:
Featherstone, Rigid Body Dynamics Algorithms, 2008, section 2.10.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np

from g1_description.robot.dynamics import Masses
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.rotation import cross


class Jacobians:
    """The Jacobians of configurations of a robot with one tree.

    Leading axes of all arrays are those of a batch.
    """

    def __init__(
        self, kinematics: Kinematics, T_world_root: np.ndarray, position: np.ndarray
    ) -> None:
        """Place the robot.

        Args:
            kinematics: Kinematics of the robot.
            T_world_root: Pose of the root link in the world, shape (..., 7).
            position: Positions of the movable joints in [rad] or [m], shape
                (..., n_joints).
        """
        self.link_poses, origin, axis = kinematics.place(T_world_root, position)
        """Poses of all links in the world, shape (..., n_links, 7)."""
        above = kinematics.joints_above
        self._moves = np.concatenate([np.ones((len(above), 6)), above], axis=1)
        # At the world's origin, shape (..., 6 + n_joints, 6).
        root = np.zeros((*position.shape[:-1], 6, 6))
        root[...] = np.eye(6)
        root[..., 3:, :3] = cross(T_world_root[..., np.newaxis, :3], np.eye(3))
        screws = kinematics.joint_screws(origin, axis)
        self._screws = np.concatenate([root, screws], axis=-2)

    @property
    def n_columns(self) -> int:
        """Return the number of degrees of freedom, 6 + n_joints."""
        return self._moves.shape[1]

    def of_links(
        self, rows: Sequence[int] | np.ndarray, points: np.ndarray | None = None
    ) -> np.ndarray:
        """Compute the Jacobians of links.

        Args:
            rows: Rows of the links, shape (n,).
            points: Points of the links in the world, in [m], shape (..., n, 3); None:
                their origins.

        Returns:
            J such that J @ velocities is the twist of the point, linear then angular,
            along the world's axes, shape (..., n, 6, 6 + n_joints).
        """
        if points is None:
            points = self.link_poses[..., rows, :3]
        linear = self.of_points(rows, points)
        moves = self._moves[rows][:, np.newaxis]
        angular = moves * np.swapaxes(self._screws[..., np.newaxis, :, 3:], -1, -2)
        return np.concatenate([linear, angular], axis=-2)

    def of_points(
        self, rows: Sequence[int] | np.ndarray, points: np.ndarray
    ) -> np.ndarray:
        """Compute the Jacobians of points of links.

        Args:
            rows: Rows of the links, shape (n,).
            points: In the world, in [m], shape (..., n, 3).

        Returns:
            J such that J @ velocities is the velocity of the point, along the world's
            axes, shape (..., n, 3, 6 + n_joints).
        """
        return self._of_points(self._screws[..., np.newaxis, :, :], rows, points)

    def of_each(
        self, samples: np.ndarray, rows: np.ndarray, points: np.ndarray
    ) -> np.ndarray:
        """Compute the Jacobians of points, each in one configuration of a batch.

        Args:
            samples: Indices of the configurations, shape (n,).
            rows: Rows of the links, shape (n,).
            points: In the world, in [m], shape (n, 3).

        Returns:
            As ``of_points``, shape (n, 3, 6 + n_joints).
        """
        return self._of_points(self._screws[samples], rows, points)

    def _of_points(
        self, screws: np.ndarray, rows: Sequence[int] | np.ndarray, points: np.ndarray
    ) -> np.ndarray:
        """Compute the Jacobians of points from the screws that move each."""
        moved = screws[..., :3] - cross(points[..., np.newaxis, :], screws[..., 3:])
        return np.swapaxes(self._moves[rows][..., np.newaxis] * moved, -1, -2)

    def batched(self) -> Jacobians:
        """Return those of one configuration as a batch of one."""
        batch = copy(self)
        batch.link_poses = self.link_poses[np.newaxis]
        batch._screws = self._screws[np.newaxis]
        return batch

    def of_center_of_mass(self, masses: Masses) -> np.ndarray:
        """Compute the Jacobian of the centre of mass.

        Args:
            masses: Masses of the robot; not without any.

        Returns:
            J such that J @ velocities is the velocity of the centre of mass, along the
            world's axes, shape (..., 3, 6 + n_joints).
        """
        share = masses.shares[..., np.newaxis]
        carried = (np.swapaxes(share, -1, -2) @ self._moves)[..., 0, :, np.newaxis]
        shares = np.swapaxes(self._moves * share, -1, -2)
        levers = shares @ masses.centers(self.link_poses)
        moved = carried * self._screws[..., :3] - cross(levers, self._screws[..., 3:])
        return np.swapaxes(moved, -1, -2)
