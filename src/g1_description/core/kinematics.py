"""Forward kinematics: joint positions to link poses and twists, all links at once.

Exact to the last bits of a double, which the link poses PyBullet reports are
not (it rounds them to single precision, 6e-7 rad on the G1).
"""

from __future__ import annotations

import numpy as np

from .description import Description
from .rotation import from_axis_angle, rotate
from .transform import compose


class Kinematics:
    """The chain of joints of one robot, as arrays.

    Links and joints keep the order of the description. Each link's transform is
    found by doubling: after k rounds every link knows its pose in its ancestor
    2^k links up, so a chain of n links takes log2(n) products over the batch.
    """

    def __init__(self, description: Description) -> None:
        """Prepare the arrays.

        Args:
            description: Robot with movable joints only, such as lumping leaves.
        """
        names = list(description.link_names)
        joints = description.joints
        self._n_links = len(names)
        self._child = np.array([names.index(j.child) for j in joints], dtype=int)
        self._zero = np.array([j.pose for j in joints]).reshape(-1, 7)
        self._axis = np.array([j.axis for j in joints]).reshape(-1, 3)
        self._turns = np.array([j.kind != "prismatic" for j in joints], dtype=bool)
        self._root = root = names.index(description.root)
        parent = np.full(self._n_links, root)
        parent[self._child] = [names.index(j.parent) for j in joints]
        self._rounds = self._doubling(parent, root)
        self._above = self._joints_above(parent, root)

    def link_poses(self, T_world_root: np.ndarray, position: np.ndarray) -> np.ndarray:
        """Place all links.

        Args:
            T_world_root: Pose of the root link in the world, shape (7,).
            position: Joint positions in [rad] or [m], shape (n_joints,).

        Returns:
            Poses of the link frames in the world, shape (n_links, 7).
        """
        motion = np.zeros((len(position), 7))
        motion[:, 3:] = from_axis_angle(self._axis, np.where(self._turns, position, 0))
        motion[:, :3] = np.where(self._turns, 0.0, position)[:, np.newaxis] * self._axis
        poses = np.zeros((self._n_links, 7))
        poses[:, 6] = 1.0
        poses[self._child] = compose(self._zero, motion)
        for link, ancestor in self._rounds:
            poses[link] = compose(poses[ancestor], poses[link])
        return compose(T_world_root, poses)

    def link_twists(
        self, poses: np.ndarray, root_twist: np.ndarray, velocity: np.ndarray
    ) -> np.ndarray:
        """Find how all links move.

        Each joint adds its angular velocity, and its linear velocity at the
        world's origin, to all links below it; moved to each link's own origin.

        Args:
            poses: Poses of the link frames in the world, shape (n_links, 7).
            root_twist: Linear velocity of the root frame's origin and angular
                velocity of the root link, along the world's axes, in [m/s] and
                [rad/s], shape (6,).
            velocity: Joint velocities in [rad/s] or [m/s], shape (n_joints,).

        Returns:
            Twists of the link frames' origins, linear then angular, along the
            world's axes, shape (n_links, 6).
        """
        child = poses[self._child]
        speed = rotate(child[:, 3:], self._axis) * velocity[:, np.newaxis]
        turning = np.where(self._turns[:, np.newaxis], speed, 0.0)
        sliding = np.where(self._turns[:, np.newaxis], 0.0, speed)
        at_origin = np.hstack([_cross(child[:, :3], turning) + sliding, turning])
        twists = self._above @ at_origin + root_twist
        root_at_origin = _cross(poses[self._root, :3], root_twist[3:])
        twists[:, :3] += root_at_origin - _cross(poses[:, :3], twists[:, 3:])
        return twists

    def links_below(self, joints: np.ndarray) -> np.ndarray:
        """Find the links that move with any of some joints.

        Args:
            joints: Indices of joints, shape (n,).

        Returns:
            Whether a link hangs below one of them, shape (n_links,).
        """
        return self._above[:, joints].any(axis=1)

    @staticmethod
    def _doubling(parent: np.ndarray, root: int) -> list[tuple[np.ndarray, np.ndarray]]:
        """List, per round, the links not yet placed and the ancestor to use."""
        rounds = []
        ancestor = parent
        while (ancestor != root).any():
            link = np.flatnonzero(ancestor != root)
            rounds.append((link, ancestor[link]))
            ancestor = ancestor[ancestor]
        return rounds

    def _joints_above(self, parent: np.ndarray, root: int) -> np.ndarray:
        """Mark the joints between each link and the root, shape (n_links, n_joints)."""
        above = np.zeros((self._n_links, len(self._child)))
        joint_of = {link: joint for joint, link in enumerate(self._child)}
        for link in range(self._n_links):
            step = link
            while step != root:
                above[link, joint_of[step]] = 1.0
                step = parent[step]
        return above


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product over the last axis, several times faster than numpy's."""
    result = np.empty(np.broadcast(a, b).shape)
    result[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    result[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    result[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return result
