"""Motors of joints: how hard they push, and how closely they follow their targets.

A file maps patterns of joint names to numbers, in YAML. A joint has the numbers of the
first pattern that matches its whole name; what is not given stays at the default.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path

from g1_description.errors import MotorFileError
from g1_description.files.model_files import share_folder
from g1_description.files.yaml import YamlError, finite_number, read_yaml
from g1_description.text import listed

G1_MOTORS = "config/motors.yaml"
"""The motors of the G1 and its revisions, in the package's folder."""


@dataclass(frozen=True)
class Motor:
    """The motor of a joint, by default as PyBullet has it.

    In each step it brings the joint's velocity to

    ``velocity + velocity_gain * (target velocity - velocity)
    + position_gain * (target position - position) / time step``

    with the effort that it takes, gravity and contacts included, unless that is beyond
    its limit.
    """

    effort: float = math.inf
    """Greatest effort in [N m] or [N]; where the robot's file gives a lesser one above
    0, that counts."""

    position_gain: float = 0.1
    """Share of the position's error that it takes back in a step."""

    velocity_gain: float = 1.0
    """Share of the velocity's error that it takes back in a step."""


NAMES = tuple(field.name for field in fields(Motor))


class Motors:
    """The motors of all robots of a world.

    Args:
        motors: By patterns of their joints' names.
        robot: The robot that they are for, a word of its name in lower case; empty: any
            robot.
    """

    def __init__(
        self, motors: Mapping[str, Motor] | None = None, robot: str = ""
    ) -> None:
        patterns = (motors or {}).items()
        self._motors = [(re.compile(pattern), motor) for pattern, motor in patterns]
        self._robot = robot

    def are_for(self, robot: str) -> bool:
        """Return whether they are for a robot, by the name in its description."""
        words = re.split("[^a-z0-9]+", robot.lower())
        return not self._robot or self._robot in words

    def of(self, joint: str) -> Motor:
        """Return the motor of a joint, the default one where no pattern matches."""
        for pattern, motor in self._motors:
            if pattern.fullmatch(joint):
                return motor
        return Motor()


def g1_motors() -> Motors:
    """Read the package's file of motors, which are for the G1 alone.

    Raises:
        MotorFileError: If it cannot be read, or holds something else.
    """
    return read_motors(share_folder() / G1_MOTORS, "g1")


def read_motors(file: Path, robot: str = "") -> Motors:
    """Read a file of motors.

    Args:
        file: The file.
        robot: The robot that they are for, as for ``Motors``.

    Raises:
        MotorFileError: If it cannot be read, or holds something else.
    """
    try:
        content = read_yaml(file) or {}
        if not isinstance(content, dict):
            raise MotorFileError("it must map patterns of joint names to numbers")
        motors = {_pattern(key): _motor(key, content[key]) for key in content}
        return Motors(motors, robot)
    except (YamlError, MotorFileError) as error:
        raise MotorFileError(f"The file of motors {file}: {error}.") from error


def _pattern(key: object) -> str:
    """Check the pattern of an entry."""
    try:
        return re.compile(str(key)).pattern
    except re.error as error:
        raise MotorFileError(f"'{key}' is not a regular expression, {error}") from error


def _motor(key: object, value: object) -> Motor:
    """Read an entry."""
    if not isinstance(value, dict):
        raise MotorFileError(f"'{key}' must have {listed(NAMES)}, not {value!r}")
    unknown = [str(name) for name in value if name not in NAMES]
    if unknown:
        known = listed(NAMES)
        raise MotorFileError(f"'{key}' has {listed(unknown)}; known are {known}")
    return Motor(**{name: _number(key, name, value[name]) for name in value})


def _number(key: object, name: str, value: object) -> float:
    """Check a number of an entry."""
    largest = math.inf if name == "effort" else 1.0
    number = math.inf if value == math.inf else finite_number(value)
    if number is not None and 0.0 <= number <= largest:
        return number
    bounds = "at least 0" if largest == math.inf else "from 0 to 1"
    raise MotorFileError(f"{name} of '{key}' must be a number {bounds}, not {value!r}")
