"""Where motions and commands want one robot, for the ghost."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from g1_description.core.motion.playlist import Setpoint


class Wanted:
    """What was last wanted of a robot's joints and base; NaN where nothing was."""

    def __init__(self, joint_names: Sequence[str]) -> None:
        """Begin with nothing that is wanted.

        Args:
            joint_names: The robot's movable joints.
        """
        self._row_of = {name: row for row, name in enumerate(joint_names)}
        self.positions = np.full(len(joint_names), np.nan)
        """In [rad] or [m], shape (n_joints,)."""
        self.base_pose = np.full(7, np.nan)
        """Of the root link in the map, shape (7,)."""

    def put(self, setpoint: Setpoint) -> None:
        """Take over what a motion wants."""
        self.positions[setpoint.rows] = setpoint.positions
        if setpoint.base_pose is not None:
            self.base_pose[:] = setpoint.base_pose

    def put_joint(self, name: str, position: float) -> None:
        """Take over a command for one joint, in [rad] or [m]."""
        self.positions[self._row_of[name]] = position

    def put_base(self, pose: np.ndarray | float) -> None:
        """Take over a pose of the root link, shape (7,), or NaN: none is wanted."""
        self.base_pose[:] = pose
