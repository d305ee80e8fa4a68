"""States of models, read from MuJoCo's arrays."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import mujoco
import numpy as np

from g1_description.robot.rotation import cross, rotate, to_axes
from g1_description.sim.drives import Drives
from g1_description.sim.engine import Steps
from g1_description.sim.model import Model, States
from g1_description.sim.mujoco.drives import JointRows
from g1_description.sim.mujoco.mjcf import WorldFile

XYZW = [1, 2, 3, 0]
"""MuJoCo's quaternions begin with w."""


class ModelRows(JointRows):
    """Where a model is in MuJoCo's arrays."""

    def __init__(
        self, model: Model, bodies: Mapping[str, int], file: WorldFile, compiled: Any
    ) -> None:
        self.model = model
        trees = model.assembly.description.trees
        self.roots = [bodies[tree.root] for tree in trees]
        self.centers = [file.centers[model.name, tree.root] for tree in trees]
        self.bodies = bodies
        joints = [
            compiled.body_jntadr[bodies[joint.child]]
            for joint in model.assembly.description.movable_joints
        ]
        super().__init__(compiled, np.array(joints, dtype=int))

    @property
    def can_move(self) -> bool:
        """Whether it has a joint or a free root."""
        return bool(len(self.position)) or not all(t.fixed for t in self.model.trees)


class Trace:
    """The results of the last steps, which are the first axis of all arrays."""

    def __init__(
        self,
        model: Any,
        qpos: np.ndarray,
        qvel: np.ndarray,
        friction: np.ndarray,
        springs: np.ndarray,
    ) -> None:
        """Keep them.

        Args:
            model: MuJoCo's model.
            qpos: Its positions after the steps, shape (n, nq).
            qvel: Its velocities after them, shape (n, nv).
            friction: Efforts of friction in them, shape (n, nv); those of servos are
                friction.
            springs: Efforts of its actuators in them, shape (n, nu).
        """
        self._model = model
        self.qpos, self.qvel = qpos, qvel
        self._friction, self._springs = friction, springs
        self._read: dict[str, Steps] = {}

    def efforts(self, drives: Drives, rows: ModelRows) -> np.ndarray:
        """Compute the efforts of a model's motors, shape (n, n_joints)."""
        servos, springs = self._friction[:, rows.velocity], self._springs
        efforts = np.where(drives.is_servo, servos, springs[:, rows.actuators])
        return np.minimum(np.maximum(efforts, -drives.limits), drives.limits)

    def steps(self, drives: Drives, rows: ModelRows) -> Steps:
        """Read a model that has drives."""
        model, qpos = rows.model, self.qpos
        if model.name in self._read:
            return self._read[model.name]
        bases = np.repeat(model.root_poses[:1], len(qpos), axis=0)
        if not model.trees[0].fixed:
            at = self._model.jnt_qposadr[self._model.body_jntadr[rows.roots[0]]]
            places, quaternions = qpos[:, at : at + 3], qpos[:, at + 3 : at + 7]
            bases = np.concatenate([places, quaternions[:, XYZW]], axis=1)
            bases[:, :3] -= rotate(bases[:, 3:], rows.centers[0])
        positions, velocities = qpos[:, rows.position], self.qvel[:, rows.velocity]
        found = Steps(positions, velocities, self.efforts(drives, rows), bases)
        self._read[model.name] = found
        return found


class Reader:
    """Reads the states of models.

    Args:
        model: MuJoCo's model.
        data: Its data.
        rows: The models that can move.
    """

    def __init__(self, model: Any, data: Any, rows: Sequence[ModelRows]) -> None:
        self._model, self._data = model, data
        self._view, self._lock = mujoco.MjData(model), threading.Lock()
        self._models = [one.model for one in rows]
        trees = [
            each
            for one in rows
            for each in zip(one.model.trees, one.roots, one.centers)
        ]
        self._free = [row for row, (tree, _, _) in enumerate(trees) if not tree.fixed]
        self._has_fixed = len(self._free) < len(trees)
        self._centers = np.array([trees[row][2] for row in self._free])
        roots = [trees[row][1] for row in self._free]
        joints = model.body_jntadr[roots]
        spread = np.arange(7)
        places = model.jnt_qposadr[joints][:, np.newaxis] + spread
        self._places = places[:, [0, 1, 2, 4, 5, 6, 3]]
        self._speeds = model.jnt_dofadr[joints][:, np.newaxis] + spread[:6]
        no_rows = np.zeros(0, dtype=int)
        self._positions = np.concatenate([no_rows, *(one.position for one in rows)])
        self._velocities = np.concatenate([no_rows, *(one.velocity for one in rows)])
        bodies = [one.bodies[name] for one in rows for name in one.model.link_names]
        self._bodies = np.array(bodies, dtype=int)
        self._trees = model.body_rootid[self._bodies]
        self._root_links = [bodies.index(root) for root in roots]

    def read(self) -> tuple[States, States, Callable[[], States]]:
        """Read roots and joints; return also a function that computes links."""
        qpos, qvel = self._data.qpos.copy(), self._data.qvel.copy()
        roots = qpos[self._places], qvel[self._speeds]
        joints = qpos[self._positions], qvel[self._velocities]
        if self._free:
            # Rotated together: each call of numpy costs more than one rotation.
            poses, twists = roots
            pair = np.stack([twists[:, 3:], self._centers], axis=-1)
            turned = to_axes(poses[:, 3:]) @ pair
            angular, lever = turned[..., 0], turned[..., 1]
            poses[:, :3] -= lever
            twists[:, :3] -= cross(angular, lever)
            twists[:, 3:] = angular
        links = partial(self._links, qpos, qvel, roots)
        if self._has_fixed:
            every = np.concatenate([model.root_poses for model in self._models])
            speeds = np.zeros((len(every), 6))
            every[self._free], speeds[self._free] = roots
            roots = every, speeds
        return roots, joints, links

    def _links(self, qpos: np.ndarray, qvel: np.ndarray, free: States) -> States:
        """Compute poses and twists of all links, from those of free roots, too."""
        with self._lock:
            model, view = self._model, self._view
            view.qpos[:], view.qvel[:] = qpos, qvel
            view.mocap_pos[:] = self._data.mocap_pos
            view.mocap_quat[:] = self._data.mocap_quat
            mujoco.mj_kinematics(model, view)
            mujoco.mj_comPos(model, view)
            mujoco.mj_comVel(model, view)
            places, quaternions = view.xpos[self._bodies], view.xquat[self._bodies]
            spatial = view.cvel[self._bodies]
            centers = view.subtree_com[self._trees]
        poses = np.concatenate([places, quaternions[:, XYZW]], axis=1)
        # Angular first, and of the point at the tree's center of mass.
        angular = spatial[:, :3]
        linear = spatial[:, 3:] + cross(angular, places - centers)
        twists = np.concatenate([linear, angular], axis=1)
        poses[self._root_links], twists[self._root_links] = free
        return poses, twists
