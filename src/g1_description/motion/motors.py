"""Motors of joints: effort limits, and gains with which they follow targets.

A file maps patterns of joint names to a kind of motor and its numbers, in YAML. The
first pattern that matches a joint's whole name applies; missing numbers have their
defaults.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Union

from g1_description.errors import MotorFileError, NoSuchMotorsError
from g1_description.files.yaml import YamlError, finite_number, read_yaml
from g1_description.robot.description import Description
from g1_description.robot.profile import Profile
from g1_description.text import listed


@dataclass(frozen=True)
class ServoMotor:
    """A motor that brings its joint to a velocity, by default that of PyBullet.

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


@dataclass(frozen=True)
class PdMotor:
    """A motor whose controller is a spring and a damper, as on the robot.

    Its effort, up to its limit, is

    ``stiffness * (target position - position)
    + damping * (target velocity - velocity)``

    and the joint keeps the friction and damping of its file.
    """

    effort: float = math.inf
    """As of ``ServoMotor``."""

    stiffness: float = 0.0
    """In [N m/rad] or [N/m]."""

    damping: float = 0.0
    """In [N m s/rad] or [N s/m]."""

    armature: float = 0.0
    """Inertia of the rotor behind its gear, in [kg m^2] or [kg]."""


Motor = Union[ServoMotor, PdMotor]

KINDS: Mapping[str, type[Motor]] = {"servo": ServoMotor, "pd": PdMotor}
"""Classes by the ``kind`` of an entry; the first one is the default."""

LARGEST = {"position_gain": 1.0, "velocity_gain": 1.0}
"""Bounds of numbers; the others have none."""


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
        return ServoMotor()

    def unlimited(self) -> Motors:
        """Return the same motors without limits of effort."""
        found = Motors()
        found._motors = [(p, replace(m, effort=math.inf)) for p, m in self._motors]
        return found

    def unused(self, joints: Iterable[str]) -> list[str]:
        """Return the patterns that match none of some joints."""
        names = [*joints]
        patterns = [pattern for pattern, _ in self._motors]
        return [p.pattern for p in patterns if not any(map(p.fullmatch, names))]


def motors_of(robot: Description, name: str = "") -> Motors:
    """Read motors of a robot's profile; without one, they are as in its URDF.

    Args:
        robot: The robot.
        name: Which of its motors; empty: the usual ones.

    Raises:
        NoSuchMotorsError: If there are no motors of that name.
        MotorFileError: If the file cannot be read or is invalid.
    """
    file = named_motors(robot.profile, name) if name else robot.profile.motors
    return read_motors(file) if file else Motors()


def named_motors(profile: Profile, name: str) -> Path:
    """Find the file of a profile's motors ``name``, beside that of its usual ones.

    Raises:
        NoSuchMotorsError: If there is none.
    """
    usual, files = profile.motors, {}
    if usual is not None:
        found = usual.parent.glob(f"{usual.stem}_*{usual.suffix}")
        files = {file.stem[len(usual.stem) + 1 :]: file for file in sorted(found)}
    if name in files:
        return files[name]
    owner = f"The profile {profile.name}" if profile.name else "A robot without profile"
    known = listed(files) if files else "the usual ones"
    raise NoSuchMotorsError(f"{owner} has no motors '{name}'. Known motors: {known}.")


def read_motors(file: Path) -> Motors:
    """Read a file of motors.

    Raises:
        MotorFileError: If it cannot be read or is invalid.
    """
    try:
        content = read_yaml(file) or {}
        if not isinstance(content, dict):
            raise MotorFileError("it must map patterns of joint names to numbers")
        return Motors({str(key): _motor(key, content[key]) for key in content})
    except (YamlError, MotorFileError) as error:
        raise MotorFileError(f"The file of motors {file}: {error}.") from error


def _motor(key: object, value: object) -> Motor:
    """Read an entry."""
    try:
        re.compile(str(key))
    except re.error as error:
        raise MotorFileError(f"'{key}' is not a regular expression: {error}") from error
    if not isinstance(value, dict):
        names = [field.name for kind in KINDS.values() for field in fields(kind)]
        raise MotorFileError(
            f"'{key}' must map some of {listed(['kind', *names])} to their values (got "
            f"{value!r})"
        )
    numbers = dict(value)
    kind = str(numbers.pop("kind", "servo"))
    if kind not in KINDS:
        known = listed(KINDS)
        raise MotorFileError(f"the kind of '{key}' must be one of {known} (got {kind})")
    names = [field.name for field in fields(KINDS[kind])]
    unknown = [str(name) for name in numbers if name not in names]
    if unknown:
        known = listed(["kind", *names])
        raise MotorFileError(
            f"unknown key {listed(unknown)} of '{key}', which is of kind {kind}. Known "
            f"keys: {known}"
        )
    given = {name: _number(key, name, number) for name, number in numbers.items()}
    return KINDS[kind](**given)


def _number(key: object, name: str, value: object) -> float:
    """Check a number of an entry."""
    largest = LARGEST.get(name, math.inf)
    is_endless = name == "effort" and value == math.inf
    number = math.inf if is_endless else finite_number(value)
    if number is not None and 0.0 <= number <= largest:
        return number
    bounds = "at least 0" if largest == math.inf else "from 0 to 1"
    raise MotorFileError(f"{name} of '{key}' must be a number {bounds} (got {value!r})")
