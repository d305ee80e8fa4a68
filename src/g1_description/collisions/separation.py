"""Planes between convex shapes: how wide a gap there is along a direction."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from g1_description.collisions.convex_shapes import ConvexShape, Placed, turn
from g1_description.sim.meshes.hulls import hull_normals

ROUNDS = 4
"""How often a direction is improved: what is not separated then mostly collides."""

FEW = 32
"""Up to so many directions are asked for together: it costs more memory, not time."""

TINY = 1e-12
"""Shortest vector that has a direction, in [m]."""


class Separation:
    """Gaps between the shapes of a robot."""

    def __init__(self, shapes: Sequence[ConvexShape]) -> None:
        self._shapes = shapes
        self._radius = np.array([shape.radius for shape in shapes])
        middles = [(s.points.min(axis=0) + s.points.max(axis=0)) / 2 for s in shapes]
        self._middle = np.array(middles).reshape(-1, 3)
        self._padded = _padded([shape.points for shape in shapes])
        self._normals = [hull_normals(shape.points) for shape in shapes]

    def apart(self, placed: Placed, gap: float) -> np.ndarray:
        """Find pairs that a plane separates, by their farthest points.

        The search is that of Chung and Wang (1996): a direction along which the shapes
        overlap is reflected by the direction between their farthest points.

        Args:
            placed: Pairs of shapes.
            gap: How wide the gap must be, in [m].

        Returns:
            Whether such a plane was found, shape (n,).
        """
        found = np.zeros(len(placed.a), dtype=bool)
        rows, direction = np.arange(len(placed.a)), self.between_middles(placed)
        for _ in range(ROUNDS):
            if not len(rows):
                break
            way = self._way(placed, direction)
            radii = self._radius[placed.a] + self._radius[placed.b]
            is_apart = (direction * way).sum(axis=1) - radii > gap
            found[rows[is_apart]] = True
            left = np.flatnonzero(~is_apart)
            rows, placed = rows[left], placed[left]
            way, direction = _unit(way[left]), direction[left]
            turned = np.minimum((direction * way).sum(axis=1, keepdims=True), 0.0)
            direction = _unit(direction - 2.0 * turned * way)
        return found

    def _way(self, placed: Placed, direction: np.ndarray) -> np.ndarray:
        """Find the way from the farthest point of a along directions to the first of b.

        Args:
            placed: Pairs of shapes.
            direction: Unit vectors in the frames of a, shape (n, 3).

        Returns:
            Ways in the frames of a, in [m], shape (n, 3).
        """
        backwards = -(direction[:, np.newaxis] @ placed.axes)[:, 0]
        end_a = self._per_shape(placed.a, direction, _farthest)
        end_b = self._per_shape(placed.b, backwards, _farthest)
        return (placed.axes @ end_b[:, :, np.newaxis])[..., 0] + placed.origin - end_a

    def between_middles(self, placed: Placed) -> np.ndarray:
        """Give the directions from the middles of shapes to those of others.

        Returns:
            Unit vectors in the frames of a, shape (n, 3).
        """
        middle_b = turn(placed.axes, self._middle[placed.b]) + placed.origin
        return _unit(middle_b - self._middle[placed.a])

    def normals(self, placed: Placed, row: int) -> np.ndarray:
        """Give the normals of all faces of a pair, those of b turned around.

        Returns:
            Unit vectors in the frame of a, shape (n, 3).
        """
        of_a = self._normals[placed.a[row]]
        of_b = self._normals[placed.b[row]]
        return np.concatenate([of_a, -turn(placed.axes[[row] * len(of_b)], of_b)])

    def faces(
        self, placed: Placed, direction: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Find where shapes end along directions.

        Args:
            placed: Pairs of shapes.
            direction: Unit vectors from a to b, in the frames of a, shape (n, 3).

        Returns:
            How far a reaches, and where b begins, along the direction from the origin
            of a's frame, in [m], shapes (n,). What lies between is a gap for certain;
            where b begins before a ends, that is how far they overlap.
        """
        backwards = -turn(np.swapaxes(placed.axes, 1, 2), direction)
        end_a = self._per_shape(placed.a, direction, _reach)[:, 0]
        end_b = self._per_shape(placed.b, backwards, _reach)[:, 0]
        x, y, z = (placed.origin * direction).T
        return (
            end_a + self._radius[placed.a],
            x + y + z - end_b - self._radius[placed.b],
        )

    def _per_shape(
        self,
        which: np.ndarray,
        directions: np.ndarray,
        function: Callable[[ConvexShape, np.ndarray], np.ndarray],
    ) -> np.ndarray:
        """Ask each shape for all of its directions at once, shape (n, 3) or (n, 1)."""
        if len(which) <= FEW:
            return self._per_row(which, directions, function is _farthest)
        order = np.argsort(which, kind="stable")
        shapes, first = np.unique(which[order], return_index=True)
        result = np.zeros((len(which), 3 if function is _farthest else 1))
        for shape, rows in zip(shapes.tolist(), np.split(order, first[1:])):
            result[rows] = function(self._shapes[shape], directions[rows])
        return result

    def _per_row(
        self, which: np.ndarray, directions: np.ndarray, is_farthest: bool
    ) -> np.ndarray:
        """Do the same for few directions: one array of all their shapes' points."""
        points = self._padded[which]
        x, y, z = directions.T[:, :, np.newaxis]
        along = x * points[..., 0] + y * points[..., 1] + z * points[..., 2]
        if is_farthest:
            return np.asarray(points[np.arange(len(which)), along.argmax(axis=1)])
        return np.asarray(along.max(axis=1, keepdims=True))


def _farthest(shape: ConvexShape, directions: np.ndarray) -> np.ndarray:
    """Find the farthest of the points of a shape, shape (n, 3)."""
    return shape.points[(directions @ shape.points.T).argmax(axis=1)]


def _padded(points: Sequence[np.ndarray]) -> np.ndarray:
    """Repeat the first of each shape's points until all have as many, (n, k, 3)."""
    most = max((len(rows) for rows in points), default=0)
    parts = [np.concatenate([r, np.repeat(r[:1], most - len(r), 0)]) for r in points]
    return np.array(parts).reshape(len(points), most, 3)


def _reach(shape: ConvexShape, directions: np.ndarray) -> np.ndarray:
    """Find how far the points of a shape reach along directions, shape (n, 1)."""
    x, y, z = directions.T[:, :, np.newaxis]
    along = x * shape.points[:, 0] + y * shape.points[:, 1] + z * shape.points[:, 2]
    return along.max(axis=1, keepdims=True)


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Give the directions of vectors; x where they have none, shape (n, 3)."""
    squared = np.einsum("ij,ij->i", vectors, vectors)[:, np.newaxis]
    unit = vectors / np.sqrt(np.maximum(squared, TINY * TINY))
    unit[squared[:, 0] <= TINY * TINY] = 1.0, 0.0, 0.0
    return np.asarray(unit)
