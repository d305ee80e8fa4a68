"""Cut a body out of its outlines and sections, and make a mesh of it.

As on a technical drawing a body is told by its outlines along x, y and z: it is what
lies inside all three, and inside the loft of its sections, with its edges rounded.
"""

import fast_simplification
import numpy as np
import trimesh
from scipy.ndimage import gaussian_filter
from skimage.measure import marching_cubes

from .outline import loft_distance, outline_distance

AXES = "xyz"
CELLS = 110
"""Cells of the grid along a body's diagonal, between FINE and COARSE."""
FINE, COARSE = 0.0006, 0.0016
"""Sizes of a cell in [m]."""
ROUND = 0.003
"""Edges are rounded over about this length in [m]."""
SLACK = 0.0015
"""Sections may be off by this, in [m]: where outlines tell more, they count alone."""


BLUR = 1.0
"""The grid is smoothed over so many cells: no skin is thinner than what it can show."""
CRUMB = 0.01
"""What comes loose and is smaller than this share of the largest piece is left out."""


def across(axis):
    """Name the two axes across one, in the order xyz."""
    return [other for other in range(3) if other != axis]


def body(shape):
    """Make a body's mesh.

    Args:
        shape: ``parts``: what it consists of, each as in ``field``; ``triangles``:
            about how many its mesh shall have; ``cell``: size of the grid in [m].

    Returns:
        A closed trimesh.Trimesh in [m], normals outward.

    Raises:
        ValueError: If no mesh of so few triangles is closed.
    """
    corners = bounds(shape["parts"])
    mesh = decimated(surface(shape), shape["triangles"])
    # Rounding takes a fraction of a millimetre off: it gets its size back.
    scale = (corners[1] - corners[0]) / (mesh.bounds[1] - mesh.bounds[0])
    mesh.vertices = corners[0] + scale * (mesh.vertices - mesh.bounds[0])
    if mesh.volume < 0.0:
        mesh.invert()
    return mesh


def surface(shape):
    """Find a body's surface on a grid, in [m], without crumbs."""
    corners = bounds(shape["parts"])
    usual = np.linalg.norm(corners[1] - corners[0]) / CELLS
    cell = shape.get("cell", np.clip(usual, FINE, COARSE))
    ticks = [
        np.arange(low - 3 * cell, high + 4 * cell, cell) for low, high in corners.T
    ]
    nearest = np.min([field(part, ticks) for part in shape["parts"]], axis=0)
    nearest = gaussian_filter(nearest, BLUR)
    vertices, triangles, _, _ = marching_cubes(
        nearest, 0.0, spacing=(cell,) * 3, allow_degenerate=False
    )
    pieces = trimesh.Trimesh(vertices, triangles).split()
    largest = max(abs(piece.volume) for piece in pieces)
    return trimesh.util.concatenate(
        [piece for piece in pieces if abs(piece.volume) > CRUMB * largest]
    )


def decimated(mesh, count):
    """Make a closed mesh of fewer triangles.

    How eagerly edges are collapsed decides whether it stays closed.
    """
    for eagerness in (2, 3, 5, 7):
        fewer = fast_simplification.simplify(
            mesh.vertices.astype(np.float32),
            mesh.faces.astype(np.int32),
            target_count=count,
            agg=eagerness,
        )
        closed = trimesh.Trimesh(*fewer)
        if closed.is_watertight and len(closed.faces) <= 1.05 * count:
            return closed
    raise ValueError(f"no mesh of {count} triangles is closed")


def bounds(parts):
    """Find the box around all parts in [m], shape (2, 3)."""
    boxes = np.array([part_bounds(part) for part in parts])
    return np.array([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])


def part_bounds(part):
    """Find the box that a part's outlines leave it, in [m], shape (2, 3)."""
    low, high = np.full(3, -np.inf), np.full(3, np.inf)
    for axis, name in enumerate(AXES):
        points = np.concatenate([np.asarray(r, float) for r in part[f"along_{name}"]])
        low[across(axis)] = np.maximum(low[across(axis)], points.min(axis=0))
        high[across(axis)] = np.minimum(high[across(axis)], points.max(axis=0))
    return np.array([low, high])


def field(part, ticks):
    """Tell how far the points of a grid are from a part.

    Args:
        part: ``along_x``, ``along_y``, ``along_z``: outlines seen along an axis,
            rings of corners in [m] along the other two axes; ``sections_x`` and so
            on, where it has them: as in ``loft_distance``.
        ticks: The grid's coordinates along x, y and z in [m].

    Returns:
        Distances in [m], negative inside, a value per point of the grid.
    """
    fields = []
    for axis, name in enumerate(AXES):
        grid = np.meshgrid(*(ticks[other] for other in across(axis)), indexing="ij")
        points = np.stack([side.ravel() for side in grid], axis=1)
        distance = outline_distance(part[f"along_{name}"], points)
        fields.append(np.expand_dims(distance.reshape(grid[0].shape), axis))
        if f"sections_{name}" in part:
            station = ticks[axis][:, np.newaxis, np.newaxis]
            a, b = (side[np.newaxis] for side in grid)
            loft = loft_distance(part[f"sections_{name}"], station, a, b)
            fields.append(np.moveaxis(loft, 0, axis) - SLACK)
    return rounded_intersection(fields)


def rounded_intersection(fields):
    """Intersect bodies that are given by their distances, and round the edges.

    The polynomial smooth maximum: where two distances are nearer to each other than
    ROUND, the greater one grows by up to a quarter of that.
    """
    total = fields[0]
    for other in fields[1:]:
        near = np.maximum(1.0 - np.abs(total - other) / ROUND, 0.0)
        total = np.maximum(total, other) + 0.25 * ROUND * near**2
    return total


def mirrored(mesh):
    """Give the mesh of the other side: y becomes -y."""
    other = mesh.copy()
    other.vertices = other.vertices * [1.0, -1.0, 1.0]
    other.invert()
    return other
