"""States of all moving models, read from PyBullet in one batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from typing import Callable

import numpy as np

from g1_description.robot.assembly import SCOPE
from g1_description.robot.description import Description, Joint, Link
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.rotation import cross
from g1_description.robot.transform import compose
from g1_description.sim.bullet.body import Body
from g1_description.sim.bullet.client import BulletClient
from g1_description.sim.model import Model, States


class MovingModels:
    """The moving models of a world, concatenated in common arrays.

    A world has dozens of small ones, for which numpy's overhead per call dominates.
    """

    def __init__(self, client: BulletClient, models: Sequence[Sequence[Body]]) -> None:
        """Create the arrays.

        Args:
            client: PyBullet.
            models: The bodies of each model, in the order of its trees.
        """
        self._client = client
        self._models = [bodies[0].model for bodies in models]
        bodies = list(chain.from_iterable(models))
        self._free = [row for row, body in enumerate(bodies) if not body.tree.fixed]
        self._free_numbers = [bodies[row].number for row in self._free]
        offsets = [bodies[row].T_center_root for row in self._free]
        self._T_center_root = np.array(offsets).reshape(-1, 7)
        self._roots = _slices([len(model.trees) for model in self._models])
        self._joints = _slices([len(model.joint_names) for model in self._models])
        self._links = _slices([len(model.link_names) for model in self._models])
        jointed = [
            (body, joints.start + body.tree.joints)
            for own, joints in zip(models, self._joints)
            for body in own
            if body.rows
        ]
        self._jointed = [body for body, _ in jointed]
        rows = [rows for _, rows in jointed]
        self._rows = np.concatenate([np.zeros(0, dtype=int), *rows])
        self._speeds = np.zeros(1)
        self._measured: list[tuple[States, States, Callable[[], States]]] = []
        if self._models:
            forest, self._of_forest = _joined(self._models)
            self._kinematics = Kinematics(forest)

    def read(self) -> None:
        """Read the state of all models from PyBullet; ``update_models`` applies it."""
        if not self._models:
            return
        roots, root_twists = self._read_roots()
        joints = np.zeros((len(self._rows), 2))
        joints[self._rows] = [
            state[:2] for body in self._jointed for state in body.joint_states()
        ] or np.zeros((0, 2))
        position, velocity = joints.T
        states: list[States] = []

        def links(rows: slice) -> States:
            if not states:  # computed on the first access
                found = self._kinematics.link_states(
                    roots, position, root_twists, velocity
                )
                states.append((found[0][self._of_forest], found[1][self._of_forest]))
            poses, twists = states[0]
            return poses[rows], twists[rows]

        self._measured = [
            (
                (roots[root], root_twists[root]),
                (position[joint], velocity[joint]),
                partial(links, link),
            )
            for root, joint, link in zip(self._roots, self._joints, self._links)
        ]
        self._speeds = np.abs(np.concatenate([root_twists.ravel(), velocity]))

    def update_models(self) -> None:
        """Set the last read state of all models."""
        for model, state in zip(self._models, self._measured):
            model.set_measured_state(*state)

    def _read_roots(self) -> tuple[np.ndarray, np.ndarray]:
        """Read the poses and twists of all roots; fixed ones keep theirs.

        Returns:
            Poses in the world, shape (n_trees, 7), twists of the root frames' origins
            along the world's axes, shape (n_trees, 6).
        """
        roots = np.concatenate([model.root_poses for model in self._models])
        root_twists = np.zeros((len(roots), 6))
        if self._free:
            pose_of = self._client.getBasePositionAndOrientation
            twist_of = self._client.getBaseVelocity
            centers = np.array([sum(pose_of(n), ()) for n in self._free_numbers])
            twists = np.array([sum(twist_of(n), ()) for n in self._free_numbers])
            poses = compose(centers, self._T_center_root)
            twists[:, :3] += cross(twists[:, 3:], poses[:, :3] - centers[:, :3])
            roots[self._free], root_twists[self._free] = poses, twists
        return roots, root_twists

    @property
    def speed(self) -> float:
        """Largest last read speed of a joint or a root, in [m/s] or [rad/s]."""
        return float(self._speeds.max())

    def stop(self) -> None:
        """Zero the velocities of all models without writing them to PyBullet."""
        for model in self._models:
            model.stop()


def _joined(models: Sequence[Model]) -> tuple[Description, np.ndarray]:
    """Join the trees of many models to one robot.

    Returns:
        The robot, and the rows of the models' links in it, shape (n_links,).
    """
    links: list[Link] = []
    joints: list[Joint] = []
    rows: list[int] = []
    for number, model in enumerate(models):
        scope, one = f"{number}{SCOPE}", model.assembly.description
        # The root comes first, as it does among the roots.
        ordered = sorted(one.links, key=lambda link: link.name != one.root)
        row = {link.name: len(links) + n for n, link in enumerate(ordered)}
        rows += [row[name] for name in model.link_names]
        links += [replace(link, name=scope + link.name) for link in ordered]
        joints += [
            replace(
                joint,
                name=scope + joint.name,
                parent=scope + joint.parent,
                child=scope + joint.child,
            )
            for joint in one.joints
        ]
    forest = Description("forest", links[0].name, tuple(links), tuple(joints))
    return forest, np.array(rows)


def _slices(lengths: Sequence[int]) -> list[slice]:
    """Return the slices of consecutive parts of given lengths."""
    ends = np.cumsum([0, *lengths]).tolist()
    return [slice(begin, end) for begin, end in zip(ends, ends[1:])]
