"""Largest errors of joints, by the rules of joint_trajectory_controller.

A controller has constraints. A goal may ask for other tolerances, joint by joint: a
positive number replaces that of the controller, a negative one stands for none, and
zero keeps the controller's.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from g1_description.bounds import MAX_VALUE
from g1_description.errors import InvalidValueError
from g1_description.text import listed

NUMBERS = ("goal_time", "stopped_velocity_tolerance")
OF_A_JOINT = ("trajectory", "goal")

NOTHING: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True)
class Constraints:
    """Tolerances of a controller. Zero stands for none."""

    trajectory: Mapping[str, float] = field(default_factory=lambda: NOTHING)
    """Largest error of a joint's position on the way, in [rad] or [m], by joint."""

    goal: Mapping[str, float] = field(default_factory=lambda: NOTHING)
    """The same at the end."""

    goal_time: float = 1.0
    """How much later than planned a goal may be reached, in [s]. The controller's
    default is zero, which motors that lag behind hardly ever fulfil."""

    stopped_velocity_tolerance: float = 0.01
    """Largest error of any joint's velocity at the end, in [rad/s] or [m/s]."""


@dataclass(frozen=True)
class JointTolerance:
    """Requested for one joint by a goal: positive, zero or negative, see above."""

    name: str

    position: float = 0.0
    """In [rad] or [m]."""

    velocity: float = 0.0
    """In [rad/s] or [m/s]."""


@dataclass(frozen=True, eq=False)
class Tolerances:
    """Tolerances of one goal. Infinity stands for none."""

    path: np.ndarray
    """Largest errors of positions and velocities on the way, shape (2, n_joints)."""

    goal: np.ndarray
    """The same at the end."""

    goal_time: float
    """How much later than planned the end may be reached, in [s]."""

    @property
    def has_path(self) -> bool:
        """Whether an error on the way may be too large."""
        return bool(np.isfinite(self.path).any())


def read_constraints(found: Any, joints: Sequence[str]) -> Constraints:
    """Read the constraints of a controller, in the form that ros_control uses.

    Args:
        found: A mapping with ``goal_time``, ``stopped_velocity_tolerance``, and
            ``trajectory`` and ``goal`` below the name of a joint; each may be left out.
        joints: Names of the controller's joints.

    Raises:
        InvalidValueError: If there is anything else in it.
    """
    if not isinstance(found, dict):
        raise InvalidValueError(f"constraints are {found!r}, not a dictionary")
    unknown = [str(key) for key in found if key not in (*NUMBERS, *joints)]
    if unknown:
        raise InvalidValueError(
            f"constraints name {listed(unknown)}; there may be {listed(NUMBERS)}, and "
            f"the joints {listed(joints)}"
        )
    numbers = {key: _number(found[key], key) for key in NUMBERS if key in found}
    of_joints: dict[str, dict[str, float]] = {key: {} for key in OF_A_JOINT}
    for joint in joints:
        for key, value in _joint_constraints(found.get(joint, {}), joint).items():
            of_joints[key][joint] = value
    return Constraints(of_joints["trajectory"], of_joints["goal"], **numbers)


def _joint_constraints(found: Any, joint: str) -> dict[str, float]:
    """Read the constraints of one joint."""
    if not isinstance(found, dict) or not {*found} <= {*OF_A_JOINT}:
        raise InvalidValueError(
            f"constraints of {joint} are {found!r}; there may be {listed(OF_A_JOINT)}"
        )
    return {key: _number(value, f"{joint}/{key}") for key, value in found.items()}


def _number(value: Any, what: str) -> float:
    """Check one number."""
    if type(value) not in (int, float) or not 0.0 <= value <= MAX_VALUE:
        raise InvalidValueError(
            f"constraints have {what}: {value!r}, which must be a number from 0 to "
            f"{MAX_VALUE:g}"
        )
    return float(value)


def tolerances_of_goal(
    joint_names: Sequence[str],
    constraints: Constraints,
    path: Iterable[JointTolerance],
    goal: Iterable[JointTolerance],
    goal_time: float,
) -> Tolerances:
    """Apply the tolerances of a goal to the constraints of its controller.

    Args:
        joint_names: Joints of the goal, in the order of the arrays.
        constraints: Tolerances of the controller.
        path: Those of the goal on the way. Other joints are ignored, of equal names
            the last nonzero number counts.
        goal: The same at the end.
        goal_time: How much later than planned the end may be reached, in [s]; zero:
            as the controller has it, negative: not later.

    Raises:
        InvalidValueError: If a number is NaN.
    """
    n_joints = len(joint_names)
    default_path = np.zeros((2, n_joints))
    default_goal = np.zeros((2, n_joints))
    default_path[0] = [constraints.trajectory.get(name, 0.0) for name in joint_names]
    default_goal[0] = [constraints.goal.get(name, 0.0) for name in joint_names]
    default_goal[1] = constraints.stopped_velocity_tolerance
    time = _chosen(constraints.goal_time, goal_time, "goal_time_tolerance")
    return Tolerances(
        _applied(joint_names, default_path, path),
        _applied(joint_names, default_goal, goal),
        time,
    )


def _applied(
    joint_names: Sequence[str], default: np.ndarray, requested: Iterable[JointTolerance]
) -> np.ndarray:
    """Apply requests to zero or positive tolerances, shape (2, n_joints)."""
    column = {name: number for number, name in enumerate(joint_names)}
    found = default.copy()
    for one in requested:
        for row, value in enumerate((one.position, one.velocity)):
            place = row, column.get(one.name, 0)
            chosen = _chosen(found[place], value, f"tolerance of {one.name}")
            if one.name in column:
                found[place] = chosen
    return np.where(found > 0.0, found, np.inf)


def _chosen(default: float, requested: float, what: str) -> float:
    """Choose between a default and a request; zero stands for none."""
    if math.isnan(requested):
        raise InvalidValueError(f"The {what} is NaN.")
    return float(default) if requested == 0.0 else max(requested, 0.0)


def worst_violation(
    joint_names: Sequence[str], errors: np.ndarray, tolerances: np.ndarray
) -> str:
    """Name the joint that exceeds its tolerance most.

    Args:
        joint_names: The joints.
        errors: Errors of positions and velocities, shape (2, n_joints).
        tolerances: The largest errors, positive or infinite, shape (2, n_joints).

    Returns:
        A part of a sentence; empty if none is too large. An error that is NaN is.
    """
    too_large = ~(np.abs(errors) <= tolerances)
    if not too_large.any():
        return ""
    with np.errstate(over="ignore"):
        excess = np.where(too_large, np.abs(errors) / tolerances, 0.0)
    worst = int(np.argmax(np.where(np.isnan(excess), np.inf, excess)))
    row, column = divmod(worst, len(joint_names))
    what = ("position", "velocity")[row]
    return (
        f"{joint_names[column]} is {abs(errors[row, column]):.3g} off its desired "
        f"{what}; {tolerances[row, column]:.3g} is allowed"
    )
