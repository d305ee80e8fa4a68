"""What programs request, checked before the simulator is asked."""

from __future__ import annotations

import operator
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from g1_description.api.joint_values import JointValues, as_array
from g1_description.api.poses import as_poses
from g1_description.core.errors import InvalidValueError

MOST = (1 << 32) - 1
"""The largest count that a message holds."""


def named_positions(
    positions: JointValues | None, joints: Sequence[str]
) -> tuple[tuple[str, ...], list[float]]:
    """Name the joints of positions; those that are not given are not named.

    Args:
        positions: Of all joints as an array, or of some as a dictionary; None: of none.
        joints: Names of the robot's joints.

    Returns:
        Names and positions.

    Raises:
        G1DescriptionError: If they are none of one configuration of this robot.
    """
    if positions is None:
        return (), []
    array = as_array(positions, joints, np.zeros(len(joints)))
    if array.ndim != 1:
        raise InvalidValueError(
            f"Positions of shape {array.shape} are many configurations; the simulator "
            "takes one at a time."
        )
    names = tuple(positions) if isinstance(positions, Mapping) else tuple(joints)
    return names, [float(array[joints.index(name)]) for name in names]


def one_pose(base: Any) -> np.ndarray:
    """Check the pose of a base, shape (7,).

    Raises:
        InvalidValueError: If it is not a single pose.
    """
    pose = as_poses(base)
    if pose.ndim != 1:
        raise InvalidValueError(
            f"A base of shape {pose.shape} is many poses; the simulator takes one at a "
            "time."
        )
    return pose


def count(what: str, number: Any, least: int) -> int:
    """Check a count.

    Raises:
        InvalidValueError: If it is none.
    """
    try:
        found = operator.index(number)
    except TypeError:
        found = -1
    if not least <= found <= MOST:
        raise InvalidValueError(
            f"{what} is {number!r}; it is a whole number from {least} on."
        )
    return found
