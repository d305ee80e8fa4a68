"""Motors of joints: effort limits, and gains with which they follow targets.

A file maps patterns of joint names to numbers, in YAML. The first pattern that matches
a joint's whole name applies; missing numbers have their defaults.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path

from g1_description.errors import MotorFileError
from g1_description.files.yaml import YamlError, finite_number, read_yaml
from g1_description.robot.description import Description
from g1_description.text import listed


@dataclass(frozen=True)
class Motor:
    """The motor of a joint, by default that of PyBullet.

    In each step it brings the joint's velocity to

    ``velocity + velocity_gain * (target velocity - velocity)
    + position_gain * (target position - position) / time step``

    with the necessary effort, gravity and contacts included, up to its limit.
    """

    effort: float = math.inf
    """Largest effort in [N m] or [N]; a smaller positive limit in the URDF takes
    precedence."""

    position_gain: float = 0.1
    """Fraction of the position error that is corrected in a step."""

    velocity_gain: float = 1.0
    """Fraction of the velocity error that is corrected in a step."""


NAMES = tuple(field.name for field in fields(Motor))


class Motors:
    """The motors of a robot.

    Args:
        motors: By patterns of joint names.
    """

    def __init__(self, motors: Mapping[str, Motor] | None = None) -> None:
        patterns = (motors or {}).items()
        self._motors = [(re.compile(pattern), motor) for pattern, motor in patterns]

    def of(self, joint: str) -> Motor:
        """Return the motor of a joint, by default that of PyBullet."""
        for pattern, motor in self._motors:
            if pattern.fullmatch(joint):
                return motor
        return Motor()


def motors_of(robot: Description) -> Motors:
    """Read the motors of a robot's profile; without one, they are as in its URDF.

    Raises:
        MotorFileError: If the file cannot be read or is invalid.
    """
    file = robot.profile.motors
    return read_motors(file) if file else Motors()


def read_motors(file: Path) -> Motors:
    """Read a file of motors.

    Raises:
        MotorFileError: If it cannot be read or is invalid.
    """
    try:
        content = read_yaml(file) or {}
        if not isinstance(content, dict):
            raise MotorFileError("it must map patterns of joint names to numbers")
        motors = {_pattern(key): _motor(key, content[key]) for key in content}
        return Motors(motors)
    except (YamlError, MotorFileError) as error:
        raise MotorFileError(f"The file of motors {file}: {error}.") from error


def _pattern(key: object) -> str:
    """Check the pattern of an entry."""
    try:
        return re.compile(str(key)).pattern
    except re.error as error:
        raise MotorFileError(f"'{key}' is not a regular expression: {error}") from error


def _motor(key: object, value: object) -> Motor:
    """Read an entry."""
    if not isinstance(value, dict):
        raise MotorFileError(
            f"'{key}' must map {listed(NAMES)} to numbers (got {value!r})"
        )
    unknown = [str(name) for name in value if name not in NAMES]
    if unknown:
        known = listed(NAMES)
        raise MotorFileError(
            f"unknown key {listed(unknown)} of '{key}'. Known keys: {known}"
        )
    return Motor(**{name: _number(key, name, value[name]) for name in value})


def _number(key: object, name: str, value: object) -> float:
    """Check a number of an entry."""
    largest = math.inf if name == "effort" else 1.0
    number = math.inf if value == math.inf else finite_number(value)
    if number is not None and 0.0 <= number <= largest:
        return number
    bounds = "at least 0" if largest == math.inf else "from 0 to 1"
    raise MotorFileError(f"{name} of '{key}' must be a number {bounds} (got {value!r})")
