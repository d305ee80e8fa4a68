"""Simpler shapes in place of a mesh: fewer triangles, or its convex hull."""

from __future__ import annotations

from pathlib import Path

import fast_simplification
import numpy as np
import trimesh

from ..core.errors import DescriptionError

CELLS = (0.0, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
"""Corners are joined that are this close, as a share of the largest extent; one after
the other is tried until there are few enough triangles."""


def read_obj(path: Path) -> np.ndarray:
    """Read the triangles of an OBJ file, shape (n, 3, 3).

    Raises:
        DescriptionError: If there are none, or it is no OBJ.
    """
    try:
        mesh = trimesh.load(path, force="mesh", process=False, skip_materials=True)
        triangles = np.asarray(mesh.triangles, dtype=float)
    # What trimesh raises depends on where in the file it stumbles.
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as why:
        raise DescriptionError(f"it is no OBJ: {why}") from why
    if not len(triangles) or not np.isfinite(triangles).all():
        raise DescriptionError("it has no triangles")
    return triangles


def decimated(triangles: np.ndarray, most: int) -> np.ndarray:
    """Make fewer triangles of a mesh, by quadric edge collapse.

    Edges collapse within a surface only. Where many small parts make too many
    triangles, corners that are close to each other become one first.

    Args:
        triangles: Corners, shape (n, 3, 3).
        most: How many may be left.

    Returns:
        Corners, shape (m, 3, 3); the mesh itself if it has no more. Where nothing
        else is left of the shape it has more than asked for.
    """
    best = triangles
    mesh = _joined(triangles)
    for cell in CELLS:
        if len(best) <= most:
            break
        vertices, faces = _welded(mesh, cell)
        if len(faces) > most:
            vertices, faces = fast_simplification.simplify(
                vertices.astype(np.float32), faces.astype(np.int32), target_count=most
            )
        if 0 < len(faces) < len(best):
            best = vertices[faces]
    return best


def _welded(mesh: trimesh.Trimesh, cell: float) -> tuple[np.ndarray, np.ndarray]:
    """Join the corners of a mesh that lie in one cell of a grid.

    Args:
        mesh: The mesh.
        cell: Size of a cell as a share of the mesh's largest extent.

    Returns:
        Vertices, shape (n, 3), and the faces that are still triangles, shape (m, 3).
    """
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    if not cell:
        return vertices, faces
    cells = np.round(vertices / (cell * np.ptp(vertices, axis=0).max())).astype(int)
    _, first, joined = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    faces = joined.reshape(-1)[faces]
    ordered = np.sort(faces, axis=1)
    _, single = np.unique(ordered, axis=0, return_index=True)
    is_triangle = (np.diff(ordered, axis=1) > 0).all(axis=1)
    return vertices[first], faces[single[is_triangle[single]]]


def convex_hull(triangles: np.ndarray, most: int | None = None) -> np.ndarray:
    """Make the convex hull of a mesh.

    Args:
        triangles: Corners, shape (n, 3, 3).
        most: How many triangles it may have; None for as many as it takes.

    Returns:
        Corners, shape (m, 3, 3).

    Raises:
        DescriptionError: If the mesh is flat.
    """
    hull = _hull(triangles)
    if most is None or len(hull) <= most:
        return hull
    # n corners make a hull of at most 2 n - 4 triangles: as many as were asked for.
    return _hull(decimated(hull, most))


def _hull(triangles: np.ndarray) -> np.ndarray:
    """Make a convex hull, or say that there is none."""
    try:
        hull = _joined(triangles).convex_hull
    except (RuntimeError, ValueError) as error:  # Qhull's is a RuntimeError
        raise DescriptionError("it is flat and has no convex hull") from error
    return np.asarray(hull.triangles)


def _joined(triangles: np.ndarray) -> trimesh.Trimesh:
    """Make a mesh whose triangles share their corners."""
    faces = np.arange(3 * len(triangles)).reshape(-1, 3)
    return trimesh.Trimesh(triangles.reshape(-1, 3), faces, process=True)
