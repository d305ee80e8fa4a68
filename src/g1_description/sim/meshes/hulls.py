"""The points whose convex hulls stand for a mesh, or another shape, that moves."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

import numpy as np

from g1_description.robot.description import Shape
from g1_description.sim.meshes.hull_vertices import thinned
from g1_description.sim.meshes.shapes import Mesh
from g1_description.sim.meshes.stl import read_stl

MAX_HULLS = 100
"""A mesh of more parts becomes one convex hull, instead of one for each."""

MAX_SHARE = 0.02
"""Largest distance of a thinned hull from its mesh, per shortest side of its box: a
ball keeps nine tenths of its volume."""

MAX_FILES_KEPT = 64
"""Files whose points are remembered: a robot is loaded more than once."""

KEY_FACTORS = np.array(
    [0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64
)
"""Odd and far apart, so that keys of neighbouring points spread."""

CORNERS = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, 8).T
"""Of a box of size one, shape (8, 3)."""

SIDES = 32
"""Sides of the prism that stands for a cylinder: PyBullet's number."""


def hull_points(mesh: Mesh) -> list[np.ndarray]:
    """Return the points whose convex hulls stand for a mesh.

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


def thinned_hulls(mesh: Mesh, tolerance: float) -> list[tuple[np.ndarray, float]]:
    """Return fewer points whose convex hulls stand for a mesh.

    Args:
        mesh: The mesh.
        tolerance: How far other points of the mesh may be from them, in its unit; less
            for small meshes, which would not keep their form.

    Returns:
        Points as `hull_points` has them, and how far the other points are from their
        hull at most.
    """
    if mesh.parts:
        return [_thinned(points, tolerance) for points in hull_points(mesh)]
    status = mesh.path.stat()
    return [_thinned_stl(mesh.path, status.st_size, status.st_mtime_ns, tolerance)]


@lru_cache(maxsize=MAX_FILES_KEPT)
def _thinned_stl(
    path: Path, size: int, changed: int, tolerance: float
) -> tuple[np.ndarray, float]:
    """Thin the hull of the corners in a file."""
    return _thinned(_stl_points(path, size, changed), tolerance)


def _thinned(points: np.ndarray, tolerance: float) -> tuple[np.ndarray, float]:
    """Thin a hull with a tolerance that is small beside its size."""
    tolerance = min(tolerance, MAX_SHARE * float(np.ptp(points, axis=0).min()))
    return thinned(points, tolerance)


@lru_cache(maxsize=MAX_FILES_KEPT)
def _stl_points(path: Path, size: int, changed: int) -> np.ndarray:
    """Return the corners in a binary STL file of this size and time of change."""
    return _distinct(read_stl(path.read_bytes()).reshape(-1, 3))


def _distinct(points: np.ndarray) -> np.ndarray:
    """Leave out repetitions: five of six corners of a usual mesh.

    PyBullet then finds the hull in half the time.

    Args:
        points: In single precision, shape (n, 3).

    Returns:
        Every point once, in any order, shape (m, 3).
    """
    # A key of 64 bits per point, since sorting whole rows takes seven times as long.
    # Two of a million points share one by accident with a probability of 3e-8.
    bits = np.ascontiguousarray(points).view(np.uint32).astype(np.uint64)
    _, first = np.unique(bits @ KEY_FACTORS, return_index=True)
    return points[first]


def cylinder_points(radius: float, length: float) -> np.ndarray:
    """Return the corners of a prism that stands for a cylinder about the z axis.

    PyBullet makes the same of a cylinder in URDF: the flat end of its exact one is
    round, and has fewer points of contact.

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
    """Return points, and a radius about them, whose convex hull is that of a shape.

    Args:
        shape: No plane: that has no outline.
        meshes: The meshes by the names of their files, the shape's among them.

    Returns:
        Points in the frame of the shape, in [m], shape (n, 3), and a radius in [m].
    """
    if shape.kind == "sphere":
        return np.zeros((1, 3)), shape.size[0]
    if shape.kind == "box":
        return CORNERS * np.array(shape.size), 0.0
    if shape.kind == "cylinder":
        return cylinder_points(*shape.size).astype(float), 0.0
    points = np.concatenate(hull_points(meshes[shape.filename]))
    return points * np.array(shape.size), 0.0
