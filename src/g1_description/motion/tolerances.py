"""Largest errors of joints, by the rules of joint_trajectory_controller.

A controller has constraints. A goal may override them per joint: a positive number
replaces the controller's, a negative one means no tolerance, and zero keeps the
controller's.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from g1_description.bounds import MAX_VALUE
from g1_description.errors import InvalidValueError
from g1_description.text import listed

NUMBERS = ("goal_time", "stopped_velocity_tolerance")
OF_A_JOINT = ("trajectory", "goal")


@dataclass(frozen=True)
class Constraints:
    """Tolerances of a controller; zero means no tolerance."""

    trajectory: Mapping[str, float] = field(default_factory=dict)
    """Largest position error during the motion, in [rad] or [m], by joint."""

    goal: Mapping[str, float] = field(default_factory=dict)
    """Largest position error at the end, in [rad] or [m], by joint."""

    goal_time: float = 1.0
    """Allowed delay of a goal, in [s]. ros_controllers' default is zero, which lagging
    motors hardly ever meet."""

    stopped_velocity_tolerance: float = 0.01
    """Largest velocity error of any joint at the end, in [rad/s] or [m/s]."""


@dataclass(frozen=True)
class JointTolerance:
    """Tolerance of a goal for one joint: positive, zero or negative, see above."""

    name: str

    position: float = 0.0
    """In [rad] or [m]."""

    velocity: float = 0.0
    """In [rad/s] or [m/s]."""


@dataclass(frozen=True, eq=False)
class Tolerances:
    """Tolerances of one goal; infinity means no tolerance."""

    path: np.ndarray
    """Largest position and velocity errors during the motion, shape (2, n_joints)."""

    goal: np.ndarray
    """Largest errors at the end, shape (2, n_joints)."""

    goal_time: float
    """Allowed delay of the end, in [s]."""

    @property
    def has_path(self) -> bool:
        """Whether there is any path tolerance."""
        return bool(np.isfinite(self.path).any())


def read_constraints(found: Any, joints: Sequence[str]) -> Constraints:
    """Read the constraints of a controller, in the format of ros_control.

    Args:
        found: A mapping with ``goal_time``, ``stopped_velocity_tolerance``, and
            ``trajectory`` and ``goal`` below the name of a joint; all optional.
        joints: Names of the controller's joints.

    Raises:
        InvalidValueError: If it has other keys or invalid values.
    """
    if not isinstance(found, dict):
        raise InvalidValueError(f"constraints must be a dictionary (got {found!r})")
    unknown = [str(key) for key in found if key not in (*NUMBERS, *joints)]
    if unknown:
        raise InvalidValueError(
            f"unknown key {listed(unknown)} in constraints. Known keys: "
            f"{listed(NUMBERS)}, and the joints {listed(joints)}"
        )
    numbers = {key: _number(found[key], key) for key in NUMBERS if key in found}
    of_joints: dict[str, dict[str, float]] = {key: {} for key in OF_A_JOINT}
    for joint in joints:
        own = found.get(joint, {})
        if not isinstance(own, dict) or not {*own} <= {*OF_A_JOINT}:
            raise InvalidValueError(
                f"constraints of {joint} must have only {listed(OF_A_JOINT)} (got "
                f"{own!r})"
            )
        for key, value in own.items():
            of_joints[key][joint] = _number(value, f"{joint}/{key}")
    return Constraints(of_joints["trajectory"], of_joints["goal"], **numbers)


def _number(value: Any, label: str) -> float:
    """Check one number."""
    if type(value) not in (int, float) or not 0.0 <= value <= MAX_VALUE:
        raise InvalidValueError(
            f"constraint {label} must be a number from 0 to {MAX_VALUE:g} (got "
            f"{value!r})"
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
        path: Path tolerances of the goal. Unknown joints are ignored; of equal names,
            the last nonzero number applies.
        goal: Goal tolerances of the goal.
        goal_time: Allowed delay of the end, in [s]; zero: the controller's, negative:
            none.

    Raises:
        InvalidValueError: If a number is NaN.
    """
    default_path, default_goal = np.zeros((2, 2, len(joint_names)))
    default_path[0] = [constraints.trajectory.get(name, 0.0) for name in joint_names]
    default_goal[0] = [constraints.goal.get(name, 0.0) for name in joint_names]
    default_goal[1] = constraints.stopped_velocity_tolerance
    return Tolerances(
        _applied(joint_names, default_path, path),
        _applied(joint_names, default_goal, goal),
        _chosen(constraints.goal_time, goal_time, "goal_time_tolerance"),
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


def _chosen(default: float, requested: float, label: str) -> float:
    """Choose between a default and a request; zero means the default."""
    if math.isnan(requested):
        raise InvalidValueError(f"The {label} must not be NaN.")
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
        A clause; empty if no error is too large. NaN is too large.
    """
    too_large = ~(np.abs(errors) <= tolerances)
    if not too_large.any():
        return ""
    with np.errstate(over="ignore"):
        excess = np.where(too_large, np.abs(errors) / tolerances, 0.0)
    worst = int(np.argmax(np.where(np.isnan(excess), np.inf, excess)))
    row, column = divmod(worst, len(joint_names))
    quantity = ("position", "velocity")[row]
    return (
        f"{joint_names[column]} is {abs(errors[row, column]):.3g} off its desired "
        f"{quantity} (tolerance {tolerances[row, column]:.3g})"
    )
