"""The numbers that a robot can have, whatever format its file has."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .errors import LARGEST, DescriptionError


def checked(what: str, numbers: Sequence[float], least: float = -LARGEST) -> np.ndarray:
    """Check that numbers are some that a robot can have.

    Raises:
        DescriptionError: If one is NaN, or out of bounds.
    """
    array = np.array(numbers, dtype=float)
    if not ((array >= least) & (array <= LARGEST)).all():
        raise DescriptionError(
            f"{what[0].upper()}{what[1:]} has the numbers {array.tolist()}, "
            f"not all are from {least:g} to {LARGEST:g}."
        )
    return array


def position_limits(owner: str, lower: float, upper: float) -> tuple[float, float, str]:
    """Take the limits of a joint's position as Gazebo does.

    Its ODE passes over both where the lower one is above the upper one.

    Args:
        owner: The joint, for the words: "joint left_elbow_joint".
        lower: In [rad] or [m], as it is written.
        upper: Likewise.

    Returns:
        Lower and upper limit, and a clause if they are not those that were given.

    Raises:
        DescriptionError: If they leave no position.
    """
    if lower > upper:
        why = f"its lower one, {lower:g}, is above its upper one, {upper:g}"
        return -np.inf, np.inf, f"{owner} has no limits: {why}"
    if not lower <= upper or lower == np.inf or upper == -np.inf:
        raise DescriptionError(
            f"The limits of {owner} are {lower:g} to {upper:g}: no position is left."
        )
    return lower, upper, ""
