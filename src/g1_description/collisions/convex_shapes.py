"""Convex shapes of the links of a robot, for collision checks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from g1_description.robot.assembly import WORLD
from g1_description.robot.description import Description, Link, Shape
from g1_description.robot.rotation import rotate
from g1_description.sim.meshes.hulls import hull_points, hull_vertices, outline, thinned
from g1_description.sim.meshes.shapes import Mesh, find_meshes, is_there

TOLERANCE = 5e-4
"""Largest distance by which thinning may shrink a hull with many points, in [m]:
PyBullet's run time grows with the number of points."""


@dataclass(frozen=True)
class ConvexShape:
    """All points within a radius of the convex hull of some points."""

    link: int
    """Row of its link in ``posed_links``."""

    points: np.ndarray
    """Vertices of a hull in the link frame, in [m], shape (n, 3)."""

    radius: float
    """In [m]: the radius of a sphere, which has one point, or of a capsule, which has
    two; else 0."""


def robot_shapes(
    description: Description, visual_hulls: bool = True
) -> tuple[tuple[ConvexShape, ...], tuple[str, ...]]:
    """Find the shapes of the links of a robot.

    Args:
        description: The robot, with absolute mesh URIs.
        visual_hulls: Whether links without collision shapes use the convex hulls of
            their visuals.

    Returns:
        In the order of the links: boxes, cylinders (as prisms) and meshes as convex
        hulls, with a hull for each part of a collision mesh; spheres and capsules
        exactly. Planes are ignored. And messages on what cannot be read.
    """
    links = posed_links(description)
    used = [
        [
            shape
            for shape in link.collisions or (link.visuals if visual_hulls else ())
            if shape.kind != "plane"
        ]
        for link in links
    ]
    meshes, left_out = find_meshes(shape for shapes in used for shape in shapes)
    found = []
    for row, (link, shapes) in enumerate(zip(links, used)):
        found += _convex(row, shapes, meshes, is_split=bool(link.collisions))
    return tuple(found), (*description.unread, *left_out)


def posed_links(description: Description) -> list[Link]:
    """List the links that have poses: all but the world."""
    root_is_world = description.root == WORLD
    return [x for x in description.links if not (root_is_world and x.name == WORLD)]


def _convex(
    row: int, shapes: Sequence[Shape], meshes: Mapping[str, Mesh], is_split: bool
) -> list[ConvexShape]:
    """Make the convex shapes of a link.

    Args:
        row: The link's.
        shapes: Its shapes.
        meshes: By the names of their files.
        is_split: Whether each part of a mesh becomes a hull of its own.
    """
    return [
        ConvexShape(row, shape.pose[:3] + rotate(shape.pose[3:], points), radius)
        for shape in shapes
        if is_there(shape, meshes)
        for points, radius in _hulls(shape, meshes, is_split)
    ]


def _hulls(
    shape: Shape, meshes: Mapping[str, Mesh], is_split: bool
) -> Iterator[tuple[np.ndarray, float]]:
    """Yield vertices in a shape's frame, shape (n, 3), with the radius around them."""
    if shape.kind == "mesh" and is_split:
        for part in hull_points(meshes[shape.filename]):
            yield _few(part * np.array(shape.size)), 0.0
    else:
        points, radius = outline(shape, meshes)
        yield _few(points), radius


def _few(points: np.ndarray) -> np.ndarray:
    """Select points with almost the same convex hull, shape (m, 3)."""
    few, _ = thinned(hull_vertices(points), TOLERANCE)
    return few


# Entries of a rotation matrix, row by row: each has two products of the quaternion's
# parts, of which the second is added or subtracted.
_FIRST = np.array([[1, 0, 0, 0, 0, 1, 0, 1, 0], [1, 1, 2, 1, 0, 2, 2, 2, 0]])
_SECOND = np.array([[2, 3, 3, 3, 2, 3, 3, 3, 1], [2, 2, 1, 2, 2, 0, 1, 0, 1]])
_SIGN = np.array([1.0, -1.0, 1.0, 1.0, 1.0, -1.0, -1.0, 1.0, 1.0])
_DIAGONAL = [0, 4, 8]


def axes_of(q: np.ndarray) -> np.ndarray:
    """Convert quaternions to rotation matrices.

    Args:
        q: Unit quaternions (x, y, z, w), shape (n, 4).

    Returns:
        Matrices, shape (n, 3, 3).
    """
    first = q[:, _FIRST[0]] * q[:, _FIRST[1]]
    second = q[:, _SECOND[0]] * q[:, _SECOND[1]]
    entries = 2.0 * (first + _SIGN * second)
    entries[:, _DIAGONAL] = 1.0 - entries[:, _DIAGONAL]
    return entries.reshape(-1, 3, 3)


def turn(axes: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Apply rotation matrices, shape (n, 3, 3), to vectors, shape (n, 3)."""
    return (
        axes[:, :, 0] * vectors[:, :1]
        + axes[:, :, 1] * vectors[:, 1:2]
        + axes[:, :, 2] * vectors[:, 2:]
    )


@dataclass(frozen=True)
class ShapePairs:
    """Pairs of shapes, the second placed in the link frame of the first."""

    a: np.ndarray
    b: np.ndarray
    """Indices of shapes, shape (n,)."""

    axes: np.ndarray
    """Rotation matrices that take coordinates of b's link to a's, shape (n, 3, 3)."""

    origin: np.ndarray
    """Origin of b's link in the frame of a's, in [m], shape (n, 3)."""

    rotation: np.ndarray
    """Quaternions (x, y, z, w) of ``axes``, shape (n, 4)."""

    def __getitem__(self, rows: np.ndarray | list[int]) -> ShapePairs:
        parts = (self.a, self.b, self.axes, self.origin, self.rotation)
        return ShapePairs(*(part[rows] for part in parts))

    def swapped(self) -> ShapePairs:
        """Return the same pairs with the first placed in the frame of the second."""
        axes = np.swapaxes(self.axes, 1, 2)
        conjugate = self.rotation * np.array([-1.0, -1.0, -1.0, 1.0])
        return ShapePairs(self.b, self.a, axes, -turn(axes, self.origin), conjugate)


# Parts of a product of a conjugate and a quaternion, x, y, z, w: besides that with the
# first one's w, each is a sum of three products.
_LEFT = np.array([[0, 1, 2, 0], [1, 2, 0, 1], [2, 0, 1, 2]])
_RIGHT = np.array([[3, 3, 3, 0], [2, 0, 1, 1], [1, 2, 0, 2]])
_SIGNS = np.array([[-1.0, -1.0, -1.0, 1.0], [-1.0, -1.0, -1.0, 1.0], [1.0] * 4])


def place(
    a: np.ndarray,
    b: np.ndarray,
    poses_a: np.ndarray,
    poses_b: np.ndarray,
    axes_a: np.ndarray,
) -> ShapePairs:
    """Place shapes relative to others.

    Args:
        a: Indices of shapes, shape (n,).
        b: Indices of shapes, shape (n,).
        poses_a: Poses of the links of the first in the world, shape (n, 7).
        poses_b: Poses of the links of the second, shape (n, 7).
        axes_a: Rotations of the links of the first as matrices, shape (n, 3, 3).
    """
    q_a, q_b = poses_a[:, 3:], poses_b[:, 3:]
    rotation = q_a[:, 3:] * q_b
    for left, right, signs in zip(_LEFT, _RIGHT, _SIGNS):
        rotation += signs * (q_a[:, left] * q_b[:, right])
    origin = turn(np.swapaxes(axes_a, 1, 2), poses_b[:, :3] - poses_a[:, :3])
    return ShapePairs(a, b, axes_of(rotation), origin, rotation)
