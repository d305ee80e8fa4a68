"""Forward kinematics: joint positions to link poses and twists, all links at once.

Leading axes of all arrays are those of a batch of configurations.

Exact to double precision, unlike PyBullet's link poses, which are rounded to single
precision (6e-7 rad on the G1).
"""

from __future__ import annotations

import numpy as np

from g1_description.robot.assembly import WORLD
from g1_description.robot.description import Description
from g1_description.robot.rotation import cross, multiply, rotate, to_axes
from g1_description.robot.transform import IDENTITY
from g1_description.robot.tree import below


class Kinematics:
    """The chains of joints of one robot, as arrays.

    Links and joints keep the order of the description. Each link's rotation is
    found by doubling: after k rounds every link knows its rotation in its ancestor
    2^k links up, so a chain of n links takes log2(n) products over the batch. Its
    position is the sum of the offsets above it, which is one product more.
    """

    def __init__(self, description: Description) -> None:
        """Prepare the arrays.

        Args:
            description: Links and joints. A root called ``WORLD`` is excluded.
        """
        links, joints = description.link_names, description.joints
        if description.root == WORLD:
            links = (*(link for link in links if link != WORLD), WORLD)
        node = {link: row for row, link in enumerate(links)}
        self._n_links = len(links) - (description.root == WORLD)
        self._roots = np.array([node[root] for root in description.roots])
        self._parent = np.full(len(links), self._roots[0])
        self._rest = np.tile(IDENTITY, (len(links), 1))
        for joint in joints:
            self._parent[node[joint.child]] = node[joint.parent]
            self._rest[node[joint.child]] = joint.pose
        movable = description.movable_joints
        self._child = np.array([node[j.child] for j in movable], dtype=int)
        axis = np.array([j.axis for j in movable]).reshape(-1, 3)
        self._origin = np.array([j.joint_origin for j in movable]).reshape(-1, 3)
        self._turns = np.array([j.kind != "prismatic" for j in movable], dtype=float)
        self._slides = bool((self._turns == 0.0).any())
        self._has_offsets = bool(self._origin.any())
        self._rest_turn = self._rest[self._child, 3:]
        self._half_turn = multiply(self._rest_turn, np.pad(axis, ((0, 0), (0, 1))))
        self._rest_origin = rotate(self._rest_turn, self._origin)
        self._columns = np.zeros((len(links), 3, 2))
        self._columns[:, :, 0] = self._rest[:, :3]
        self._columns[self._child, :, 1] = rotate(self._rest_turn, axis)
        self._rounds = self._doubling()
        self._above = _joints_above(description, node)[: self._n_links]
        self._tree = _trees(description, node)[: self._n_links]
        self._chain = _links_above(description, node)

    def link_poses(self, T_world_root: np.ndarray, position: np.ndarray) -> np.ndarray:
        """Place all links.

        Args:
            T_world_root: Poses of the root links in the world, shape
                (..., n_trees, 7), or (..., 7) of one tree.
            position: Positions of the movable joints in [rad] or [m], shape
                (..., n_joints).

        Returns:
            Poses of the link frames in the world, shape (..., n_links, 7).
        """
        return self.place(T_world_root, position)[0]

    def link_states(
        self,
        T_world_root: np.ndarray,
        position: np.ndarray,
        root_twist: np.ndarray,
        velocity: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Compute poses and twists of all links.

        Each joint adds its angular velocity, and its linear velocity at the
        world's origin, to all links below it; moved to each link's own origin.

        Args:
            T_world_root: Poses of the root links in the world, shape
                (..., n_trees, 7), or (..., 7) of one tree.
            position: Positions of the movable joints in [rad] or [m], shape
                (..., n_joints).
            root_twist: Linear velocities of the root frames' origins and angular
                velocities of the root links, along the world's axes, in [m/s] and
                [rad/s], shape (..., n_trees, 6), or (..., 6) of one tree.
            velocity: Velocities of the movable joints in [rad/s] or [m/s], shape
                (..., n_joints).

        Returns:
            Poses of the link frames in the world, shape (..., n_links, 7), and twists
            of their origins, linear then angular, along the world's axes, shape
            (..., n_links, 6).
        """
        poses, joint_origin, axis = self.place(T_world_root, position)
        at_origin = self.joint_screws(joint_origin, axis) * velocity[..., np.newaxis]
        roots = _per_tree(T_world_root, position)
        root_twists = _per_tree(root_twist, position)
        twists = self._above @ at_origin + root_twists[..., self._tree, :]
        root_at_origin = cross(roots[..., :3], root_twists[..., 3:])
        twists[..., :3] += root_at_origin[..., self._tree, :]
        twists[..., :3] -= cross(poses[..., :3], twists[..., 3:])
        return poses, twists

    def joint_screws(self, joint_origin: np.ndarray, axis: np.ndarray) -> np.ndarray:
        """Compute the screws of joints: the motion of links below, per unit velocity.

        Args:
            joint_origin: Joint origins in the world, shape (..., n_joints, 3).
            axis: Joint axes in the world, shape (..., n_joints, 3).

        Returns:
            Linear velocity of the point of the link that is at the world's origin, then
            angular velocity, shape (..., n_joints, 6).
        """
        turning = axis * self._turns[:, np.newaxis] if self._slides else axis
        screws = np.concatenate([cross(joint_origin, turning), turning], axis=-1)
        if self._slides:
            screws[..., :3] += axis - turning
        return screws

    def place(
        self, T_world_root: np.ndarray, position: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Place links and joints.

        Args:
            T_world_root: Poses of the root links in the world, shape
                (..., n_trees, 7), or (..., 7) of one tree.
            position: Positions of the movable joints in [rad] or [m], shape
                (..., n_joints).

        Returns:
            Poses of the link frames, shape (..., n_links, 7), joint origins and axes
            of the movable joints, shapes (..., n_joints, 3), all in the world.
        """
        roots = _per_tree(T_world_root, position)
        rotations = np.empty((*position.shape[:-1], len(self._rest), 4))
        rotations[...] = self._rest[:, 3:]
        half = (0.5 * self._turns * position)[..., np.newaxis]
        rotations[..., self._child, :] = (
            np.cos(half) * self._rest_turn + np.sin(half) * self._half_turn
        )
        rotations[..., self._roots, :] = roots[..., 3:]
        for link, ancestor in self._rounds:
            rotations[..., link, :] = multiply(
                rotations.take(ancestor, -2), rotations.take(link, -2)
            )
        turned = to_axes(rotations.take(self._parent, -2)) @ self._in_parent(position)
        offsets, axis = turned[..., 0], turned[..., 1].take(self._child, -2)
        offsets[..., self._roots, :] = roots[..., :3]
        if self._has_offsets:
            lever = rotate(rotations[..., self._child, :], self._origin)
            offsets[..., self._child, :] -= lever
        places = self._chain @ offsets
        origin = places[..., self._child, :]
        if self._has_offsets:
            origin += lever
        poses = np.concatenate([places, rotations], axis=-1)
        return poses[..., : self._n_links, :], origin, axis

    def _in_parent(self, position: np.ndarray) -> np.ndarray:
        """Compute the links' positions in their parents, and the joint axes.

        Returns:
            Two columns per node: the origin of its joint, which is its own where no
            joint is offset, and the axis of its joint, shape (..., n_nodes, 3, 2).
        """
        if not (self._slides or self._has_offsets):
            return self._columns
        columns = np.empty((*position.shape[:-1], *self._columns.shape))
        columns[...] = self._columns
        slid = ((1.0 - self._turns) * position)[..., np.newaxis]
        columns[..., 0][..., self._child, :] += (
            self._rest_origin + slid * self._columns[self._child, :, 1]
        )
        return columns

    @property
    def joints_above(self) -> np.ndarray:
        """1 if a joint is between a link and its root, shape (n_links, n_joints)."""
        return self._above

    @property
    def child_rows(self) -> np.ndarray:
        """Rows of the child links of the movable joints, shape (n_joints,)."""
        return self._child

    def links_below(self, joints: np.ndarray) -> np.ndarray:
        """Find the links that move with any of some joints.

        Args:
            joints: Indices of joints, shape (n,).

        Returns:
            Whether a link is below one of them, shape (n_links,).
        """
        return self._above[:, joints].any(axis=1)

    def end_links(self) -> np.ndarray:
        """Find the links at the ends of limbs, shape (n_links,)."""
        n_above = self._above.sum(axis=1)
        carries = self._above @ self._above.T == n_above[:, np.newaxis]
        return ~(carries & (n_above > n_above[:, np.newaxis])).any(axis=1)

    def limb_ends(self) -> np.ndarray:
        """List a link at the end of each limb, in the order of links."""
        ends = np.flatnonzero(self.end_links() & self._above.any(axis=1))
        firsts = np.unique(self._above[ends], axis=0, return_index=True)[1]
        return ends[np.sort(firsts)]

    def _doubling(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """List the links and ancestors of each round."""
        rounds = []
        ancestor = self._parent.copy()
        ancestor[self._roots] = -1
        while (ancestor >= 0).any():
            link = np.flatnonzero(ancestor >= 0)
            rounds.append((link, ancestor[link]))
            ancestor[link] = ancestor[ancestor[link]]
        return rounds


def _per_tree(rows: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Add the axis of trees to poses or twists of a single tree."""
    return rows[..., np.newaxis, :] if rows.ndim == position.ndim else rows


def _links_above(description: Description, node: dict[str, int]) -> np.ndarray:
    """Mark each link and the links between it and its root, a row per node."""
    chain = np.eye(len(node))
    for joint in below(description.roots, description.joints):
        chain[node[joint.child]] += chain[node[joint.parent]]
    return chain


def _joints_above(description: Description, node: dict[str, int]) -> np.ndarray:
    """Mark the movable joints between each link and its root, a row per node."""
    movable = {joint.name: n for n, joint in enumerate(description.movable_joints)}
    above = np.zeros((len(node), len(movable)))
    for joint in below(description.roots, description.joints):
        above[node[joint.child]] = above[node[joint.parent]]
        if joint.name in movable:
            above[node[joint.child], movable[joint.name]] = 1.0
    return above


def _trees(description: Description, node: dict[str, int]) -> np.ndarray:
    """Number the tree that each link is in, shape (n_nodes,)."""
    tree = np.zeros(len(node), dtype=int)
    for number, root in enumerate(description.roots):
        tree[node[root]] = number
    for joint in below(description.roots, description.joints):
        tree[node[joint.child]] = tree[node[joint.parent]]
    return tree
