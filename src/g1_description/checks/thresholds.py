"""What checks call a warning, and what a failure: read from a YAML file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from g1_description.errors import ThresholdError
from g1_description.files.model_files import share_folder
from g1_description.files.yaml import YamlError, finite_number, read_yaml
from g1_description.text import listed, similar_first

DEFAULTS = "config/checks.yaml"
"""The default thresholds, in the package's folder."""


@dataclass(frozen=True)
class Level:
    """How large a fault may be; None: any size."""

    warning: float | None = None
    failure: float | None = None

    def severity(self, size: float) -> tuple[str, float | None]:
        """Compare a size.

        Args:
            size: Of a fault.

        Returns:
            ``failed`` or ``warning``, and the threshold that it exceeds; an empty
            string and None if it exceeds none.
        """
        if self.failure is not None and size > self.failure:
            return "failed", self.failure
        if self.warning is not None and size > self.warning:
            return "warning", self.warning
        return "", None

    @property
    def is_checked(self) -> bool:
        """Whether there is any threshold."""
        return self.warning is not None or self.failure is not None

    @property
    def least(self) -> float:
        """The lower threshold; infinite if there is none."""
        known = [v for v in (self.warning, self.failure) if v is not None]
        return min(known, default=np.inf)


@dataclass(frozen=True)
class JointBounds:
    """Bounds of a derivative of joint positions, which URDF does not have."""

    default: float | None = None
    """For the joints that are not named; None: any value."""

    joints: Mapping[str, float] = field(default_factory=dict)

    def of(self, names: tuple[str, ...]) -> np.ndarray:
        """Return the bounds of joints, infinite where there is none."""
        default = np.inf if self.default is None else self.default
        return np.array([self.joints.get(name, default) for name in names], dtype=float)


@dataclass(frozen=True)
class Thresholds:
    """All thresholds and parameters of the checks.

    The values here are those of ``config/checks.yaml`` as it is shipped.
    """

    position: Level = Level(1e-6, 1e-3)
    """Beyond a position limit, in [rad] or [m]."""

    velocity: Level = Level(None, 1.0)
    """Speed of a joint as a share of its limit."""

    acceleration: Level = Level(None, 1.0)
    """Acceleration of a joint as a share of its bound."""

    jerk: Level = Level(None, 1.0)
    """Jerk of a joint as a share of its bound."""

    effort: Level = Level(0.9, 1.0)
    """Effort of a joint as a share of its limit."""

    jump: Level = Level(0.1, 0.2)
    """Step of a joint that its neighbouring steps do not explain, in [rad] or [m]."""

    base_jump: Level = Level(0.05, 0.1)
    """The same of the base, in [m] or [rad]."""

    self_collision: Level = Level(0.001, 0.005)
    """Depth, in [m]."""

    penetration: Level = Level(0.006, 0.01)
    """Depth below the floor, in [m]."""

    floating: Level = Level(0.015, 0.03)
    """Height above the floor of a robot that does not fall, in [m]."""

    skating: Level = Level(0.08, 0.15)
    """Speed along the floor of a point that bears, in [m/s]."""

    center_of_mass: Level = Level(None, 0.0)
    """Distance outside the support polygon while the robot is still, in [m]."""

    zero_moment_point: Level = Level(0.05, None)
    """Distance outside the support polygon, in [m]."""

    tracking: Level = Level(0.2, None)
    """Distance of joints from where they should be in simulation, in [rad] or [m]."""

    saturation: Level = Level(0.1, None)
    """Share of the time that a motor in simulation spends at its limit."""

    fall: Level = Level(0.0, None)
    """1 if the robot falls in simulation, else 0."""

    acceleration_bounds: JointBounds = field(default_factory=JointBounds)
    """In [rad/s^2] or [m/s^2]."""

    jerk_bounds: JointBounds = field(default_factory=JointBounds)
    """In [rad/s^3] or [m/s^3]."""

    floor_height: float = 0.0
    """Of the floor in the map, in [m]."""

    contact_height: float = 0.005
    """A link touches the floor if its lowest point is at most so high, in [m]."""

    bearing_height: float = 0.025
    """A slow link bears up to this height, in [m]: feet of motions that were recorded
    from people are seldom exactly on the floor."""

    bearing_speed: float = 0.1
    """A link is slow whose lowest point is slower, in [m/s]."""

    shortest_contact: float = 0.05
    """A link bears that does so for so long at least, in [s]."""

    still_speed: float = 0.05
    """A robot is still whose centre of mass is slower, in [m/s]."""

    still_acceleration: float = 0.2
    """A robot is still whose centre of mass accelerates less, in [m/s^2]."""

    window: float = 0.1
    """Accelerations are means over so long before and after a time, in [s]."""

    longest_interval: float = 0.034
    """Checks look at a motion at least so often, in [s]; 30 Hz stays as it is."""


LEVELS = tuple(
    entry.name for entry in fields(Thresholds) if isinstance(entry.default, Level)
)
"""Names of the checks."""

BOUNDS = ("acceleration_bounds", "jerk_bounds")
POSITIVE = ("window", "longest_interval")
"""Parameters that cannot be zero."""


def read_thresholds(file: Path | None = None) -> Thresholds:
    """Read the default thresholds, and those that a YAML file changes.

    Args:
        file: The file; by default ``config/checks.yaml`` alone counts.

    Raises:
        ThresholdError: If a file cannot be read, or holds something else.
    """
    usual = _changed_by(share_folder() / DEFAULTS, Thresholds())
    return usual if file is None else _changed_by(file, usual)


def _changed_by(path: Path, thresholds: Thresholds) -> Thresholds:
    """Change the thresholds that a file names."""
    try:
        content = read_yaml(path)
    except YamlError as error:
        raise ThresholdError(f"{path}: {error}.") from error
    if not isinstance(content, dict):
        raise ThresholdError(f"{path} does not hold thresholds by name.")
    try:
        return with_thresholds(thresholds, content)
    except ThresholdError as error:
        raise ThresholdError(f"{path}: {error}") from error


def with_thresholds(thresholds: Thresholds, content: Mapping[str, Any]) -> Thresholds:
    """Change some thresholds.

    Args:
        thresholds: Those to begin with.
        content: Values by name: of a check ``{warning: NUMBER, failure: NUMBER}``, of
            bounds ``{default: NUMBER, joints: {NAME: NUMBER}}``, else a number; in the
            first two null means any size.

    Raises:
        ThresholdError: If there is no such name, or a value is not of its kind.
    """
    known = [entry.name for entry in fields(Thresholds)]
    unknown = [str(name) for name in content if name not in known]
    if unknown:
        raise ThresholdError(
            f"There is no threshold {unknown[0]}; there are "
            f"{listed(similar_first(unknown[0], known))}."
        )
    changed: dict[str, Any] = {}
    for name, value in content.items():
        if name in LEVELS:
            changed[name] = _level(name, value, getattr(thresholds, name))
        elif name in BOUNDS:
            changed[name] = _bounds(name, value)
        else:
            changed[name] = _number(name, value, None)
            if name != "floor_height" and changed[name] < 0.0:
                raise ThresholdError(f"{name} is {value}; it cannot be negative.")
            if name in POSITIVE and not changed[name] > 0.0:
                raise ThresholdError(f"{name} is {value}; it must be positive.")
    return replace(thresholds, **changed)


def _level(name: str, value: Any, old: Level) -> Level:
    """Read the thresholds of one check; one that is not named stays."""
    parts = _parts(name, value, ("warning", "failure"))
    return replace(
        old, **{part: _optional(f"{name}.{part}", parts[part]) for part in parts}
    )


def _bounds(name: str, value: Any) -> JointBounds:
    """Read bounds of joints."""
    parts = _parts(name, value, ("default", "joints"))
    joints = parts.get("joints") or {}
    if not isinstance(joints, Mapping):
        raise ThresholdError(f"{name}.joints is {joints!r}, not numbers by joint.")
    found = {str(j): _number(f"{name}.joints.{j}", v, None) for j, v in joints.items()}
    default = _optional(f"{name}.default", parts.get("default"))
    if min([*found.values(), default or 1.0]) <= 0.0 or default == 0.0:
        raise ThresholdError(f"{name} has a bound that is not positive.")
    return JointBounds(default, found)


def _parts(name: str, value: Any, wanted: tuple[str, ...]) -> Mapping[str, Any]:
    """Read a mapping with some of the allowed keys."""
    if not isinstance(value, Mapping) or not set(value) <= set(wanted):
        raise ThresholdError(f"{name} is {value!r}, not a mapping of {listed(wanted)}.")
    return value


def _optional(name: str, value: Any) -> float | None:
    """Read a number, or null."""
    return None if value is None else _number(name, value, " or null")


def _number(name: str, value: Any, more: str | None) -> float:
    """Read a finite number."""
    number = finite_number(value)
    if number is None:
        raise ThresholdError(f"{name} is {value!r}, not a number{more or ''}.")
    return number
