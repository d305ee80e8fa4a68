"""Forward kinematics: joint positions to link poses and twists, all links at once.

Exact to the last bits of a double, which the link poses PyBullet reports are
not (it rounds them to single precision, 6e-7 rad on the G1).
"""

from __future__ import annotations

import numpy as np

from .assembly import WORLD
from .description import Description
from .rotation import from_axis_angle, rotate
from .transform import IDENTITY, compose
from .tree import below


class Kinematics:
    """The chain of joints of one robot, as arrays.

    Links and joints keep the order of the description. Each link's transform is
    found by doubling: after k rounds every link knows its pose in its ancestor
    2^k links up, so a chain of n links takes log2(n) products over the batch.
    """

    def __init__(self, description: Description) -> None:
        """Prepare the arrays.

        Args:
            description: Bodies and joints, such as lumping leaves. A root called
                ``WORLD`` is no link: nothing is computed for it.
        """
        links, joints = description.link_names, description.joints
        if description.root == WORLD:
            links = (*(link for link in links if link != WORLD), WORLD)
        node = {link: row for row, link in enumerate(links)}
        self._n_links = len(links) - (description.root == WORLD)
        root = node[description.root]
        parent = np.full(len(links), root)
        self._rest = np.tile(IDENTITY, (len(links), 1))
        for joint in joints:
            parent[node[joint.child]] = node[joint.parent]
            self._rest[node[joint.child]] = joint.pose
        movable = description.movable_joints
        self._child = np.array([node[j.child] for j in movable], dtype=int)
        self._zero = self._rest[self._child]
        self._axis = np.array([j.axis for j in movable]).reshape(-1, 3)
        self._anchor = np.array([j.anchor for j in movable]).reshape(-1, 3)
        self._turns = np.array([j.kind != "prismatic" for j in movable], dtype=bool)
        self._rounds = self._doubling(parent, root)
        self._above = _joints_above(description, node)[: self._n_links]

    def link_poses(self, T_world_root: np.ndarray, position: np.ndarray) -> np.ndarray:
        """Place all links.

        Args:
            T_world_root: Pose of the root link in the world, shape (7,).
            position: Positions of the movable joints in [rad] or [m], shape
                (n_joints,).

        Returns:
            Poses of the link frames in the world, shape (n_links, 7).
        """
        motion = np.zeros((len(position), 7))
        motion[:, 3:] = from_axis_angle(self._axis, np.where(self._turns, position, 0))
        motion[:, :3] = np.where(self._turns, 0.0, position)[:, np.newaxis] * self._axis
        if self._anchor.any():
            motion[:, :3] += self._anchor - rotate(motion[:, 3:], self._anchor)
        poses = self._rest.copy()
        poses[self._child] = compose(self._zero, motion)
        for link, ancestor in self._rounds:
            poses[link] = compose(poses[ancestor], poses[link])
        return compose(T_world_root, poses[: self._n_links])

    def link_twists(
        self,
        T_world_root: np.ndarray,
        poses: np.ndarray,
        root_twist: np.ndarray,
        velocity: np.ndarray,
    ) -> np.ndarray:
        """Find how all links move.

        Each joint adds its angular velocity, and its linear velocity at the
        world's origin, to all links below it; moved to each link's own origin.

        Args:
            T_world_root: Pose of the root link in the world, shape (7,).
            poses: Poses of the link frames in the world, shape (n_links, 7).
            root_twist: Linear velocity of the root frame's origin and angular
                velocity of the root link, along the world's axes, in [m/s] and
                [rad/s], shape (6,).
            velocity: Velocities of the movable joints in [rad/s] or [m/s], shape
                (n_joints,).

        Returns:
            Twists of the link frames' origins, linear then angular, along the
            world's axes, shape (n_links, 6).
        """
        child = poses[self._child]
        origin = child[:, :3]
        if self._anchor.any():
            origin = origin + rotate(child[:, 3:], self._anchor)
        speed = rotate(child[:, 3:], self._axis) * velocity[:, np.newaxis]
        turning = np.where(self._turns[:, np.newaxis], speed, 0.0)
        sliding = np.where(self._turns[:, np.newaxis], 0.0, speed)
        at_origin = np.hstack([_cross(origin, turning) + sliding, turning])
        twists = self._above @ at_origin + root_twist
        root_at_origin = _cross(T_world_root[:3], root_twist[3:])
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


def _joints_above(description: Description, node: dict[str, int]) -> np.ndarray:
    """Mark the movable joints between each link and the root, a row per node."""
    movable = {joint.name: n for n, joint in enumerate(description.movable_joints)}
    above = np.zeros((len(node), len(movable)))
    for joint in below(description.root, description.joints):
        above[node[joint.child]] = above[node[joint.parent]]
        if joint.name in movable:
            above[node[joint.child], movable[joint.name]] = 1.0
    return above


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product over the last axis, several times faster than numpy's."""
    result = np.empty(np.broadcast(a, b).shape)
    result[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    result[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    result[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return result
