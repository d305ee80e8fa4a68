"""Numbers of joints and poses of the base, as programs give them, checked as arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Union

import numpy as np

from g1_description.bounds import NORM_TOLERANCE, UNIT_TOLERANCE
from g1_description.errors import InvalidValueError, UnknownNameError
from g1_description.robot.rotation import normalized
from g1_description.text import listed, similar_first

JointValues = Union["Mapping[str, Any]", "Sequence[Any]", np.ndarray]
"""A dictionary by joint name, or an array in the order of the joints."""


def as_array(
    given: JointValues,
    joints: Sequence[str],
    rest: np.ndarray,
    label: str = "position",
) -> np.ndarray:
    """Arrange numbers in the order of a robot's joints.

    Args:
        given: An array of shape (..., n_joints), or a dictionary by joint of numbers or
            arrays of shape (...).
        joints: Names of the robot's movable joints.
        rest: Numbers of joints that a dictionary does not contain, shape (n_joints,).
        label: Meaning of the numbers, for messages.

    Returns:
        A new array, shape (..., n_joints).

    Raises:
        UnknownNameError: If a joint is unknown.
        InvalidValueError: If shapes do not fit, or a number is not finite.
    """
    if isinstance(given, Mapping):
        array = _from_names(given, joints, rest, label)
    else:
        array = as_numbers(given, label)
        if array.ndim == 0 or array.shape[-1] != len(joints):
            raise InvalidValueError(
                f"The last axis of the {label} array must have the {len(joints)} "
                f"joints (got shape {array.shape})."
            )
    wrong = np.argwhere(~np.isfinite(array))
    if len(wrong):
        first = tuple(wrong[0])
        raise InvalidValueError(
            f"The {label} of {joints[first[-1]]} must be finite (got {array[first]})."
        )
    return array


def check_names(names: Sequence[str], joints: Sequence[str]) -> None:
    """Check names of joints.

    Raises:
        UnknownNameError: If one is unknown; the message suggests similar names.
    """
    unknown = [name for name in names if name not in joints]
    if unknown:
        known = listed(similar_first(unknown[0], joints)) or "none"
        raise UnknownNameError(
            f"Unknown movable joint {listed(unknown)}. Known joints: {known}."
        )


def _from_names(
    given: Mapping[str, Any], joints: Sequence[str], rest: np.ndarray, label: str
) -> np.ndarray:
    """Arrange numbers that are given by name."""
    check_names(list(given), joints)
    columns = [joints.index(name) for name in given]
    values = [as_numbers(value, f"{label} of {name}") for name, value in given.items()]
    try:
        rows = np.broadcast_arrays(*values)
    except ValueError as error:
        shapes = listed(f"{name} {v.shape}" for name, v in zip(given, values))
        raise InvalidValueError(
            f"The shapes of each {label} do not match: {shapes}."
        ) from error
    array = np.empty((*(rows[0].shape if rows else ()), len(joints)))
    array[...] = rest
    for column, row in zip(columns, rows):
        array[..., column] = row
    return array


def as_numbers(given: Any, label: str) -> np.ndarray:
    """Convert to a new array of numbers."""
    try:
        return np.array(given, dtype=float)
    except (TypeError, ValueError) as error:
        raise InvalidValueError(
            f"The {label} must be an array of numbers (got {str(given)[:80]})."
        ) from error


def as_poses(given: Any, label: str = "base") -> np.ndarray:
    """Check poses.

    Args:
        given: x y z and quaternion x y z w, shape (..., 7).
        label: Name of what has them, for messages.

    Returns:
        A new array of the same shape, with quaternions of unit length.

    Raises:
        InvalidValueError: If they are not poses.
    """
    try:
        poses = np.array(given, dtype=float)
    except (TypeError, ValueError):
        poses = np.zeros(0)
    if poses.shape[-1:] != (7,) or not np.isfinite(poses).all():
        raise InvalidValueError(
            f"The {label} must be seven finite numbers, x y z and quaternion x y z w "
            f"(got {str(given)[:80]})."
        )
    lengths = np.linalg.norm(poses[..., 3:], axis=-1)
    errors = np.abs(lengths - 1.0)
    if (errors > NORM_TOLERANCE).any():
        raise InvalidValueError(
            f"The {label} quaternion must have length 1 (got "
            f"{lengths.flat[int(np.argmax(errors))]:.6g})."
        )
    rounded = errors > UNIT_TOLERANCE
    poses[rounded, 3:] = normalized(poses[rounded, 3:])
    return poses


def named_positions(
    positions: JointValues | None, joints: Sequence[str]
) -> tuple[tuple[str, ...], list[float]]:
    """Convert positions to names and numbers.

    Args:
        positions: An array of all joints, or a dictionary of some; None: no joint.
        joints: Names of the robot's joints.

    Raises:
        G1DescriptionError: If they are not a configuration of this robot.
    """
    if positions is None:
        return (), []
    array = as_array(positions, joints, np.zeros(len(joints)))
    if array.ndim != 1:
        raise InvalidValueError(
            f"Positions must be a single configuration (got shape {array.shape})."
        )
    names = tuple(positions) if isinstance(positions, Mapping) else tuple(joints)
    return names, [float(array[joints.index(name)]) for name in names]


def one_pose(given: Any, label: str = "base") -> np.ndarray:
    """Check a pose, shape (7,).

    Args:
        given: The pose.
        label: Name of what has it, for messages.

    Raises:
        InvalidValueError: If it is not a single pose.
    """
    pose = as_poses(given, label)
    if pose.ndim != 1:
        raise InvalidValueError(
            f"The {label} must be a single pose (got shape {pose.shape})."
        )
    return pose
