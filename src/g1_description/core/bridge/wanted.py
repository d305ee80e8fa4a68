"""Where motions and commands want one robot, held against what is measured."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from g1_description.core.motion.playlist import Setpoint

from .estimator import Observation

ROUNDING = 1e-12
"""Largest difference in [rad], [m] and their rates between what was measured and what
is wanted that counts as rounding."""


class Wanted:
    """What was last wanted of a robot's joints and base; NaN where nothing was."""

    def __init__(self, joint_names: Sequence[str]) -> None:
        """Begin with nothing that is wanted.

        Args:
            joint_names: The robot's movable joints.
        """
        n = len(joint_names)
        self._row_of = {name: row for row, name in enumerate(joint_names)}
        self._numbers = np.full(2 * n + 7, np.nan)
        self.positions = self._numbers[:n]
        """In [rad] or [m], shape (n_joints,)."""
        self.velocities = self._numbers[n : 2 * n]
        """In [rad/s] or [m/s], shape (n_joints,)."""
        self.base_pose = self._numbers[2 * n :]
        """Of the root link in the map, shape (7,)."""
        self._measured_names: tuple[str, ...] = ()
        self._places = np.arange(2 * n, 2 * n + 7)
        self._target: np.ndarray | None = None

    def put(self, setpoint: Setpoint) -> None:
        """Take over what a motion wants."""
        self._target = None
        self.positions[setpoint.rows] = setpoint.positions
        self.velocities[setpoint.rows] = setpoint.velocities
        if setpoint.base_pose is not None:
            self.base_pose[:] = setpoint.base_pose

    def put_at_rest(self, name: str, position: float) -> None:
        """Take over a command for one joint, in [rad] or [m]."""
        self._target = None
        row = self._row_of[name]
        self.positions[row], self.velocities[row] = position, 0.0

    def put_base(self, pose: np.ndarray | float) -> None:
        """Take over a pose of the root link, shape (7,), or NaN: none is wanted."""
        self._target = None
        self.base_pose[:] = pose

    def without_rounding(self, seen: Observation) -> Observation:
        """Replace what was measured by what is wanted, where only rounding differs."""
        if seen.names is not self._measured_names:
            self._find(seen.names)
        if self._target is None:
            # Nothing is as far away as where nothing is wanted.
            found = self._numbers[self._places]
            self._target = np.where(np.isnan(found), np.inf, found)
        n, base, target = len(seen.names), seen.base_pose, self._target
        if base is None:
            measured, target = [seen.position, seen.velocity], target[: 2 * n]
        else:
            measured = [seen.position, seen.velocity, base]
        numbers = np.concatenate(measured)
        is_near = np.abs(numbers - target) <= ROUNDING
        numbers = np.where(is_near, target, numbers)
        return seen._replace(
            position=numbers[:n],
            velocity=numbers[n : 2 * n],
            base_pose=None if base is None else numbers[2 * n :],
        )

    def _find(self, names: tuple[str, ...]) -> None:
        """Find measured joints among the robot's."""
        n = len(self.positions)
        rows = np.array([self._row_of[name] for name in names], dtype=int)
        self._places = np.concatenate([rows, n + rows, np.arange(2 * n, 2 * n + 7)])
        self._measured_names, self._target = names, None
