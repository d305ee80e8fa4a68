"""How far surfaces are from each other."""

from __future__ import annotations

import math

import numpy as np
import trimesh
from scipy.spatial import cKDTree

COARSE, FINE = 0.05, 0.02
"""Longest edges of the pieces whose middles are compared, and of those among which the
nearest is looked for, as shares of the extent."""

NEAREST = 12
"""Pieces among which the nearest triangle to a point is looked for."""

AT_A_TIME = 2000
"""Points that are compared at a time."""


class Surface:
    """A surface that others are compared with."""

    def __init__(self, triangles: np.ndarray, extent: float) -> None:
        """Prepare for comparisons.

        Args:
            triangles: Corners of its triangles, shape (n, 3, 3).
            extent: About how large it is, in the unit of the corners.
        """
        self.triangles = triangles.astype(float)
        pieces, _ = _pieces(self.triangles, COARSE * extent)
        corners = self.triangles.reshape(-1, 3)
        single, _ = trimesh.grouping.unique_rows(corners)
        self.points = np.concatenate([corners[single], pieces.mean(axis=1)])
        """Corners, and points between them, shape (m, 3)."""
        pieces, self._owners = _pieces(self.triangles, FINE * extent)
        self._tree = cKDTree(pieces.mean(axis=1))

    def farthest(self, points: np.ndarray, limit: float) -> float:
        """Find the largest distance of points from it.

        Args:
            points: Shape (m, 3).
            limit: Where it is more, how much more does not matter.
        """
        count = min(NEAREST, len(self._owners))
        bounds, _ = self._tree.query(points)
        farthest = 0.0
        # Those that can be far come first; the others need not be looked at.
        order = np.argsort(-bounds)
        for some in np.split(order, range(AT_A_TIME, len(order), AT_A_TIME)):
            if farthest > limit or bounds[some[0]] <= farthest:
                break
            _, nearest = self._tree.query(points[some], k=[*range(1, count + 1)])
            near = self.triangles[self._owners[nearest]]
            repeated = np.repeat(points[some], count, axis=0)
            closest = trimesh.triangles.closest_point(near.reshape(-1, 3, 3), repeated)
            distances = np.linalg.norm(closest - repeated, axis=1).reshape(-1, count)
            # A triangle without area has no closest point.
            least = np.fmin(bounds[some], np.fmin.reduce(distances, axis=1))
            farthest = max(farthest, float(least.max()))
        return farthest


def deviation(one: Surface, other: Surface, limit: float = math.inf) -> float:
    """Measure how far two surfaces are apart, seen from both sides.

    Args:
        one: A surface.
        other: Another one.
        limit: Where it is more, how much more does not matter.

    Returns:
        The largest distance of a corner of either, or of a point between corners, to
        the other surface.
    """
    farthest = one.farthest(other.points, limit)
    return (
        farthest
        if farthest > limit
        else max(farthest, other.farthest(one.points, limit))
    )


def _pieces(triangles: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Cut triangles into pieces.

    Args:
        triangles: Corners, shape (n, 3, 3).
        size: Longest edge that a piece may have.

    Returns:
        Corners of the pieces, shape (m, 3, 3), and the triangle that each is of,
        shape (m,).
    """
    pieces, owners = triangles, np.arange(len(triangles))
    done = []
    while len(pieces):
        lengths = np.linalg.norm(pieces - np.roll(pieces, -1, axis=1), axis=2)
        is_long = lengths.max(axis=1) > size
        done.append((pieces[~is_long], owners[~is_long]))
        # Each is cut in two, in the middle of its longest edge.
        turns = (lengths[is_long].argmax(axis=1)[:, None] + np.arange(3)) % 3
        turned = np.take_along_axis(pieces[is_long], turns[:, :, None], axis=1)
        a, b, c = np.swapaxes(turned, 0, 1)
        middle = (a + b) / 2.0
        halves = [np.stack(half, axis=1) for half in ((a, middle, c), (middle, b, c))]
        pieces, owners = np.concatenate(halves), np.concatenate([owners[is_long]] * 2)
    return tuple(np.concatenate(arrays) for arrays in zip(*done))
