"""How a robot stands: what is measured of its links above a floor."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from g1_description.checks.intervals import runs


@dataclass(frozen=True, eq=False)
class GroundPiece:
    """Measurements of a chunk of successive samples.

    To save memory, only heights are kept for links that stay away from the floor.
    """

    columns: np.ndarray
    """Links that are low enough to support the robot, or the lowest ones, in any
    sample: indices into ``Ground.rows``, shape (k,)."""

    heights: np.ndarray
    """Heights of links' lowest points above the floor, in [m], shape (n, n_links);
    infinite for a link that is neither the lowest one nor near the floor."""

    lowest: np.ndarray
    """The lowest points of the links of ``columns``, in the map, in [m], shape
    (n, k, 3)."""

    slide: np.ndarray
    """Speeds of their lowest points along the floor, the mean of those that touch it
    when the link does, in [m/s], shape (n, k)."""

    moves: np.ndarray
    """Their velocities along the map's x and y, the mean of the points that touch the
    floor when the link does, in [m/s], shape (n, k, 2)."""

    steps: np.ndarray
    """How far the mean of these points moves along x and y until the next sample, in
    [m], shape (n, k, 2); NaN at the last sample. Between samples a foot that is held
    goes a little way there and back, which velocities at the samples do not show."""

    speed: np.ndarray
    """Speeds of their lowest points, in [m/s], shape (n, k)."""

    low: np.ndarray
    """For each point low enough to support the robot: its sample, and the index of its
    link into ``Ground.rows``, shape (2, n_points)."""

    low_points: np.ndarray
    """These points in the map, in [m], shape (n_points, 3)."""

    low_heights: np.ndarray
    """Their heights above what is below, in [m], shape (n_points,)."""

    below: np.ndarray | None
    """Rows of the objects below the links of ``columns``, -1 for the floor, shape
    (n, k); None without objects."""

    level: np.ndarray | None
    """Mean height above the floor of what is below the low points, in [m], shape (n,);
    None without objects."""


@dataclass(frozen=True, eq=False)
class GroundSamples:
    """How a robot stands, at each sample of a motion.

    ``columns``, ``lowest``, ``slide``, ``steps``, ``below`` and ``level`` are those of
    a ``GroundPiece``; ``heights`` are those of the links of ``columns``, shape (n, k).
    """

    columns: np.ndarray
    heights: np.ndarray
    lowest: np.ndarray
    slide: np.ndarray
    steps: np.ndarray
    in_contact: np.ndarray
    """Whether a link supports the robot, shape (n, k)."""

    low: np.ndarray
    """For each point low enough to support the robot: its sample, and its link as a
    column of ``heights``, shape (2, n_points); samples rise."""

    low_points: np.ndarray
    """These points in the map, in [m], shape (n_points, 3)."""

    low_heights: np.ndarray
    """Their heights above what is below, in [m], shape (n_points,)."""

    below: np.ndarray | None
    level: np.ndarray | None
    collides: np.ndarray
    """Whether a link goes through what is below it, shape (n, k)."""

    @cached_property
    def support(self) -> list[np.ndarray]:
        """Points of contact along x and y in [m], shape (n_points, 2) per sample."""
        is_support = self.in_contact[self.low[0], self.low[1]]
        rows = np.arange(1, len(self.heights))
        ends = np.searchsorted(self.low[0, is_support], rows)
        return np.split(self.low_points[is_support, :2], ends)


def drifts(steps: np.ndarray, touches: np.ndarray) -> np.ndarray:
    """Compute how far links have moved along the floor since they touched it.

    Args:
        steps: Ways along the floor to the next sample in [m], shape (n, n_links, 2).
        touches: Whether a link touches the floor, shape (n, n_links).

    Returns:
        In [m], NaN where a link does not touch, shape (n, n_links).
    """
    found = np.full(touches.shape, np.nan)
    for column in np.flatnonzero(touches.any(axis=0)):
        for first, last in runs(touches[:, column]):
            found[first, column] = 0.0
            way = np.cumsum(steps[first:last, column], axis=0)
            found[first + 1 : last + 1, column] = np.hypot(*way.T)
    return found
