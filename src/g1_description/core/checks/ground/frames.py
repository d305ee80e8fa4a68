"""Outlines of links, and where they are above the floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Outline:
    """Points, and a radius about them, whose convex hull is a part of a link."""

    row: int
    """Of the link."""

    points: np.ndarray
    """In the link frame, in [m], shape (k, 3)."""

    radius: float

    @property
    def reach(self) -> float:
        """How far it is from the link's origin at most, in [m]."""
        return float(np.linalg.norm(self.points, axis=1).max()) + self.radius


@dataclass(frozen=True, eq=False)
class LinkHeights:
    """Where links are above the floor, at each of some successive samples.

    Of links that stay away from the floor only heights are kept: of a long motion, more
    would need much memory.
    """

    columns: np.ndarray
    """Links that are ever low enough to bear, or lower than all others: places in
    ``Ground.rows``, shape (k,)."""

    heights: np.ndarray
    """Of the lowest point of each link above the floor, in [m], shape (n, n_links);
    infinite for a link that is neither the lowest one nor near the floor."""

    lowest: np.ndarray
    """The lowest points of the links of ``columns``, in the map, in [m], shape
    (n, k, 3)."""

    slide: np.ndarray
    """How fast their lowest points move along the floor, the mean of those that touch
    it when the link does, in [m/s], shape (n, k)."""


@dataclass(frozen=True, eq=False)
class GroundPiece(LinkHeights):
    """What is known of some of a motion's samples alone.

    Its heights are those of all links with an outline.
    """

    speed: np.ndarray
    """How fast the lowest point moves, in [m/s], shape (n, k)."""

    low: np.ndarray
    """Samples of points that are low enough to bear, and places of their links in
    ``Ground.rows``, shape (2, n_points)."""

    low_points: np.ndarray
    """These points, along the map's x and y, in [m], shape (n_points, 2)."""


@dataclass(frozen=True, eq=False)
class GroundFrames(LinkHeights):
    """How a robot stands, at each sample of a motion.

    Its heights are those of the links of ``columns``.
    """

    bears: np.ndarray
    """Whether a link bears, shape (n, k)."""

    support: list[np.ndarray]
    """Points that bear, along the map's x and y, in [m], shape (n_points, 2) per
    sample."""
