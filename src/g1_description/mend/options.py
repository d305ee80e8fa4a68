"""Options of mending."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from math import inf

from g1_description.errors import InvalidValueError
from g1_description.text import listed

FINDINGS = {
    "outliers": ("jump", "base_jump", "velocity", "acceleration", "jerk"),
    "noise": (
        "skating",
        "drift",
        "velocity",
        "acceleration",
        "jerk",
        "effort",
        "contact_forces",
    ),
    "floor": ("penetration", "floating", "contact_forces"),
    "limits": ("position",),
    "feet": ("skating", "drift", "penetration", "floating", "contact_forces"),
    "collisions": ("self_collision",),
    "speed": ("velocity", "acceleration"),
    "balance": ("center_of_mass",),
}
"""What can be mended, and the checks whose findings that removes."""


@dataclass(frozen=True)
class MendOptions:
    """Parts that are mended, and bounds of changes."""

    only: Collection[str] = ()
    """Of ``FINDINGS``; none: all."""

    max_change: float = inf
    """Largest change of a joint in [rad] or [m]."""

    max_base: float = inf
    """Largest change of the base's place in [m]."""

    keep_hands: bool = False
    """Whether the ends of arms keep their paths."""

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            InvalidValueError: If one is out of its range or unknown.
        """
        for name in self.only:
            if name not in FINDINGS:
                raise InvalidValueError(
                    f"'{name}' cannot be fixed; choose of {listed(FINDINGS)}."
                )
        for name in ("max_change", "max_base"):
            if not getattr(self, name) > 0.0:
                raise InvalidValueError(
                    f"{name} must be greater than 0 (got {getattr(self, name)})."
                )
