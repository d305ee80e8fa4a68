"""The triangles of a robot's links by colour, for browsers."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Tuple

import numpy as np

from g1_description.robot.description import Description, Shape
from g1_description.robot.rotation import rotate
from g1_description.sim.meshes.shapes import (
    Mesh,
    Part,
    find_meshes,
    is_there,
    scaled_parts,
)
from g1_description.sim.meshes.stl import ROUND

GREY = (0.7, 0.7, 0.7, 1.0)
"""Colour of a shape where its file gives none."""

Color = Tuple[float, ...]
"""Red, green, blue, opacity, from 0 to 1."""

_BOX = np.array(
    [
        [[0, 0, 0], [0, 1, 1], [0, 0, 1]],
        [[0, 0, 0], [0, 1, 0], [0, 1, 1]],
        [[0, 0, 0], [1, 0, 1], [1, 0, 0]],
        [[0, 0, 0], [0, 0, 1], [1, 0, 1]],
        [[0, 0, 0], [1, 1, 0], [0, 1, 0]],
        [[0, 0, 0], [1, 0, 0], [1, 1, 0]],
    ]
)
_BOX = np.concatenate([_BOX[:, ::-1], 1 - _BOX]) - 0.5
"""Triangles of a box with sides of 1 about the origin, anticlockwise from outside."""


@dataclass(frozen=True, eq=False)
class Patch:
    """Triangles of one colour."""

    vertices: np.ndarray
    """In the frame of the link, in [m], shape (n, 3)."""

    faces: np.ndarray
    """Rows of ``vertices``, anticlockwise seen from outside, shape (m, 3)."""

    color: Color


def link_patches(
    robot: Description, solid: bool = False
) -> tuple[dict[str, list[Patch]], tuple[str, ...]]:
    """Find the triangles of all links.

    Args:
        robot: The robot.
        solid: Whether to use collision shapes instead of visual ones.

    Returns:
        One patch per colour by link name, and messages on what cannot be used.
    """
    shapes = {
        link.name: link.collisions if solid else link.visuals for link in robot.links
    }
    meshes, left_out = find_meshes(s for some in shapes.values() for s in some)
    patches = {
        link: _merged(
            look
            for shape in some
            if is_there(shape, meshes)
            for part in shape_parts(shape, meshes.get(shape.filename))
            for look in [(part.corners, part.color or GREY)]
        )
        for link, some in shapes.items()
    }
    kept = {link: some for link, some in patches.items() if some}
    return kept, (*robot.unread, *left_out)


def shape_parts(shape: Shape, mesh: Mesh | None) -> list[Part]:
    """List the triangles of a shape in the frame of its link, by colour.

    As in RViz, the colours of the mesh's own materials count more than that of the
    shape.
    """
    color = tuple(shape.color or GREY)
    parts = [_primitive(shape)] if mesh is None else scaled_parts(mesh, shape.size)
    turn = shape.pose[3:]
    return [
        Part(
            rotate(turn, part.corners) + shape.pose[:3],
            rotate(turn, part.normals),
            part.color or color,
        )
        for part in parts
    ]


def _primitive(shape: Shape) -> Part:
    """Make the triangles of a box or a round shape."""
    if shape.kind == "box":
        corners = _BOX * np.array(shape.size)
        edges = np.cross(_BOX[:, 1] - _BOX[:, 0], _BOX[:, 2] - _BOX[:, 0])
        return Part(corners, np.repeat(edges[:, np.newaxis], 3, axis=1), None)
    surface = ROUND[shape.kind](*shape.size)
    triangles = surface.triangles
    return Part(surface.vertices[triangles], surface.normals[triangles], None)


def _merged(looks: Iterable[tuple[np.ndarray, Color]]) -> list[Patch]:
    """Put triangles of one colour together, with each corner once."""
    import trimesh  # where it is missing, the server says so in a sentence

    by_color: dict[Color, list[np.ndarray]] = {}
    for corners, color in looks:
        by_color.setdefault(tuple(color), []).append(corners)
    patches = []
    for color, some in by_color.items():
        rows = np.concatenate(some).reshape(-1, 3).astype(np.float32)
        first, number = trimesh.grouping.unique_rows(rows)
        faces = number.reshape(-1, 3).astype(np.uint32)
        patches.append(Patch(rows[first], faces, color))
    return patches
