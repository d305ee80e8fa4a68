"""The vertices of convex hulls, all of them or as many as a tolerance asks for."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from g1_description.interrupts import uninterrupted

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull


MAX_WHOLE = 128
"""Most points that are not thinned: PyBullet's time grows with them."""

ROUNDING = 1e-12
"""Largest error of a height above a face, per size of the hull."""

MAX_ROUNDS = 20
"""Most times that points are put back; two or three are usual, and rounding errors that
are larger than the tolerance would never end."""

MAX_HEIGHTS = 2_000_000
"""Heights of points above faces that are computed at once: 16 MB."""

TINY = 1e-300
"""Instead of zero, to divide by."""

HULL_ERRORS = (RuntimeError, ValueError)
"""What ConvexHull raises for flat or few points. Its own error is a RuntimeError, whose
name is not public in scipy 1.3."""


def hull_vertices(points: np.ndarray) -> np.ndarray:
    """Select the points that are vertices of their convex hull.

    Args:
        points: In any frame, in [m], shape (n, 3).

    Returns:
        The vertices, shape (m, 3); every point once if they lie in a plane.
    """
    points = np.unique(np.asarray(points, float), axis=0)
    convex_hull = _qhull()
    try:
        return points[np.sort(convex_hull(points).vertices)]
    except HULL_ERRORS:
        return points


def hull_normals(points: np.ndarray) -> np.ndarray:
    """Give the directions that the faces of a convex hull have outwards.

    Args:
        points: In any frame, shape (n, 3).

    Returns:
        Unit vectors, shape (m, 3); none where there is no volume.
    """
    convex_hull = _qhull()
    try:
        return convex_hull(points).equations[:, :3]
    except HULL_ERRORS:
        return np.zeros((0, 3))


def thinned(points: np.ndarray, tolerance: float) -> tuple[np.ndarray, float]:
    """Leave out points that hardly stick out of the convex hull of the others.

    Args:
        points: In any frame, in [m], shape (n, 3).
        tolerance: How far a point that is left out may be from the new hull, in [m].

    Returns:
        Some of the points, or all where they are few, lie in a plane or have rounding
        errors larger than the tolerance, shape (m, 3); and how far the others are from
        their hull at most, in [m].
    """
    if len(points) <= MAX_WHOLE:
        return points, 0.0
    convex_hull = _qhull()
    try:
        # Qhull leaves out, and lists as coplanar, what is not W outside of a face.
        hull = convex_hull(points, f"Qt Qc W{tolerance:.9g}")
        chosen, near = points[hull.vertices], points[hull.coplanar[:, 0]]
        for _ in range(MAX_ROUNDS):
            distance = _distances(near, convex_hull(chosen))
            deviation = float(distance.max(initial=0.0))
            if deviation <= tolerance:
                return chosen, deviation
            # Beyond a sharp edge, points are farther from the hull than from planes.
            chosen = np.concatenate([chosen, near[distance > tolerance]])
    except HULL_ERRORS:
        pass
    return points, 0.0


def _qhull() -> Callable[..., ConvexHull]:
    """Import what computes hulls: that takes a tenth of a second, and few need it.

    scipy loses an interrupt in its import, and dies of one where it begins a hull.
    """
    with uninterrupted():
        from scipy.spatial import ConvexHull

    def compute(points: np.ndarray, options: str | None = None) -> ConvexHull:
        with uninterrupted():
            return ConvexHull(points, qhull_options=options)

    return compute


def _distances(points: np.ndarray, hull: ConvexHull) -> np.ndarray:
    """Find how far points are from a convex hull, in [m], shape (n,).

    Args:
        points: In [m], shape (n, 3).
        hull: The hull.
    """
    if len(points) * len(hull.equations) > MAX_HEIGHTS and len(points) > 1:
        halves = np.array_split(points, 2)
        return np.concatenate([_distances(half, hull) for half in halves])
    heights = points @ hull.equations[:, :3].T
    heights += hull.equations[:, 3]
    rounding = ROUNDING * np.abs(hull.points).max()
    number, face = np.nonzero(heights > rounding)  # the faces that a point sees
    beside = _distances_beside(
        points[number], hull.points[hull.simplices[face]], hull.equations[face, :3]
    )
    distances = np.full(len(points), np.inf)
    np.minimum.at(distances, number, np.hypot(heights[number, face], beside))
    return np.where(np.isinf(distances), 0.0, distances)


def _distances_beside(
    points: np.ndarray, corners: np.ndarray, normals: np.ndarray
) -> np.ndarray:
    """Find how far from triangles points are, along the planes of these.

    Args:
        points: One for each triangle, in [m], shape (n, 3).
        corners: Of the triangles, in [m], shape (n, 3, 3).
        normals: Of the triangles, shape (n, 3).

    Returns:
        In [m], shape (n,); zero above and below a triangle.
    """
    normals = normals[:, np.newaxis]
    edges = np.roll(corners, -1, axis=1) - corners
    to_point = points[:, np.newaxis] - corners
    flat = to_point - _dot(to_point, normals) * normals
    share = np.clip(_dot(flat, edges) / np.maximum(_dot(edges, edges), TINY), 0.0, 1.0)
    to_edges = np.linalg.norm(flat - share * edges, axis=-1).min(axis=1)
    side = _dot(np.cross(edges, flat), normals)[..., 0]
    is_above = (side >= 0.0).all(axis=1) | (side <= 0.0).all(axis=1)
    return np.where(is_above, 0.0, to_edges)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Multiply vectors, shapes (..., 3); shape (..., 1)."""
    return (a * b).sum(axis=-1, keepdims=True)
