"""Closest or deepest points of pairs of convex shapes.

Shapes that are apart are a quadratic program: the widest gap between parallel planes.
Shapes that overlap least along the normal of a face of one of them, or across an edge
of each: the faces of their Minkowski difference. Most of these are excluded by bounds.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Tuple

import daqp
import numpy as np

from g1_description.collisions.convex_shapes import (
    ConvexShape,
    Separation,
    ShapePairs,
    turn,
)
from g1_description.sim.meshes.hulls import hull_normals

TOUCHING = 1e-6
"""Gap of shapes in [m] up to which the program is solved with the second one moved
away, as if they overlapped."""

MOVED = 1e-3
"""Gap between shapes that were moved apart, in [m]."""

ROUNDING = 1e-9
"""More than all rounding errors of distances, in [m]."""

UNBOUNDED = 1e30
"""Infinity, for the solver."""

OFFSET_WEIGHT = 1e-4
"""Weight of the offset of the planes, whose square the solver must have in its cost."""

TINY = 1e-12
"""Length below which a product of edges has no direction."""

CHUNK = 256
"""Overlapping pairs per chunk; limits memory, and does not affect results."""

_SIDES = np.array([side for side in product((-1.0, 0.0, 1.0), repeat=3) if any(side)])
DIRECTIONS = _SIDES / np.linalg.norm(_SIDES, axis=1, keepdims=True)
"""Directions to all sides, shape (26, 3)."""

SignedDistances = Tuple[np.ndarray, np.ndarray, np.ndarray]
"""Widths of gaps in [m], negative for overlaps, infinite for shapes far apart, shape
(n,); directions from a to b, and points of a in [m], in the frames of a's links, shapes
(n, 3)."""


class ClosestPoints:
    """The shapes of a robot, exactly measured."""

    def __init__(self, shapes: Sequence[ConvexShape], separation: Separation) -> None:
        self._separation = separation
        self._overlaps = PenetrationDirections(shapes, separation)
        self._begin = np.array([shape.points[0] for shape in shapes]).reshape(-1, 3)
        # Rows of the program: those of a are about its first point, which makes the
        # offset of the planes small.
        self._own = [_with_ones(shape.points - shape.points[0]) for shape in shapes]
        self._other = [_with_ones(shape.points) for shape in shapes]

    def distances(self, placed: ShapePairs, reach: float = np.inf) -> SignedDistances:
        """Measure the widest gaps, or the least overlaps.

        Args:
            placed: Pairs of shapes.
            reach: Not needed.
        """
        n = len(placed.a)
        to_rows = np.zeros((n, 4, 4))
        to_rows[:, :3, :3] = -np.swapaxes(placed.axes, 1, 2)
        to_rows[:, 3, :3] = self._begin[placed.a] - placed.origin
        to_rows[:, 3, 3] = -1.0
        pairs = list(zip(placed.a.tolist(), placed.b.tolist(), to_rows))
        found = [_gap(self._own[a], self._other[b].dot(rows)) for a, b, rows in pairs]
        planes, point = np.array(found).reshape(-1, 2, 4).swapaxes(0, 1)
        length = np.sqrt(dot(planes, planes))
        direction = planes[:, :3] / np.maximum(length, TINY)[:, np.newaxis]
        unsure = (length == 0.0) | (length * TOUCHING > 2.0)
        rest = np.flatnonzero(unsure)
        for row, axis in zip(rest.tolist(), self._overlaps.directions(placed[rest])):
            a, b, rows = pairs[row]
            own, end_a = _outermost(self._own[a], axis)
            other, end_b = _outermost(self._other[b].dot(rows), axis)
            other[:, :3] -= (MOVED + end_a + end_b) * axis
            direction[row], point[row] = axis, _gap(own, other)[1]
        place = point[:, :3] / np.maximum(point[:, 3:], TINY) + self._begin[placed.a]
        return measured(self._separation, placed, direction, place)


def measured(
    separation: Separation, placed: ShapePairs, direction: np.ndarray, near: np.ndarray
) -> SignedDistances:
    """Measure gaps along directions.

    Args:
        separation: The shapes.
        placed: Pairs of shapes.
        direction: Unit vectors from a to b, in the frames of a's links, shape (n, 3).
        near: Points in the gaps, in the same frames, in [m], shape (n, 3).
    """
    end_a, end_b = separation.extents(placed, direction)
    point_a = near + (end_a - dot(near, direction))[:, np.newaxis] * direction
    return end_b - end_a, direction, point_a


def _gap(own: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find the widest gap between points.

    Args:
        own: Points of one side, each with a one, shape (n, 4).
        other: Negated points of the other side, each with a minus one, shape (m, 4).

    Returns:
        Normal of the planes, as long as two over the gap, and their offset, shape (4,).
        The closest of the first points times a weight, with the weight, shape (4,).
        Zeros if there is no gap.
    """
    rows = np.concatenate([own, other])
    upper, lower = np.full(len(rows), -1.0), np.full(len(rows), -UNBOUNDED)
    kinds = np.zeros(len(rows), dtype=np.int32)
    planes, _, flag, info = daqp.solve(_COST, _NO_SLOPE, rows, upper, lower, kinds)
    if flag != 1:
        return _NO_SLOPE, _NO_SLOPE
    return planes, info["lam"][: len(own)].dot(own)


_COST = np.diag([1.0, 1.0, 1.0, OFFSET_WEIGHT])
_NO_SLOPE = np.zeros(4)


def _with_ones(points: np.ndarray) -> np.ndarray:
    """Append a column of ones."""
    return np.concatenate([points, np.ones((len(points), 1))], axis=1)


def _outermost(rows: np.ndarray, axis: np.ndarray) -> tuple[np.ndarray, float]:
    """Select the farthest points along a direction; return these and how far."""
    heights = rows[:, :3].dot(axis)
    end = float(heights.max())
    return rows[heights >= end - TOUCHING], end


class PenetrationDirections:
    """Directions in which overlapping shapes come apart soonest."""

    def __init__(self, shapes: Sequence[ConvexShape], separation: Separation) -> None:
        """Prepare the normals of faces, and the edges, sorted by shape and side."""
        self._separation = separation
        normals, edges = zip(*[hull_normals(shape.points) for shape in shapes])
        self._normals = np.concatenate(normals)
        skipped = np.cumsum([0, *map(len, normals)])
        faces = np.concatenate([e + k for e, k in zip(edges, skipped)])
        shape = np.repeat(np.arange(len(shapes)), [len(e) for e in edges])
        first, second = self._normals[faces[:, 0]], self._normals[faces[:, 1]]
        side = ((first + second) @ DIRECTIONS.T).argmax(axis=1)
        group = shape * len(DIRECTIONS) + side
        order = np.argsort(group, kind="stable")
        self._edges, n_groups = faces[order], len(shapes) * len(DIRECTIONS)
        self._count = np.bincount(group, minlength=n_groups)
        self._start = np.cumsum(self._count) - self._count
        angle = np.minimum(dot(first, DIRECTIONS[side]), dot(second, DIRECTIONS[side]))
        cosine = np.ones(n_groups)
        np.minimum.at(cosine, group, angle - ROUNDING)
        cosine = np.maximum(cosine, 0.0).reshape(-1, len(DIRECTIONS))
        self._cosine, self._sine = cosine, np.sqrt(1.0 - cosine**2)
        directions = np.tile(DIRECTIONS, (len(shapes), 1, 1))
        self._support = separation.support_points(np.arange(len(shapes)), directions)

    def directions(self, placed: ShapePairs) -> np.ndarray:
        """Find the directions of the least overlaps.

        Args:
            placed: Pairs of shapes that overlap, or almost.

        Returns:
            Unit vectors from a to b in the frames of a's links, shape (n, 3).
        """
        rows = np.arange(len(placed.a))
        found = [np.zeros((0, 3))]
        for first in range(0, len(rows), CHUNK):
            found.append(self._find(placed[rows[first : first + CHUNK]]))
        return np.concatenate(found)

    def _find(self, placed: ShapePairs) -> np.ndarray:
        n, n_faces = len(placed.a), len(self._normals)
        least, low, row, edge = self._bounds(placed)
        faces = self._edges[edge]
        is_low = low <= least[row % n, np.newaxis]
        key = np.unique((row[:, np.newaxis] * n_faces + faces)[is_low])
        pair = key // n_faces % n
        normals = self._turned(placed, key // n_faces, key % n_faces)
        width = self._widths(placed, pair, normals)
        np.minimum.at(least, pair, ROUNDING - np.minimum(width, 0.0))
        keep = np.flatnonzero(low.min(axis=1) <= least[row % n])
        row, faces = row[keep], faces[keep]
        first = self._turned(placed, row, faces[:, 0])
        second = self._turned(placed, row, faces[:, 1])
        more, across = _across(row, first, second, n)
        width = np.concatenate([width, self._widths(placed, more, across)])
        pair = np.concatenate([pair, more])
        directions = np.concatenate([normals, across])
        widest = np.full(n, -np.inf)
        np.maximum.at(widest, pair, width)
        # The first of equal ones, however they were rounded.
        found = np.flatnonzero(width >= widest[pair] - ROUNDING)
        return directions[found[np.unique(pair[found], return_index=True)[1]]]

    def _bounds(
        self, placed: ShapePairs
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Find the edges across which shapes may come apart soonest.

        Each normal between those of an edge's two faces has at least the smaller of
        their overlaps, as has any point of the Minkowski difference.

        Returns:
            Upper bounds of the least overlaps in [m], shape (n,); lower bounds at both
            faces of an edge, shape (m, 2), rows of pairs, from n on for edges of b, and
            rows of edges, shapes (m,).
        """
        n, swapped = len(placed.a), placed.swapped()
        own = np.concatenate([placed.a, placed.b])
        other = np.concatenate([placed.b, placed.a])
        axes = np.concatenate([placed.axes, swapped.axes])
        origin = np.concatenate([placed.origin, swapped.origin])
        far = self._separation.support_points(other, -(DIRECTIONS @ axes))
        far = far @ np.swapaxes(axes, 1, 2) + origin[:, np.newaxis]
        inside = self._support[own] - far
        along = (inside * DIRECTIONS).sum(axis=2)
        least = along.min(axis=1)
        least = np.maximum(np.minimum(least[:n], least[n:]), 0.0) + ROUNDING
        across = np.sqrt(np.maximum((inside**2).sum(axis=2) - along**2, 0.0))
        low = self._cosine[own] * along - self._sine[own] * across
        row, side = np.nonzero(low <= least[np.arange(2 * n) % n, np.newaxis])
        group = own[row] * len(DIRECTIONS) + side
        count = self._count[group]
        begin = np.cumsum(count) - count
        edge = np.arange(count.sum()) - np.repeat(begin - self._start[group], count)
        seen = np.repeat(inside[row, side], count, axis=0)
        row = np.repeat(row, count)
        faces = self._edges[edge]
        low = np.stack([dot(self._normals[f], seen) for f in faces.T], axis=1)
        keep = np.flatnonzero(low.min(axis=1) <= least[row % n])
        return least, low[keep], row[keep], edge[keep]

    def _turned(
        self, placed: ShapePairs, row: np.ndarray, face: np.ndarray
    ) -> np.ndarray:
        """Turn normals to the frame of a, from a to b."""
        normals = self._normals[face]
        of_b = np.flatnonzero(row >= len(placed.a))
        axes = placed.axes[row[of_b] - len(placed.a)]
        normals[of_b] = -turn(axes, normals[of_b])
        return normals

    def _widths(
        self, placed: ShapePairs, pair: np.ndarray, directions: np.ndarray
    ) -> np.ndarray:
        """Measure gaps without radii, but for rounding."""
        return dot(directions, self._separation.between_ends(placed[pair], directions))


def _across(
    row: np.ndarray, first: np.ndarray, second: np.ndarray, n: int
) -> tuple[np.ndarray, np.ndarray]:
    """Find the directions across an edge of a and an edge of b.

    Such a direction lies between the normals of both faces at either edge.

    Args:
        row: Rows of pairs, from n on for edges of b, shape (m,).
        first: Normals at the edges, in the frame of a, from a to b, shape (m, 3).
        second: The others, shape (m, 3).
        n: Number of pairs.

    Returns:
        Rows of pairs, shape (k,), and unit vectors, shape (k, 3).
    """
    is_b = row >= n
    a, b = np.flatnonzero(~is_b), np.flatnonzero(is_b)
    pair = row % n
    count = np.bincount(pair[b], minlength=n)
    times = count[pair[a]]
    skip = np.cumsum(times) - times - (np.cumsum(count) - count)[pair[a]]
    along = np.cross(first, second)
    one = np.repeat(a, times)
    two = b[np.arange(len(one)) - np.repeat(skip, times)]
    edge = along[two]
    begin, end = dot(edge, first[one]), dot(edge, second[one])
    crossed = np.flatnonzero(begin * end <= 0.0)
    one, two, sign = one[crossed], two[crossed], (begin >= end)[crossed]
    edge = along[one]
    begin, end = dot(edge, first[two]), dot(edge, second[two])
    crossed = (begin * end <= 0.0) & ((end >= begin) == sign)
    one, two, sign = one[crossed], two[crossed], sign[crossed]
    direction = np.cross(along[one], along[two])
    length = np.sqrt(dot(direction, direction))
    is_long = length > TINY
    signed = np.where(sign, length, -length)[is_long, np.newaxis]
    return pair[one[is_long]], direction[is_long] / signed


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Multiply vectors, shape (n, 3) or more columns; shape (n,)."""
    return np.asarray(a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2])
