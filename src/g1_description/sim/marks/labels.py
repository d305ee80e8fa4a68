"""Where texts stand beside the robot, so that one can read them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from g1_description.core.rotation import rotate

from .canvas import Color

SIZE = 0.03
"""Height of the texts, in [m]."""

WIDTH = 0.5
"""Of a character, as a share of its height."""

REACH = 0.36
"""How far beside the middle of the robot texts begin, in [m]."""

SPACING = 1.4
"""Least difference in height of texts on one side of the robot, in heights."""


@dataclass(frozen=True, eq=False)
class Label:
    """A text about a point of the robot."""

    point: np.ndarray
    """In [m], shape (3,)."""

    text: str
    color: Color


def places(
    labels: Sequence[Label], base: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Find places for texts: to the left or right of the robot, one above the other.

    Args:
        labels: The texts.
        base: Pose of the robot's root link, shape (7,).

    Returns:
        Where each begins, and its middle, in [m], shapes (3,).
    """
    left = rotate(base[3:], np.array([0.0, 1.0, 0.0]))
    left[2] = 0.0
    left /= max(float(np.linalg.norm(left)), 1e-6)
    sides = [float((label.point - base[:3]) @ left) >= 0.0 for label in labels]
    heights = np.array([float(label.point[2]) for label in labels])
    for side in (False, True):
        rows = [row for row in np.argsort(heights) if sides[row] == side]
        for lower, row in zip(rows, rows[1:]):
            heights[row] = max(heights[row], heights[lower] + SPACING * SIZE)
    found = []
    for label, side, height in zip(labels, sides, heights):
        away = left[:2] if side else -left[:2]
        half = 0.5 * WIDTH * SIZE * len(label.text)
        begin, middle = base[:2] + REACH * away, base[:2] + (REACH + half) * away
        found.append((np.append(begin, height), np.append(middle, height)))
    return found


def short_name(name: str) -> str:
    """Leave out what ends the names of most links or joints."""
    for ending in ("_link", "_joint"):
        if name.endswith(ending):
            return name[: -len(ending)]
    return name
