"""Simpler shapes in place of a mesh: fewer triangles, or its convex hull."""

from __future__ import annotations

import math
from typing import Callable

import fast_simplification
import numpy as np
import trimesh
from scipy.spatial import cKDTree

from g1_description.errors import DescriptionError

COARSE, FINE = 0.05, 0.02
"""Longest edges of the pieces whose middles are compared, and of those among which the
nearest is looked for, as shares of the extent."""

NEAREST = 12
"""Pieces among which the nearest triangle to a point is looked for."""

AT_A_TIME = 2000
"""Points that are compared at a time."""


class ComparedSurface:
    """A surface that others are compared with."""

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


def deviation(
    one: ComparedSurface, other: ComparedSurface, limit: float = math.inf
) -> float:
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
    """Cut triangles into pieces whose edges are at most as long as a size.

    Returns:
        Corners of the pieces, shape (m, 3, 3), and the triangle of each, shape (m,).
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


CELLS = (0.0, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
"""Corners are joined that are this close, as a share of the largest extent; one after
the other is tried until there are few enough triangles."""


MakeFewer = Callable[[np.ndarray, int], np.ndarray]
"""Takes triangles and how many may be left."""

TRIES, CLOSE = 8, 1.2
"""How often a number of triangles is tried, and how close to the least that will do."""


def within(
    tolerance: float, triangles: np.ndarray, most: int, make_fewer: MakeFewer
) -> tuple[np.ndarray, float]:
    """Make fewer triangles of a mesh, as long as its surface stays where it was.

    Args:
        tolerance: How far the surface may move, in the unit of the corners.
        triangles: Corners, shape (n, 3, 3).
        most: How many are wanted.
        make_fewer: ``decimated`` or ``decimated_hull``.

    Returns:
        Corners, shape (m, 3, 3): as few as are wanted, or the fewest that were found
        within the tolerance; and how far the surface moved, see ``deviation``.
    """
    fewest, wanted, enough = most, most, len(triangles)
    best, moved = triangles, 0.0
    extent = float(np.ptp(triangles.reshape(-1, 3), axis=0).max())
    surface = ComparedSurface(triangles, extent)
    for _ in range(TRIES):
        distance = 0.0
        try:
            fewer = make_fewer(triangles, wanted)
        except DescriptionError:  # so few that they have no hull
            fewer, distance = triangles, np.inf
        if len(fewer) < len(triangles):
            distance = deviation(surface, ComparedSurface(fewer, extent), tolerance)
        if distance <= tolerance:
            best, moved, enough = fewer, distance, wanted
        else:
            fewest = wanted
        if enough <= CLOSE * fewest:
            break
        wanted = int(np.sqrt(fewest * enough))
    return best, moved


def decimated(triangles: np.ndarray, most: int) -> np.ndarray:
    """Make fewer triangles of a mesh, by quadric edge collapse.

    Edges collapse within a surface only. Where many small parts make too many
    triangles, corners that are close to each other become one first.

    Args:
        triangles: Corners, shape (n, 3, 3).
        most: How many may be left.

    Returns:
        Corners, shape (m, 3, 3); the mesh itself if it has no more. Where nothing
        else is left of the shape it has more than requested.
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
    """Make fewer triangles of a convex hull, which stays one; see ``decimated``."""
    # n corners make a hull of at most 2 n - 4 triangles: as many as requested.
    return (
        triangles if len(triangles) <= most else convex_hull(decimated(triangles, most))
    )


def _joined(triangles: np.ndarray) -> trimesh.Trimesh:
    """Make a mesh whose triangles share their corners."""
    faces = np.arange(3 * len(triangles)).reshape(-1, 3)
    return trimesh.Trimesh(triangles.reshape(-1, 3), faces, process=True)
