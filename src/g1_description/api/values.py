"""Numbers per joint as programs give them: in the robot's order, or by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Union

import numpy as np

from g1_description.bounds import NORM_TOLERANCE
from g1_description.errors import InvalidValueError, UnknownNameError
from g1_description.motion.trajectory import UNIT_TOLERANCE
from g1_description.robot.rotation import normalized
from g1_description.text import listed, similar_first

JointValues = Union["Mapping[str, Any]", "Sequence[Any]", np.ndarray]
"""A dictionary by joint, or an array in the order of the joints; see ``as_array``."""


def as_array(
    given: JointValues, joints: Sequence[str], rest: np.ndarray, what: str = "position"
) -> np.ndarray:
    """Arrange numbers in the order of a robot's joints.

    Args:
        given: An array of shape (..., n_joints), or a dictionary by joint of numbers or
            arrays of shape (...).
        joints: Names of the robot's movable joints.
        rest: Numbers of the joints that a dictionary does not name, shape (n_joints,).
        what: What the numbers are, for messages.

    Returns:
        A new array, shape (..., n_joints).

    Raises:
        UnknownNameError: If the robot has no joint of a name.
        InvalidValueError: If shapes do not fit, or a number is not finite.
    """
    if isinstance(given, Mapping):
        array = _from_names(given, joints, rest, what)
    else:
        array = _numbers(given, what)
        if array.ndim == 0 or array.shape[-1] != len(joints):
            raise InvalidValueError(
                f"An array of shape {array.shape} is given for each {what}; the last "
                f"axis must be that of the {len(joints)} joints."
            )
    wrong = np.argwhere(~np.isfinite(array))
    if len(wrong):
        first = tuple(wrong[0])
        raise InvalidValueError(
            f"The {what} of {joints[first[-1]]} is {array[first]}, which is no finite "
            "number."
        )
    return array


def check_names(names: Sequence[str], joints: Sequence[str]) -> None:
    """Check that a robot has joints.

    Raises:
        UnknownNameError: If one is missing; the message begins with the nearest names.
    """
    unknown = [name for name in names if name not in joints]
    if unknown:
        known = listed(similar_first(unknown[0], joints)) or "none"
        raise UnknownNameError(
            f"There is no movable joint {listed(unknown)}; there are {known}."
        )


def _from_names(
    given: Mapping[str, Any], joints: Sequence[str], rest: np.ndarray, what: str
) -> np.ndarray:
    """Arrange numbers that are given by name."""
    check_names(list(given), joints)
    columns = [joints.index(name) for name in given]
    values = [_numbers(value, f"{what} of {name}") for name, value in given.items()]
    try:
        rows = np.broadcast_arrays(*values)
    except ValueError as error:
        shapes = listed(f"{name} {v.shape}" for name, v in zip(given, values))
        raise InvalidValueError(
            f"The shapes given for each {what} do not go together: {shapes}."
        ) from error
    array = np.empty((*(rows[0].shape if rows else ()), len(joints)))
    array[...] = rest
    for column, row in zip(columns, rows):
        array[..., column] = row
    return array


def _numbers(given: Any, what: str) -> np.ndarray:
    """Copy what is given into an array of numbers."""
    try:
        return np.array(given, dtype=float)
    except (TypeError, ValueError) as error:
        raise InvalidValueError(
            f"The {what} given is {str(given)[:80]}, which is no array of numbers."
        ) from error


def as_poses(given: Any) -> np.ndarray:
    """Check poses of the base.

    Args:
        given: x y z and quaternion x y z w, shape (..., 7).

    Returns:
        A new array of the same shape, with quaternions of unit length.

    Raises:
        InvalidValueError: If they are no poses.
    """
    try:
        poses = np.array(given, dtype=float)
    except (TypeError, ValueError):
        poses = np.zeros(0)
    if poses.shape[-1:] != (7,) or not np.isfinite(poses).all():
        raise InvalidValueError(
            f"The base given is {str(given)[:80]}; a pose is seven finite numbers, "
            "x y z and quaternion x y z w."
        )
    lengths = np.linalg.norm(poses[..., 3:], axis=-1)
    errors = np.abs(lengths - 1.0)
    if (errors > NORM_TOLERANCE).any():
        raise InvalidValueError(
            "The base has a quaternion of length "
            f"{lengths.flat[int(np.argmax(errors))]:.6g}, not 1."
        )
    rounded = errors > UNIT_TOLERANCE
    poses[rounded, 3:] = normalized(poses[rounded, 3:])
    return poses
