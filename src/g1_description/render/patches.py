"""The triangles of links and objects by colour, for browsers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Tuple

import numpy as np

from g1_description.robot.description import Description, Shape
from g1_description.robot.rotation import rotate
from g1_description.scenes.objects import SceneObject
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

_SQUARE = np.array([[[-1, -1], [1, -1], [1, 1]], [[-1, -1], [1, 1], [-1, 1]]]) / 2
"""Triangles of a square with sides of 1, along two sides."""

PLANE, SEE_THROUGH = 10.0, 0.25
"""Length of the sides of the square that shows a plane, in [m], and its opacity."""


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
    patches, left_out = patches_of(
        {link.name: link.collisions if solid else link.visuals for link in robot.links}
    )
    return patches, (*robot.unread, *left_out)


def object_shapes(objects: Iterable[SceneObject]) -> dict[str, Sequence[Shape]]:
    """List the shapes by which objects are seen: visual ones, or else collision shapes.

    Args:
        objects: The objects.

    Returns:
        Shapes by the name of their object.
    """
    return {each.name: each.link.visuals or each.link.collisions for each in objects}


def patches_of(
    shapes: Mapping[str, Sequence[Shape]],
) -> tuple[dict[str, list[Patch]], tuple[str, ...]]:
    """Find the triangles of links or objects.

    Args:
        shapes: Their shapes, by name.

    Returns:
        One patch per colour by name, where there are any, and messages on what cannot
        be used.
    """
    meshes, left_out = find_meshes(s for some in shapes.values() for s in some)
    patches = {
        name: _merged(
            look
            for shape in some
            if is_there(shape, meshes)
            for part in shape_parts(shape, meshes.get(shape.filename))
            for look in [(part.corners, part.color or GREY)]
        )
        for name, some in shapes.items()
    }
    return {name: some for name, some in patches.items() if some}, left_out


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
    """Make the triangles of a box or a round shape, or a part of a plane."""
    if shape.kind == "plane":
        normal = np.array(shape.size)
        corners = PLANE * (_SQUARE @ _sides(normal))
        color = (*(shape.color or GREY)[:3], SEE_THROUGH)
        return Part(corners, np.broadcast_to(normal, corners.shape), color)
    if shape.kind == "box":
        corners = _BOX * np.array(shape.size)
        edges = np.cross(_BOX[:, 1] - _BOX[:, 0], _BOX[:, 2] - _BOX[:, 0])
        return Part(corners, np.repeat(edges[:, np.newaxis], 3, axis=1), None)
    surface = ROUND[shape.kind](*shape.size)
    triangles = surface.triangles
    return Part(surface.vertices[triangles], surface.normals[triangles], None)


def _sides(normal: np.ndarray) -> np.ndarray:
    """Return two directions in a plane, anticlockwise about its normal, (2, 3)."""
    first = np.cross(np.eye(3)[np.argmin(np.abs(normal))], normal)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(normal, first)])


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
