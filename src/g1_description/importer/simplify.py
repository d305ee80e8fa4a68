"""Simplification of meshes: decimation, and convex hulls."""

from __future__ import annotations

import math
from typing import Callable

import fast_simplification
import numpy as np
import trimesh
from scipy.spatial import cKDTree

from g1_description.errors import DescriptionError

COARSE, FINE = 0.05, 0.02
"""Longest edges of subdivided triangles, for compared points and for the search of the
nearest triangle, as fractions of the extent."""

NEAREST = 12
"""Number of candidates for the nearest triangle to a point."""

AT_A_TIME = 2000
"""Points per chunk."""


class ComparedSurface:
    """A surface for comparison with others."""

    def __init__(self, triangles: np.ndarray, extent: float) -> None:
        """Prepare.

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
            limit: Distances above this need not be exact.
        """
        count = min(NEAREST, len(self._owners))
        bounds, _ = self._tree.query(points)
        farthest = 0.0
        # Sorted by their upper bounds, so most points can be skipped.
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


def deviation(
    one: ComparedSurface, other: ComparedSurface, limit: float = math.inf
) -> float:
    """Compute the two-sided distance of surfaces.

    Args:
        one: A surface.
        other: Another one.
        limit: Distances above this need not be exact.

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
    """Subdivide triangles until no edge is longer than a size.

    Returns:
        Corners of the pieces, shape (m, 3, 3), and the triangle of each, shape (m,).
    """
    pieces, owners = triangles, np.arange(len(triangles))
    done = []
    while len(pieces):
        lengths = np.linalg.norm(pieces - np.roll(pieces, -1, axis=1), axis=2)
        is_long = lengths.max(axis=1) > size
        done.append((pieces[~is_long], owners[~is_long]))
        # Each is bisected at its longest edge.
        turns = (lengths[is_long].argmax(axis=1)[:, None] + np.arange(3)) % 3
        turned = np.take_along_axis(pieces[is_long], turns[:, :, None], axis=1)
        a, b, c = np.swapaxes(turned, 0, 1)
        middle = (a + b) / 2.0
        halves = [np.stack(half, axis=1) for half in ((a, middle, c), (middle, b, c))]
        pieces, owners = np.concatenate(halves), np.concatenate([owners[is_long]] * 2)
    return tuple(np.concatenate(arrays) for arrays in zip(*done))


CELLS = (0.0, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
"""Sizes of cells in which corners are merged, as fractions of the largest extent; tried
in order until there are few enough triangles."""


MakeFewer = Callable[[np.ndarray, int], np.ndarray]
"""Takes triangles and the largest number of resulting ones."""

TRIES, CLOSE = 8, 1.2
"""Number of tries of a binary search, and its relative precision."""


def within(
    tolerance: float, triangles: np.ndarray, most: int, make_fewer: MakeFewer
) -> tuple[np.ndarray, float]:
    """Decimate a mesh within a tolerance.

    Args:
        tolerance: Largest deviation of the surface, in the unit of the corners.
        triangles: Corners, shape (n, 3, 3).
        most: Desired number of triangles.
        make_fewer: ``decimated`` or ``decimated_hull``.

    Returns:
        Corners, shape (m, 3, 3): the desired number, or the least found within the
        tolerance; and the deviation of the surface, see ``deviation``.
    """
    fewest, target, enough = most, most, len(triangles)
    best, moved = triangles, 0.0
    extent = float(np.ptp(triangles.reshape(-1, 3), axis=0).max())
    surface = ComparedSurface(triangles, extent)
    for _ in range(TRIES):
        distance = 0.0
        try:
            fewer = make_fewer(triangles, target)
        except DescriptionError:  # too few for a hull
            fewer, distance = triangles, np.inf
        if len(fewer) < len(triangles):
            distance = deviation(surface, ComparedSurface(fewer, extent), tolerance)
        if distance <= tolerance:
            best, moved, enough = fewer, distance, target
        else:
            fewest = target
        if enough <= CLOSE * fewest:
            break
        target = int(np.sqrt(fewest * enough))
    return best, moved


def decimated(triangles: np.ndarray, most: int) -> np.ndarray:
    """Decimate a mesh by quadric edge collapse.

    Edges collapse only within a surface. If many small parts have too many triangles,
    corners that are close to each other are merged first.

    Args:
        triangles: Corners, shape (n, 3, 3).
        most: Largest number of resulting triangles.

    Returns:
        Corners, shape (m, 3, 3); may be more than requested, if the shape would vanish.
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
    """Join the corners that lie in one cell, a fraction of the largest extent.

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


def convex_hull(triangles: np.ndarray) -> np.ndarray:
    """Make the convex hull of a mesh.

    Args:
        triangles: Corners, shape (n, 3, 3).

    Returns:
        Corners, shape (m, 3, 3).

    Raises:
        DescriptionError: If the mesh is flat.
    """
    try:
        hull = _joined(triangles).convex_hull
    except (RuntimeError, ValueError) as error:  # Qhull's is a RuntimeError
        raise DescriptionError("it is flat and has no convex hull") from error
    return np.asarray(hull.triangles)


def decimated_hull(triangles: np.ndarray, most: int) -> np.ndarray:
    """Decimate a convex hull, which remains convex; see ``decimated``."""
    # n corners make a hull of at most 2 n - 4 triangles: as many as requested.
    return (
        triangles if len(triangles) <= most else convex_hull(decimated(triangles, most))
    )


def _joined(triangles: np.ndarray) -> trimesh.Trimesh:
    """Make a mesh whose triangles share their corners."""
    faces = np.arange(3 * len(triangles)).reshape(-1, 3)
    return trimesh.Trimesh(triangles.reshape(-1, 3), faces, process=True)
