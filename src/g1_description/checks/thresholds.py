"""Thresholds and parameters of the checks."""

from __future__ import annotations

import operator
import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Level:
    """The thresholds of warnings and failures; None: no threshold."""

    warning: float | None = None
    failure: float | None = None

    @property
    def is_set(self) -> bool:
        """Whether there is any threshold."""
        return self.warning is not None or self.failure is not None


@dataclass(frozen=True)
class JointBounds:
    """Bounds of a derivative of joint positions, which URDF does not have."""

    default: float | None = None
    """For joints that are not in ``joints``; None: no bound."""

    joints: Mapping[str, float] = field(default_factory=dict)

    def of(self, names: tuple[str, ...]) -> np.ndarray:
        """Return the bounds of joints, infinite without a bound."""
        default = np.inf if self.default is None else self.default
        return np.array([self.joints.get(name, default) for name in names], dtype=float)


SIGNS = {"<": operator.lt, ">": operator.gt}


@dataclass(frozen=True)
class Exclusion:
    """A rule that excludes motions by one of their figures."""

    figure: str
    """Name of the figure, such as ``root_speed.max``."""

    sign: str
    """``<`` or ``>``."""

    bound: float

    @property
    def text(self) -> str:
        """The rule as it is written."""
        return f"{self.figure} {self.sign} {self.bound:g}"

    @classmethod
    def parsed(cls, text: str) -> Exclusion | None:
        """Read a rule; None if the text is none."""
        match = re.fullmatch(r"\s*([\w.]+)\s*([<>])\s*([-+.\w]+)\s*", text)
        try:
            return cls(match[1], match[2], float(match[3])) if match else None
        except ValueError:
            return None

    def holds(self, figures: Mapping[str, float]) -> bool:
        """Return whether it excludes a motion; not if it lacks the figure."""
        is_known = self.figure in figures
        return is_known and SIGNS[self.sign](figures[self.figure], self.bound)


@dataclass(frozen=True)
class Thresholds:
    """All thresholds and parameters of the checks.

    The values here are those of ``config/checks.yaml`` as it is shipped.
    """

    levels: Mapping[str, Level] = field(default_factory=dict)
    """By the name of the check; by default the level of its rule."""

    exclusions: tuple[Exclusion, ...] = ()
    """Rules that exclude motions by their figures."""

    acceleration_bounds: JointBounds = JointBounds(1000.0)
    """In [rad/s^2] or [m/s^2]. By default, this and the next are above 99.9 % of the
    samples of published motions of the G1; see docs/performance.md."""

    jerk_bounds: JointBounds = JointBounds(100_000.0)
    """In [rad/s^3] or [m/s^3]."""

    floor_height: float = 0.0
    """Height of the floor in the map, in [m]."""

    contact_height: float = 0.005
    """A link whose lowest point is at most this high touches the floor, in [m]."""

    support_height: float = 0.025
    """A slow foot or hand supports the robot up to this height, in [m]: in motions
    captured from people, feet are seldom exactly on the floor."""

    support_speed: float = 0.1
    """A link is slow if its lowest point is slower than this, in [m/s]."""

    shortest_contact: float = 0.05
    """Shorter contacts are ignored, in [s]."""

    still_speed: float = 0.05
    """A robot is still if its centre of mass is slower than this, in [m/s]."""

    still_acceleration: float = 0.2
    """And accelerates less than this, in [m/s^2]."""

    window: float = 0.1
    """Accelerations are differences over this time before and after, in [s]."""

    longest_interval: float = 0.034
    """A motion is checked at its samples, and at least this often, in [s]: one of 30 Hz
    has no samples added."""
