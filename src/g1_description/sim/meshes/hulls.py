"""Convex hulls of shapes, and thinning of their vertices."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from g1_description.interrupts import uninterrupted
from g1_description.robot.description import Shape
from g1_description.sim.meshes.shapes import Mesh
from g1_description.sim.meshes.stl import read_stl

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

MAX_HULLS = 100
"""Meshes with more parts become one convex hull, instead of one per part."""

TOLERANCE = 1e-3
"""Largest distance in [m] of a thinned hull from its mesh: fewer points make steps with
contacts, and loading, faster."""

MAX_SHARE = 0.02
"""Largest distance of a thinned hull from its mesh, relative to the shortest side of
its box: a ball keeps 90 % of its volume."""

MAX_FILES_KEPT = 64
"""Files whose points are cached: a robot is loaded more than once."""

KEY_FACTORS = np.array(
    [0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64
)
"""Factors of a hash of points."""

CORNERS = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, 8).T
"""Corners of a box of size one, shape (8, 3)."""

SIDES = 32
"""Sides of the prism of a cylinder, as in PyBullet."""

MAX_WHOLE = 128
"""Largest number of points that are not thinned: PyBullet's run time grows with it."""

ROUNDING = 1e-12
"""Largest error of a height above a face, per size of the hull."""

MAX_ROUNDS = 20
"""Largest number of iterations; two or three are usual, but rounding errors larger than
the tolerance would never end."""

MAX_HEIGHTS = 2_000_000
"""Heights of points above faces per chunk: 16 MB."""

FLAT = 1e-7
"""Extent up to which a hull counts as flat, in [m]."""

SAME = 1e-14
"""Less than one by which the product of two normals of one plane may be."""

TINY = 1e-300
"""Avoids division by zero."""

HULL_ERRORS = (RuntimeError, ValueError)
"""Errors of ConvexHull for flat or few points. QhullError is a RuntimeError, and not
public in scipy 1.3."""


def hull_points(mesh: Mesh) -> list[np.ndarray]:
    """Return the points of the convex hulls of a mesh.

    Args:
        mesh: The mesh.

    Returns:
        Points of each part, in the unit and frame of the mesh, each with shape (n, 3)
        in single precision.
    """
    if not mesh.parts:
        status = mesh.path.stat()
        return [_stl_points(mesh.path, status.st_size, status.st_mtime_ns)]
    parts = [part.corners.reshape(-1, 3) for part in mesh.parts]
    if len(parts) > MAX_HULLS:
        parts = [np.concatenate(parts)]
    return [_distinct(np.asarray(points, np.float32)) for points in parts]


def thinned_hulls(mesh: Mesh, scale: float) -> tuple[list[np.ndarray], float]:
    """Thin the convex hulls of a mesh.

    Args:
        mesh: The mesh.
        scale: Its largest scale, to [m].

    Returns:
        Points as by ``hull_points``, and the largest distance of removed points from
        their hull, in [m].
    """
    tolerance = TOLERANCE / scale if scale else 0.0
    if mesh.parts:
        found = [_thinned(points, tolerance) for points in hull_points(mesh)]
    else:
        status = mesh.path.stat()
        stl = mesh.path, status.st_size, status.st_mtime_ns
        found = [_thinned_stl(*stl, tolerance)]
    return [points for points, _ in found], scale * max(d for _, d in found)


@lru_cache(maxsize=MAX_FILES_KEPT)
def _thinned_stl(
    path: Path, size: int, changed: int, tolerance: float
) -> tuple[np.ndarray, float]:
    """Thin the hull of the corners in a file."""
    return _thinned(_stl_points(path, size, changed), tolerance)


def _thinned(points: np.ndarray, tolerance: float) -> tuple[np.ndarray, float]:
    """Thin a hull with a tolerance that is small relative to its size."""
    tolerance = min(tolerance, MAX_SHARE * float(np.ptp(points, axis=0).min()))
    return thinned(points, tolerance)


@lru_cache(maxsize=MAX_FILES_KEPT)
def _stl_points(path: Path, size: int, changed: int) -> np.ndarray:
    """Return the corners in a binary STL file of this size and time of change."""
    return _distinct(read_stl(path.read_bytes()).reshape(-1, 3))


def _distinct(points: np.ndarray) -> np.ndarray:
    """Remove duplicate points, shape (n, 3) in single precision.

    In a usual mesh, five of six corners are; without them PyBullet takes half the time.
    """
    # A 64-bit hash per point, since sorting rows takes seven times as long. The
    # probability of a collision among a million points is 3e-8.
    bits = np.ascontiguousarray(points).view(np.uint32).astype(np.uint64)
    _, first = np.unique(bits @ KEY_FACTORS, return_index=True)
    return points[first]


def cylinder_points(radius: float, length: float) -> np.ndarray:
    """Return the corners of a prism that approximates a cylinder about the z axis.

    PyBullet does the same for cylinders in URDF: the end of an exact cylinder has fewer
    contact points.

    Args:
        radius: In [m].
        length: In [m].

    Returns:
        Points around the origin, in [m], shape (2 * SIDES, 3) in single precision.
    """
    angle = np.arange(SIDES) * (2.0 * np.pi / SIDES)
    circle = radius * np.stack([np.sin(angle), np.cos(angle)], axis=-1)
    ends = [np.insert(circle, 2, z, axis=1) for z in (length / 2, -length / 2)]
    return np.concatenate(ends).astype(np.float32)


def outline(shape: Shape, meshes: Mapping[str, Mesh]) -> tuple[np.ndarray, float]:
    """Return points, and a radius around them, with the convex hull of a shape.

    Args:
        shape: Any shape but a plane.
        meshes: Meshes by file name, including the shape's.

    Returns:
        Points in the frame of the shape, in [m], shape (n, 3), and a radius in [m].
    """
    if shape.kind == "sphere":
        return np.zeros((1, 3)), shape.size[0]
    if shape.kind == "box":
        return CORNERS * np.array(shape.size), 0.0
    if shape.kind == "capsule":
        radius, length = shape.size
        return np.array([[0.0, 0.0, -length / 2], [0.0, 0.0, length / 2]]), radius
    if shape.kind == "cylinder":
        return cylinder_points(*shape.size).astype(float), 0.0
    points = np.concatenate(hull_points(meshes[shape.filename]))
    return points * np.array(shape.size), 0.0


def hull_vertices(points: np.ndarray) -> np.ndarray:
    """Select the points that are vertices of their convex hull.

    Args:
        points: In any frame, in [m], shape (n, 3).

    Returns:
        The vertices, shape (m, 3); all distinct points if they lie in a plane.
    """
    points = np.unique(np.asarray(points, float), axis=0)
    convex_hull = _qhull()
    try:
        return points[np.sort(convex_hull(points).vertices)]
    except HULL_ERRORS:
        return points


def edge_points(points: np.ndarray, spacing: float) -> np.ndarray:
    """Add points along the edges of a convex hull, and across its faces.

    Args:
        points: Vertices in any frame, in [m], shape (n, 3).
        spacing: Largest distance between neighbours along an edge, in [m].

    Returns:
        The vertices and the points, shape (m, 3); the vertices of a flat hull.
    """
    try:
        triangles = _qhull()(points).simplices
    except HULL_ERRORS:
        return points
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges = np.unique(edges, axis=0)
    begin, way = points[edges[:, 0]], np.diff(points[edges], axis=1)[:, 0]
    counts = np.ceil(np.linalg.norm(way, axis=1) / spacing).astype(int)
    found = [points]
    for number in range(1, int(counts.max())):
        long = counts > number
        share = (number / counts[long])[:, np.newaxis]
        found.append(begin[long] + share * way[long])
    return np.concatenate(found)


def hull_normals(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute the outward normals of the faces of a convex hull.

    A hull without volume has those of a prism: of its shape, however thick.

    Args:
        points: In any frame, in [m], shape (n, 3).

    Returns:
        Unit vectors, shape (m, 3); rows of the two at each edge, shape (k, 2), without
        edges between triangles of one face.
    """
    hull = _qhull()(_thick(points))
    normals = hull.equations[:, :3]
    edges = np.stack([np.repeat(np.arange(len(normals)), 3), hull.neighbors.ravel()], 1)
    edges = edges[edges[:, 0] < edges[:, 1]]
    first, second = normals[edges[:, 0]], normals[edges[:, 1]]
    return normals, edges[(first * second).sum(axis=1) < 1.0 - SAME]


def _thick(points: np.ndarray) -> np.ndarray:
    """Add points along the directions in which a hull has no extent."""
    axes = np.linalg.svd(points - points.mean(axis=0))[2]
    extents = np.ptp(points @ axes.T, axis=0)
    for axis in axes[extents <= FLAT]:
        points = np.concatenate([points + axis, points - axis])
    return points


def thinned(points: np.ndarray, tolerance: float) -> tuple[np.ndarray, float]:
    """Remove points that hardly stick out of the convex hull of the others.

    Args:
        points: In any frame, in [m], shape (n, 3).
        tolerance: Largest distance of a removed point from the new hull, in [m].

    Returns:
        Some of the points, or all if they are few, lie in a plane or have rounding
        errors larger than the tolerance, shape (m, 3); and the largest distance of the
        others from their hull, in [m].
    """
    if len(points) <= MAX_WHOLE:
        return points, 0.0
    convex_hull = _qhull()
    try:
        # Qhull lists points less than W outside of a face as coplanar.
        hull = convex_hull(points, f"Qt Qc W{tolerance:.9g}")
        chosen, near = points[hull.vertices], points[hull.coplanar[:, 0]]
        for _ in range(MAX_ROUNDS):
            distance = _distances(near, convex_hull(chosen))
            deviation = float(distance.max(initial=0.0))
            if deviation <= tolerance:
                return chosen, deviation
            # Near a sharp edge, points are farther from the hull than from its planes.
            chosen = np.concatenate([chosen, near[distance > tolerance]])
    except HULL_ERRORS:
        pass
    return points, 0.0


def _qhull() -> Callable[..., ConvexHull]:
    """Import ConvexHull, which takes 0.1 s and is seldom needed.

    scipy loses an interrupt during its import, and crashes on one during a hull.
    """
    with uninterrupted():
        from scipy.spatial import ConvexHull

    def compute(points: np.ndarray, options: str | None = None) -> ConvexHull:
        with uninterrupted():
            return ConvexHull(points, qhull_options=options)

    return compute


def _distances(points: np.ndarray, hull: ConvexHull) -> np.ndarray:
    """Compute the distances of points from a convex hull, in [m], shape (n,)."""
    if len(points) * len(hull.equations) > MAX_HEIGHTS and len(points) > 1:
        halves = np.array_split(points, 2)
        return np.concatenate([_distances(half, hull) for half in halves])
    heights = points @ hull.equations[:, :3].T
    heights += hull.equations[:, 3]
    rounding = ROUNDING * np.abs(hull.points).max()
    number, face = np.nonzero(heights > rounding)  # the faces visible from a point
    beside = _distances_beside(
        points[number], hull.points[hull.simplices[face]], hull.equations[face, :3]
    )
    distances = np.full(len(points), np.inf)
    np.minimum.at(distances, number, np.hypot(heights[number, face], beside))
    return np.where(np.isinf(distances), 0.0, distances)


def _distances_beside(
    points: np.ndarray, corners: np.ndarray, normals: np.ndarray
) -> np.ndarray:
    """Compute the distances of points from triangles, pairwise, along their planes.

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
