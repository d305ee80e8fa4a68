"""Controllers as the parameter ~controllers lists them: joints that move together."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from g1_description.errors import InvalidValueError
from g1_description.motion.tolerances import Constraints, read_constraints
from g1_description.text import did_you_mean, listed

KEYS = ("name", "joints", "constraints")

NAME = re.compile(r"[A-Za-z]\w*(/\w+)*", re.ASCII)
"""A namespace."""


@dataclass(frozen=True)
class Controller:
    """Joints of a robot that one action moves."""

    name: str
    """Namespace of its action below that of the robot; empty: the robot's own."""

    joints: tuple[str, ...]

    constraints: Constraints = field(default_factory=Constraints)
    """Tolerances of goals without their own."""


def read_controllers(
    entries: Sequence[Any], joints: Sequence[str], owner: str
) -> tuple[Controller, ...]:
    """Read the controllers of a robot.

    Args:
        entries: The list; if it is empty, one controller has all joints.
        joints: Names of the robot's movable joints.
        owner: Name of the list in messages, in the plural.

    Raises:
        InvalidValueError: If an entry is invalid, or two have the same name or joint.
    """
    found: list[Controller] = []
    for number, entry in enumerate(entries):
        try:
            controller = _controller(entry, joints)
        except InvalidValueError as error:
            raise InvalidValueError(
                f"Entry {number} of the {owner}: {error}."
            ) from error
        for other in found:
            _check_apart(other, controller, owner)
        found.append(controller)
    if joints and not found:
        return (Controller("", tuple(joints)),)
    return tuple(found)


def _controller(entry: Any, joints: Sequence[str]) -> Controller:
    """Read one entry."""
    if not isinstance(entry, dict) or not {*entry} <= {*KEYS}:
        raise InvalidValueError(
            f"must be a dictionary with {listed(KEYS)} (got {entry!r})"
        )
    name = entry.get("name")
    if not isinstance(name, str) or not NAME.fullmatch(name):
        raise InvalidValueError(f"name must be a ROS name (got {name!r})")
    own = _joints(entry.get("joints", joints), joints)
    constraints = read_constraints(entry.get("constraints", {}), own)
    return Controller(name, own, constraints)


def _joints(found: Any, joints: Sequence[str]) -> tuple[str, ...]:
    """Check a list of joints."""
    if not isinstance(found, (list, tuple)) or not found:
        raise InvalidValueError(f"joints must be a list of names (got {found!r})")
    unknown = [name for name in found if name not in joints]
    if unknown:
        near = did_you_mean(str(unknown[0]), joints)
        raise InvalidValueError(f"unknown joint {unknown[0]!r}{near}")
    if len({*found}) < len(found):
        raise InvalidValueError("joints must not repeat a name")
    return tuple(found)


def _check_apart(one: Controller, other: Controller, owner: str) -> None:
    """Check that two controllers differ in name and joints, as in ros_control."""
    if one.name == other.name:
        raise InvalidValueError(f"Two of the {owner} have the name '{one.name}'.")
    shared = [joint for joint in other.joints if joint in one.joints]
    if shared:
        raise InvalidValueError(
            f"Two of the {owner}, {one.name} and {other.name}, both have "
            f"{listed(shared)}; a joint can have only one controller."
        )
