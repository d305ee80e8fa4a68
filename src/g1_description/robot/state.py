"""The state of a robot: its joints and its base at one time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np


@dataclass(frozen=True, eq=False)
class RobotState:
    """Joints and base of a robot at one time. The arrays must not be changed."""

    stamp: int
    """In [ns]."""

    names: tuple[str, ...]
    """Names of the joints with a known position."""

    positions: np.ndarray
    """Measured, in [rad] or [m], shape (n_joints,)."""

    velocities: np.ndarray | None = None
    """Measured, in [rad/s] or [m/s], shape (n_joints,); None if they are unknown."""

    base_pose: np.ndarray | None = None
    """Pose in the map of the root link, or of the link that floats in the world: x, y,
    z in [m] and quaternion x, y, z, w, shape (7,); None if it is unknown."""

    base_twist: np.ndarray | None = None
    """Linear in [m/s], then angular velocity in [rad/s] of the origin of that link,
    along the axes of the map, shape (6,); None if it is unknown."""

    commanded: Mapping[str, float] = field(default_factory=dict)
    """Commanded positions in [rad] or [m] by joint name, where they are known."""

    commanded_base: np.ndarray | None = None
    """Commanded pose of the base, like ``base_pose``; None if there is none."""

    efforts: np.ndarray | None = None
    """Efforts of the joints' motors in [N m] or [N], shape (n_joints,); None if they
    are unknown."""

    @property
    def time(self) -> float:
        """The stamp in [s]."""
        return 1e-9 * self.stamp

    @cached_property
    def positions_by_name(self) -> dict[str, float]:
        """Measured positions in [rad] or [m] by joint name."""
        return dict(zip(self.names, self.positions.tolist()))

    @property
    def velocities_by_name(self) -> dict[str, float] | None:
        """Measured velocities in [rad/s] or [m/s] by joint name, if they are known."""
        velocities = self.velocities
        return (
            None if velocities is None else dict(zip(self.names, velocities.tolist()))
        )
