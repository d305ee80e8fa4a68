"""The world's physics: what gazebo_ros lets a client read and change at run time."""

from __future__ import annotations

from dataclasses import dataclass, fields

from g1_description.bounds import MAX_VALUE
from g1_description.errors import InvalidValueError

MAX_TIME_STEP = 10.0
"""Longest time step in [s]: what Gazebo's dynamic_reconfigure allows."""

GRAVITY = ("gravity_x", "gravity_y", "gravity_z")
"""Names of gravity's numbers."""

_WHOLE_NUMBERS = ("sor_pgs_precon_iters", "sor_pgs_iters", "max_contacts")


@dataclass(frozen=True)
class PhysicsProperties:
    """Numbers of the world and of Gazebo's engine, ODE, in Gazebo's words.

    Of ODE's numbers those take effect that PyBullet knows too: ``sor_pgs_iters``,
    ``erp`` and ``cfm``. The others are kept and read back.
    """

    time_step: float = 0.001
    """Length of a step in [s]; 0: time stands still."""

    max_update_rate: float = 1000.0
    """Steps per second of wall time in [Hz]; 0: as fast as can be."""

    gravity_x: float = 0.0
    gravity_y: float = 0.0
    gravity_z: float = -9.8
    """Gravity along the world's axes in [m/s^2]."""

    auto_disable_bodies: bool = False
    sor_pgs_precon_iters: int = 0
    sor_pgs_iters: int = 50
    sor_pgs_w: float = 1.3
    sor_pgs_rms_error_tol: float = 0.0
    cfm: float = 0.0
    erp: float = 0.2
    contact_surface_layer: float = 0.001
    contact_max_correcting_vel: float = 100.0
    max_contacts: int = 20

    def __post_init__(self) -> None:
        """Check ranges.

        Raises:
            InvalidValueError: If a number is out of its range.
        """
        for field in fields(PhysicsProperties):
            value = getattr(self, field.name)
            low, high = _RANGES.get(field.name, (0.0, MAX_VALUE))
            if not low <= value <= high:
                raise InvalidValueError(
                    f"{field.name} is {value}, it must be from {low:g} to {high:g}"
                )

    @property
    def gravity(self) -> tuple[float, float, float]:
        """Gravity along the world's axes in [m/s^2]."""
        return self.gravity_x, self.gravity_y, self.gravity_z

    @property
    def step_ns(self) -> int:
        """Length of a step in whole [ns]."""
        return round(self.time_step * 1_000_000_000)

    @property
    def period(self) -> float:
        """Wall time from one step to the next in [s]; 0: as short as can be."""
        return 1.0 / self.max_update_rate if self.max_update_rate > 0.0 else 0.0


_RANGES = {
    "time_step": (0.0, MAX_TIME_STEP),
    **dict.fromkeys(GRAVITY, (-MAX_VALUE, MAX_VALUE)),
    "sor_pgs_rms_error_tol": (-1.0, MAX_VALUE),
    **dict.fromkeys(_WHOLE_NUMBERS, (0, 2**32 - 1)),
    "sor_pgs_iters": (0, 1000),
    "cfm": (0.0, 10.0),
    "erp": (0.0, 10.0),
}
"""What the numbers may be; ODE's are as wide as PyBullet bears."""
