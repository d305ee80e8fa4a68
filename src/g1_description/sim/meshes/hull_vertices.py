"""The vertices of convex hulls, all of them or as many as a tolerance asks for."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull

MAX_WHOLE = 128
"""Most vertices of a hull that is not thinned: PyBullet's time grows with them."""

N_DIRECTIONS = 32
"""Directions whose farthest vertices a thinned hull begins with."""

MAX_ROUNDS = 20
"""Most times that vertices are added to a thinned hull."""

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
    try:
        return points[np.sort(ConvexHull(points).vertices)]
    except HULL_ERRORS:
        return points


def hull_normals(points: np.ndarray) -> np.ndarray:
    """Give the directions that the faces of a convex hull have outwards.

    Args:
        points: In any frame, shape (n, 3).

    Returns:
        Unit vectors, shape (m, 3); none where there is no volume.
    """
    try:
        return ConvexHull(points).equations[:, :3]
    except HULL_ERRORS:
        return np.zeros((0, 3))


def thinned(vertices: np.ndarray, tolerance: float) -> np.ndarray:
    """Leave out vertices of a hull that hardly stick out of the hull of the others.

    Args:
        vertices: Of a convex hull, in [m], shape (n, 3).
        tolerance: How far a vertex that is left out may lie outside of each plane of
            the new hull, in [m].

    Returns:
        Some of the vertices, or all where there are few, shape (m, 3).
    """
    if len(vertices) <= MAX_WHOLE:
        return vertices
    chosen = np.unique((vertices @ _directions().T).argmax(axis=0))
    try:
        for _ in range(MAX_ROUNDS):
            planes = ConvexHull(vertices[chosen]).equations
            outside = vertices @ planes[:, :3].T + planes[:, 3]
            far = outside.max(axis=0) > tolerance
            if not far.any():
                return vertices[chosen]
            chosen = np.union1d(chosen, outside[:, far].argmax(axis=0))
    except HULL_ERRORS:
        pass
    return vertices


def _directions() -> np.ndarray:
    """Spread unit vectors evenly, along a spiral, shape (``N_DIRECTIONS``, 3)."""
    number = np.arange(N_DIRECTIONS) + 0.5
    z = 1.0 - 2.0 * number / N_DIRECTIONS
    angle = np.pi * (1.0 + 5.0**0.5) * number
    across = np.sqrt(1.0 - z**2)
    return np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=-1)
