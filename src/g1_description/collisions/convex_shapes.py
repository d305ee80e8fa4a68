"""Convex shapes of the links of a robot, and tests that they are apart.

The tests are by bounding spheres, by boxes and by separating planes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from g1_description.robot.assembly import WORLD
from g1_description.robot.description import Description, Link, Shape
from g1_description.robot.rotation import rotate
from g1_description.sim.meshes.hulls import (
    hull_points,
    hull_vertices,
    outline,
    thinned,
)
from g1_description.sim.meshes.shapes import Mesh, find_meshes, is_there

TOLERANCE = 5e-4
"""Largest distance by which thinning may shrink a hull with many points, in [m]:
PyBullet's run time grows with the number of points."""

MAX_SIDES = 256
"""Most sides of a prism for a cylinder."""


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
    description: Description, visual_hulls: bool = True, tolerance: float = TOLERANCE
) -> tuple[tuple[ConvexShape, ...], tuple[str, ...]]:
    """Find the shapes of the links of a robot.

    Args:
        description: The robot, with absolute mesh URIs.
        visual_hulls: Whether links without collision shapes use the convex hulls of
            their visuals.
        tolerance: As for ``link_shapes``.

    Returns:
        In the order of the links: boxes, cylinders (as prisms) and meshes as convex
        hulls, with a hull for each part of a collision mesh; spheres and capsules
        exactly. Planes are ignored. And messages on what cannot be read.
    """
    found, left_out = link_shapes(posed_links(description), visual_hulls, tolerance)
    return found, (*description.unread, *left_out)


def link_shapes(
    links: Sequence[Link], visual_hulls: bool, tolerance: float
) -> tuple[tuple[ConvexShape, ...], tuple[str, ...]]:
    """Find the shapes of links, as ``robot_shapes`` does.

    Args:
        links: The links; their rows are those of the shapes.
        visual_hulls: Whether links without collision shapes use those of their visuals.
        tolerance: Largest distance by which thinning may shrink a hull with many
            points, and of a prism from its cylinder, in [m].
    """
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
        found += [
            ConvexShape(row, shape.pose[:3] + rotate(shape.pose[3:], points), radius)
            for shape in shapes
            if is_there(shape, meshes)
            for points, radius in _hulls(
                shape, meshes, bool(link.collisions), tolerance
            )
        ]
    return tuple(found), left_out


def posed_links(description: Description) -> list[Link]:
    """List the links that have poses: all but the world."""
    root_is_world = description.root == WORLD
    return [x for x in description.links if not (root_is_world and x.name == WORLD)]


def _hulls(
    shape: Shape, meshes: Mapping[str, Mesh], is_split: bool, tolerance: float
) -> Iterator[tuple[np.ndarray, float]]:
    """Yield vertices in a shape's frame, shape (n, 3), with the radius around them.

    Each part of a split mesh is a hull of its own.
    """
    if shape.kind == "mesh" and is_split:
        for part in hull_points(meshes[shape.filename]):
            yield _few(part * np.array(shape.size), tolerance), 0.0
    elif shape.kind == "cylinder" and tolerance < TOLERANCE:
        radius, length = shape.size
        yield _fine_cylinder(radius, length, tolerance), 0.0
    else:
        points, radius = outline(shape, meshes)
        yield _few(points, tolerance), radius


def _few(points: np.ndarray, tolerance: float) -> np.ndarray:
    """Select points with almost the same convex hull, shape (m, 3)."""
    return thinned(hull_vertices(points), tolerance)[0]


def _fine_cylinder(radius: float, length: float, tolerance: float) -> np.ndarray:
    """Make a prism within a tolerance of a cylinder, inside and outside of it."""
    half = np.arccos(1.0 - min(2.0 * tolerance / radius, 0.5))
    count = int(np.clip(np.ceil(np.pi / half), 8, MAX_SIDES))
    angle = np.arange(count) * (2.0 * np.pi / count)
    outer = 2.0 * radius / (1.0 + np.cos(np.pi / count))
    circle = outer * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    ends = [np.insert(circle, 2, z, axis=1) for z in (length / 2, -length / 2)]
    return np.concatenate(ends)


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


class Bounds:
    """A sphere and a box about each shape, in the frame of its link."""

    def __init__(self, shapes: Sequence[ConvexShape]) -> None:
        boxes = [_box(shape) for shape in shapes]
        self._link = np.array([shape.link for shape in shapes], dtype=int)
        self._center = np.array([center for center, _, _ in boxes]).reshape(-1, 3)
        self._axes = np.array([axes for _, axes, _ in boxes]).reshape(-1, 3, 3)
        self._half = np.array([half for _, _, half in boxes]).reshape(-1, 3)
        self._radius = np.linalg.norm(self._half, axis=1)

    def spheres(self, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Place the spheres.

        Args:
            poses: Poses of the links in the world, shape (n, n_links, 7).

        Returns:
            Centres in the world, shape (n, n_shapes, 3), and radii, shape (n_shapes,),
            in [m].
        """
        own = poses[:, self._link]
        return own[..., :3] + rotate(own[..., 3:], self._center), self._radius

    def near(
        self, T_world_link: np.ndarray, axes: np.ndarray, pairs: np.ndarray, gap: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Find the pairs whose spheres are near each other.

        Args:
            T_world_link: Poses of the links, shape (n_samples, n_links, 7).
            axes: These rotations as matrices, shape (n_samples, n_links, 3, 3).
            pairs: Indices of shapes, shape (n_pairs, 2).
            gap: Pairs this far apart or farther are excluded, in [m].

        Returns:
            Samples and rows of ``pairs``, shapes (n,).
        """
        turned = axes[:, self._link] @ self._center[:, :, np.newaxis]
        center = T_world_link[:, self._link, :3] + turned[..., 0]
        apart = center[:, pairs[:, 0]] - center[:, pairs[:, 1]]
        reach = self._radius[pairs].sum(axis=1) + gap
        squared = np.einsum("fpi,fpi->fp", apart, apart)
        samples, rows = np.nonzero(squared < reach**2)
        return samples, rows

    def overlap(self, placed: ShapePairs, gap: float) -> np.ndarray:
        """Find the pairs that are not separated by a face of their boxes.

        Args:
            placed: Pairs of shapes.
            gap: Pairs this far apart or farther are excluded, in [m].

        Returns:
            Rows of ``placed``, shape (n,).
        """
        a, b = placed.a, placed.b
        axes_a, axes_b = self._axes[a], placed.axes @ self._axes[b]
        center_b = (placed.axes @ self._center[b][:, :, np.newaxis])[..., 0]
        apart = (placed.origin + center_b - self._center[a])[:, np.newaxis]
        slopes = np.abs(np.swapaxes(axes_a, 1, 2) @ axes_b)
        half_a, half_b = self._half[a][:, np.newaxis], self._half[b][:, np.newaxis]
        reach_b = (slopes @ np.swapaxes(half_b, 1, 2))[..., 0]
        along_a = np.abs(apart @ axes_a)[:, 0] - half_a[:, 0] - reach_b
        along_b = np.abs(apart @ axes_b)[:, 0] - half_b[:, 0] - (half_a @ slopes)[:, 0]
        return np.flatnonzero(np.maximum(along_a, along_b).max(axis=1) < gap)


def _box(shape: ConvexShape) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find the smaller of two boxes: along the link's axes, or the principal ones.

    Returns:
        Its centre, shape (3,), its axes as columns, shape (3, 3), and half its sides,
        shape (3,), in the link frame, in [m].
    """
    centered = shape.points - shape.points.mean(axis=0)
    boxes = []
    for axes in (np.eye(3), np.linalg.svd(centered.T @ centered)[0]):
        along = shape.points @ axes
        low, high = along.min(axis=0) - shape.radius, along.max(axis=0) + shape.radius
        boxes.append((axes @ (low + high) / 2.0, axes, (high - low) / 2.0))
    return min(boxes, key=lambda box: float(np.prod(box[2])))


ROUNDS = 4
"""Iterations of a search: pairs that are not separated by then mostly collide."""

FEW = 32
"""Up to this number, all shapes are searched at once, which is faster but needs more
memory."""

TINY = 1e-12
"""Length below which a vector has no direction, in [m]."""


class Separation:
    """Gaps between the shapes of a robot."""

    def __init__(self, shapes: Sequence[ConvexShape]) -> None:
        self._shapes = shapes
        self._radius = np.array([shape.radius for shape in shapes])
        middles = [(s.points.min(axis=0) + s.points.max(axis=0)) / 2 for s in shapes]
        self._middle = np.array(middles).reshape(-1, 3)
        self._padded = _padded([shape.points for shape in shapes])

    def apart(self, placed: ShapePairs, gap: float) -> np.ndarray:
        """Find pairs that a plane separates, by their farthest points.

        The search is that of Chung and Wang (1996): a direction along which the shapes
        overlap is reflected by the direction between their farthest points.

        Args:
            placed: Pairs of shapes.
            gap: Least width of the gap, in [m].

        Returns:
            Whether such a plane was found, shape (n,).
        """
        found = np.zeros(len(placed.a), dtype=bool)
        rows, direction = np.arange(len(placed.a)), self.between_middles(placed)
        for _ in range(ROUNDS):
            if not len(rows):
                break
            step = self.between_ends(placed, direction)
            radii = self._radius[placed.a] + self._radius[placed.b]
            is_apart = (direction * step).sum(axis=1) - radii > gap
            found[rows[is_apart]] = True
            left = np.flatnonzero(~is_apart)
            rows, placed = rows[left], placed[left]
            step, direction = _unit(step[left]), direction[left]
            turned = np.minimum((direction * step).sum(axis=1, keepdims=True), 0.0)
            direction = _unit(direction - 2.0 * turned * step)
        return found

    def between_ends(self, placed: ShapePairs, direction: np.ndarray) -> np.ndarray:
        """Find vectors from the last points of a along directions to the first of b.

        Args:
            placed: Pairs of shapes.
            direction: Unit vectors in the frames of a, shape (n, 3).

        Returns:
            In the frames of a, in [m], shape (n, 3).
        """
        backwards = -(direction[:, np.newaxis] @ placed.axes)[:, 0]
        end_a = self._per_shape(placed.a, direction, _support_points)
        end_b = self._per_shape(placed.b, backwards, _support_points)
        return (placed.axes @ end_b[:, :, np.newaxis])[..., 0] + placed.origin - end_a

    def between_middles(self, placed: ShapePairs) -> np.ndarray:
        """Return the directions between the centres of shapes.

        Returns:
            Unit vectors in the frames of a, shape (n, 3).
        """
        middle_b = turn(placed.axes, self._middle[placed.b]) + placed.origin
        return _unit(middle_b - self._middle[placed.a])

    def support_points(self, which: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Find the farthest points of shapes along directions.

        Args:
            which: Indices of shapes, shape (n,).
            directions: In the frames of their links, shape (n, k, 3).

        Returns:
            In the same frames, in [m], shape (n, k, 3).
        """
        result = np.zeros(directions.shape)
        for shape, rows in self._grouped(which):
            some = directions[rows]
            points = _support_points(shape, some.reshape(-1, 3))
            result[rows] = points.reshape(some.shape)
        return result

    def _grouped(self, which: np.ndarray) -> Iterator[tuple[ConvexShape, np.ndarray]]:
        """Yield each shape, and the rows of an array of indices that have it."""
        order = np.argsort(which, kind="stable")
        shapes, first = np.unique(which[order], return_index=True)
        for shape, rows in zip(shapes.tolist(), np.split(order, first[1:])):
            yield self._shapes[shape], rows

    def extents(
        self, placed: ShapePairs, direction: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Find the extents of shapes along directions.

        Args:
            placed: Pairs of shapes.
            direction: Unit vectors from a to b, in the frames of a, shape (n, 3).

        Returns:
            The end of a and the beginning of b along the direction, from the origin of
            a's frame, in [m], shapes (n,). Their difference is a lower bound of the
            distance; negative if they overlap.
        """
        backwards = -turn(np.swapaxes(placed.axes, 1, 2), direction)
        end_a = self._per_shape(placed.a, direction, _extents)[:, 0]
        end_b = self._per_shape(placed.b, backwards, _extents)[:, 0]
        x, y, z = (placed.origin * direction).T
        return (
            end_a + self._radius[placed.a],
            x + y + z - end_b - self._radius[placed.b],
        )

    def _per_shape(
        self,
        which: np.ndarray,
        directions: np.ndarray,
        function: Callable[[ConvexShape, np.ndarray], np.ndarray],
    ) -> np.ndarray:
        """Evaluate a function per shape, for all its directions at once."""
        if len(which) <= FEW:
            return self._per_row(which, directions, function is _support_points)
        result = np.zeros((len(which), 3 if function is _support_points else 1))
        for shape, rows in self._grouped(which):
            result[rows] = function(shape, directions[rows])
        return result

    def _per_row(
        self, which: np.ndarray, directions: np.ndarray, is_farthest: bool
    ) -> np.ndarray:
        """Evaluate few directions at once, with an array of all shapes' points."""
        points = self._padded[which]
        x, y, z = directions.T[:, :, np.newaxis]
        along = x * points[..., 0] + y * points[..., 1] + z * points[..., 2]
        if is_farthest:
            return np.asarray(points[np.arange(len(which)), along.argmax(axis=1)])
        return np.asarray(along.max(axis=1, keepdims=True))


def _support_points(shape: ConvexShape, directions: np.ndarray) -> np.ndarray:
    """Find the farthest of the points of a shape, shape (n, 3)."""
    return shape.points[(directions @ shape.points.T).argmax(axis=1)]


def _padded(points: Sequence[np.ndarray]) -> np.ndarray:
    """Pad the points of shapes to equal numbers, shape (n, k, 3)."""
    most = max((len(rows) for rows in points), default=0)
    parts = [np.concatenate([r, np.repeat(r[:1], most - len(r), 0)]) for r in points]
    return np.array(parts).reshape(len(points), most, 3)


def _extents(shape: ConvexShape, directions: np.ndarray) -> np.ndarray:
    """Find how far the points of a shape reach along directions, shape (n, 1)."""
    x, y, z = directions.T[:, :, np.newaxis]
    along = x * shape.points[:, 0] + y * shape.points[:, 1] + z * shape.points[:, 2]
    return along.max(axis=1, keepdims=True)


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Normalize vectors, shape (n, 3); zero vectors become x."""
    squared = np.einsum("ij,ij->i", vectors, vectors)[:, np.newaxis]
    unit = vectors / np.sqrt(np.maximum(squared, TINY * TINY))
    unit[squared[:, 0] <= TINY * TINY] = 1.0, 0.0, 0.0
    return np.asarray(unit)
