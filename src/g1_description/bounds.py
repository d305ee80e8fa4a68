"""Bounds of the numbers that a robot and a port can have, wherever they come from."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from g1_description.errors import DescriptionError

MAX_VALUE = 1e9
"""Largest magnitude accepted for any length, angle, mass or speed."""

NORM_TOLERANCE = 1e-3
"""Largest deviation of a unit quaternion's norm from 1."""

UNIT_TOLERANCE = 1e-12
"""Smaller deviations are kept; larger ones come from rounding."""


def checked(
    label: str, numbers: Sequence[float], least: float = -MAX_VALUE
) -> np.ndarray:
    """Check that numbers are finite and within bounds.

    Args:
        label: The quantity, for the message.
        numbers: The numbers.
        least: Lower bound; the upper one is ``MAX_VALUE``.

    Returns:
        The numbers as an array.

    Raises:
        DescriptionError: If one is NaN, or out of bounds.
    """
    array = np.array(numbers, dtype=float)
    if not ((array >= least) & (array <= MAX_VALUE)).all():
        raise DescriptionError(
            f"{label[0].upper()}{label[1:]} has the numbers {array.tolist()}, "
            f"not all are from {least:g} to {MAX_VALUE:g}."
        )
    return array


def position_limits(owner: str, lower: float, upper: float) -> tuple[float, float, str]:
    """Read the limits of a joint's position as Gazebo does.

    Gazebo's ODE ignores both limits if the lower one is above the upper one.

    Args:
        owner: The joint, for the message: "joint left_elbow".
        lower: In [rad] or [m], as the file has it.
        upper: Likewise.

    Returns:
        Lower and upper limit, and a message if they are not those of the file.

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


def all_usable(lengths: np.ndarray, poses: np.ndarray, twists: np.ndarray) -> bool:
    """Check that the numbers of all links are within bounds; NaN is not.

    Args:
        lengths: Norms of the links' quaternions, shape (n_links,).
        poses: Poses of the links, shape (n_links, 7).
        twists: Twists of the links, shape (n_links, 6).
    """
    if not len(lengths):
        return True
    deviation = np.abs(lengths - 1.0).max()
    largest = np.abs(poses).max(), np.abs(twists).max()
    return bool(
        deviation <= NORM_TOLERANCE
        and largest[0] <= MAX_VALUE
        and largest[1] <= MAX_VALUE
    )


def usable_rows(
    lengths: np.ndarray, poses: np.ndarray, twists: np.ndarray
) -> np.ndarray:
    """Return which links have numbers within bounds, shape (n_links,)."""
    with np.errstate(invalid="ignore"):
        sizes = np.abs(np.concatenate([poses, twists], axis=1)).max(axis=1)
        return (np.abs(lengths - 1.0) <= NORM_TOLERANCE) & (sizes <= MAX_VALUE)
