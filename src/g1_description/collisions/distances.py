"""Contacts between the shapes of links, over many configurations.

Three stages leave out pairs that are certainly apart, for all configurations at once:
spheres, boxes, and a search for a plane between the shapes. PyBullet then finds the
direction of the least overlap, one pair after the other. The distance is that between
the two planes across this direction that bound the shapes: it does not rely on
PyBullet's numbers, and is never more than the true distance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from g1_description.collisions.convex_shapes import (
    ConvexShape,
    Placed,
    axes_of,
    place,
    turn,
)
from g1_description.collisions.separation import Separation
from g1_description.sim.bullet.client import connect, pybullet


class Bounds:
    """A sphere and a box about each shape, in the frame of its link."""

    def __init__(self, shapes: Sequence[ConvexShape]) -> None:
        boxes = [_box(shape) for shape in shapes]
        self._link = np.array([shape.link for shape in shapes], dtype=int)
        self._center = np.array([center for center, _, _ in boxes]).reshape(-1, 3)
        self._axes = np.array([axes for _, axes, _ in boxes]).reshape(-1, 3, 3)
        self._half = np.array([half for _, _, half in boxes]).reshape(-1, 3)
        self._radius = np.linalg.norm(self._half, axis=1)

    def near(
        self, T_world_link: np.ndarray, axes: np.ndarray, pairs: np.ndarray, gap: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Find the pairs whose spheres are near each other.

        Args:
            T_world_link: Poses of the links, shape (n_frames, n_links, 7).
            axes: The same rotations as matrices, shape (n_frames, n_links, 3, 3).
            pairs: Indices of shapes, shape (n_pairs, 2).
            gap: Pairs this far apart or farther are left out, in [m].

        Returns:
            Frames and rows of ``pairs``, shapes (n,).
        """
        turned = axes[:, self._link] @ self._center[:, :, np.newaxis]
        center = T_world_link[:, self._link, :3] + turned[..., 0]
        apart = center[:, pairs[:, 0]] - center[:, pairs[:, 1]]
        reach = self._radius[pairs].sum(axis=1) + gap
        squared = np.einsum("fpi,fpi->fp", apart, apart)
        frames, rows = np.nonzero(squared < reach**2)
        return frames, rows

    def overlap(self, placed: Placed, gap: float) -> np.ndarray:
        """Find the pairs that no side of their boxes separates.

        Args:
            placed: Pairs of shapes.
            gap: Pairs this far apart or farther are left out, in [m].

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


MARGIN = 0.001
"""How thick PyBullet makes a hull on all sides, in [m]."""


@dataclass(frozen=True)
class Closest:
    """Where shapes are closest to each other, or overlap deepest."""

    distance: np.ndarray
    """In [m], negative where they overlap, NaN where PyBullet found nothing, shape
    (n,). The error is 0.05 mm, but some millimetres in three of ten thousand pairs."""

    direction: np.ndarray
    """From a to b, in the frame of a's link, shape (n, 3)."""

    middle: np.ndarray
    """Point between those of a and b, in the frame of a's link, shape (n, 3)."""


class ClosestPoints:
    """The shapes of a robot in a PyBullet of its own.

    Each is there twice: once at the origin, and once to be placed relative to others,
    so that an answer depends on nothing but where one shape is in the frame of the
    other.
    """

    def __init__(self, shapes: Sequence[ConvexShape]) -> None:
        self._client = connect()
        self._margin = [0.0 if shape.radius else MARGIN for shape in shapes]
        forms = [self._create(shape) for shape in shapes]
        self._still, self._placed = (
            [self._client.createMultiBody(0.0, form) for form in forms]
            for _ in range(2)
        )

    def _create(self, shape: ConvexShape) -> int:
        """Create a shape; return its number."""
        client = self._client
        if shape.radius:
            center = shape.points[0].tolist()
            return int(
                client.createCollisionShape(
                    pybullet.GEOM_SPHERE,
                    radius=shape.radius,
                    collisionFramePosition=center,
                )
            )
        vertices = shape.points.tolist()
        return int(client.createCollisionShape(pybullet.GEOM_MESH, vertices=vertices))

    def find(self, placed: Placed, reach: float) -> Closest:
        """Find the closest points of pairs.

        Args:
            placed: Pairs of shapes.
            reach: Pairs farther apart than this may be passed over, in [m].
        """
        # PyBullet's own functions: the client's cost a microsecond more each.
        move, find = pybullet.resetBasePositionAndOrientation, pybullet.getClosestPoints
        client = self._client._client
        rows = zip(
            placed.a.tolist(),
            placed.b.tolist(),
            placed.origin.tolist(),
            placed.rotation.tolist(),
        )
        found = np.full((len(placed.a), 10), np.nan)
        for row, (a, b, origin, rotation) in enumerate(rows):
            body = self._placed[b]
            move(body, origin, rotation, physicsClientId=client)
            points = find(self._still[a], body, reach, physicsClientId=client)
            if points:
                deepest = min(points, key=_distance)
                thick = self._margin[a] + self._margin[b]
                found[row] = (deepest[8] + thick, *deepest[7], *deepest[5], *deepest[6])
        return Closest(
            distance=found[:, 0],
            direction=-found[:, 1:4],
            middle=(found[:, 4:7] + found[:, 7:]) / 2.0,
        )


def _distance(point: tuple) -> float:
    """Give the distance of a contact point of PyBullet's."""
    return float(point[8])


CHUNK = 256
"""Configurations that are checked at once: bounds memory, no result depends on it."""

SLACK = 5e-4
"""Additional gap of the pairs that are left out early, in [m]. It is more than PyBullet
is wrong by, so that which stage leaves out a pair is not seen."""

DOUBT = 1e-4
"""Greatest difference of PyBullet's distance from that of the planes, in [m]: one that
is greater comes from a wrong direction."""


@dataclass(frozen=True)
class Contacts:
    """Pairs of links that are nearer than a margin, by frames, then pairs."""

    frame: np.ndarray
    """Index of the configuration, shape (n,)."""

    pair: np.ndarray
    """Index of the pair of links, shape (n,)."""

    distance: np.ndarray
    """In [m]; negative: how far one must move for them to be apart, shape (n,)."""

    points_a: np.ndarray
    points_b: np.ndarray
    """Where the links are closest or deepest in each other, in the world, in [m], shape
    (n, 3). ``points_b - points_a`` is ``distance * normal``."""

    normal: np.ndarray
    """Directions from the first link of the pair to the second, in the world, shape
    (n, 3)."""

    def __getitem__(self, rows: np.ndarray) -> Contacts:
        """Select some of them."""
        return Contacts(*(getattr(self, part.name)[rows] for part in fields(self)))


class ShapeCollisions:
    """Finds contacts between the shapes of links."""

    def __init__(self, shapes: Sequence[ConvexShape]) -> None:
        self._of_link: dict[int, list[int]] = {}
        for number, shape in enumerate(shapes):
            self._of_link.setdefault(shape.link, []).append(number)
        self._link = np.array([shape.link for shape in shapes], dtype=int)
        self._bounds = Bounds(shapes)
        self._separation = Separation(shapes)
        self._closest = ClosestPoints(shapes)

    def contacts(
        self,
        link_poses: np.ndarray,
        pairs: Sequence[tuple[int, int]],
        margin: float = 0.0,
    ) -> Contacts:
        """Find the pairs of links that are nearer than a margin.

        Args:
            link_poses: Poses of the links in the world, shape (n, n_links, 7).
            pairs: Rows of links.
            margin: In [m].
        """
        return self.between(link_poses, self.shape_pairs(pairs), margin)

    def between(
        self, link_poses: np.ndarray, rows: np.ndarray, margin: float = 0.0
    ) -> Contacts:
        """Find the pairs of links that are nearer than a margin.

        Args:
            link_poses: Poses of the links in the world, shape (n, n_links, 7).
            rows: Shapes, as ``shape_pairs`` returns them.
            margin: In [m].
        """
        parts = [
            self._chunk(link_poses[first : first + CHUNK], rows, margin, first)
            for first in range(0, max(len(link_poses), 1), CHUNK)
        ]
        return Contacts(
            *(
                np.concatenate([getattr(part, field.name) for part in parts])
                for field in fields(Contacts)
            )
        )

    def shape_pairs(self, pairs: Sequence[tuple[int, int]]) -> np.ndarray:
        """List the pairs of shapes of pairs of links.

        Returns:
            Indices of two shapes and of the pair of links, shape (n, 3).
        """
        shapes = [
            (a, b, number)
            for number, (link_a, link_b) in enumerate(pairs)
            for a in self._of_link.get(link_a, ())
            for b in self._of_link.get(link_b, ())
        ]
        return np.array(shapes, dtype=int).reshape(-1, 3)

    def _chunk(
        self, link_poses: np.ndarray, rows: np.ndarray, margin: float, first: int
    ) -> Contacts:
        """Find the contacts of some frames.

        Args:
            link_poses: Poses of the links in the world, shape (n, n_links, 7).
            rows: As ``shape_pairs`` returns them.
            margin: In [m].
            first: Index of the first frame.
        """
        frame, pair, placed = self.candidates(link_poses, rows, margin + SLACK)
        gaps = self._measure(placed, margin)
        near = np.flatnonzero(gaps.width < margin)
        frame, pair, distance = frame[near], pair[near], gaps.width[near]
        pose = link_poses[frame, self._link[placed.a[near]]]
        axes = axes_of(pose[:, 3:])
        normal = turn(axes, gaps.direction[near])
        points_a = pose[:, :3] + turn(axes, gaps.point_a[near])
        points_b = points_a + distance[:, np.newaxis] * normal
        found = Contacts(frame + first, pair, distance, points_a, points_b, normal)
        return found[_deepest(found)]

    def candidates(
        self, link_poses: np.ndarray, rows: np.ndarray, gap: float
    ) -> tuple[np.ndarray, np.ndarray, Placed]:
        """Find what may be nearer than a gap, all frames at once.

        Args:
            link_poses: Poses of the links in the world, shape (n, n_links, 7).
            rows: As ``shape_pairs`` returns them.
            gap: In [m].

        Returns:
            Frames and pairs of links, shapes (m,), and the shapes.
        """
        n_frames, n_links = link_poses.shape[:2]
        axes = axes_of(link_poses.reshape(-1, 7)[:, 3:])
        axes = axes.reshape(n_frames, n_links, 3, 3)
        frame, row = self._bounds.near(link_poses, axes, rows[:, :2], gap)
        a, b, pair = rows[row].T
        link_a, link_b = self._link[a], self._link[b]
        poses = link_poses[frame, link_a], link_poses[frame, link_b]
        placed = place(a, b, *poses, axes[frame, link_a])
        kept = self._bounds.overlap(placed, gap)
        kept = kept[~self._separation.apart(placed[kept], gap)]
        return frame[kept], pair[kept], placed[kept]

    def _measure(self, placed: Placed, margin: float) -> _Gaps:
        """Measure the gaps between pairs."""
        if not len(placed.a):
            return _Gaps(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
        closest = self._closest.find(placed, margin + SLACK)
        is_near = ~np.isnan(closest.distance)
        direction = np.where(is_near[:, np.newaxis], closest.direction, 0.0)
        middle = np.where(is_near[:, np.newaxis], closest.middle, 0.0)
        gaps = self._gaps(placed, direction, middle)
        gaps.width[~is_near] = np.inf
        near = np.flatnonzero(is_near)  # numpy 1.17 warns of a comparison with NaN
        off = np.abs(gaps.width[near] - closest.distance[near])
        for row in near[off > DOUBT].tolist():
            self._reconsider(gaps, placed, row, middle[row])
        return gaps

    def _gaps(self, placed: Placed, direction: np.ndarray, middle: np.ndarray) -> _Gaps:
        """Measure gaps along directions.

        Args:
            placed: Pairs of shapes.
            direction: From a to b, in the frames of a's links, shape (n, 3).
            middle: Points that gaps are about, likewise, in [m], shape (n, 3).
        """
        end_a, end_b = self._separation.faces(placed, direction)
        x, y, z = (middle * direction).T
        point_a = middle + (end_a - (x + y + z))[:, np.newaxis] * direction
        return _Gaps(end_b - end_a, direction, point_a)

    def _reconsider(
        self, gaps: _Gaps, placed: Placed, row: int, middle: np.ndarray
    ) -> None:
        """Improve a gap whose direction is not the best one.

        Of all directions, that with the widest gap is right. PyBullet often finds it
        when the two shapes change places; mostly it is the normal of a face.

        Args:
            gaps: The gaps.
            placed: Pairs of shapes.
            row: Which of them.
            middle: Point that the gap is about, in the frame of a's link, shape (3,).
        """
        back = self._closest.find(placed[[row]].swapped(), SLACK)
        others = -turn(placed.axes[[row]], back.direction)
        others = others[~np.isnan(back.distance)]
        tried = np.concatenate([others, self._separation.normals(placed, row)])
        if len(tried):
            tries = self._gaps(placed[[row] * len(tried)], tried, middle)
            best = tries.width.argmax()
            if tries.width[best] > gaps.width[row]:
                gaps.width[row] = tries.width[best]
                gaps.direction[row] = tries.direction[best]
                gaps.point_a[row] = tries.point_a[best]


@dataclass(frozen=True)
class _Gaps:
    """Gaps between pairs of shapes, in the frames of a's links."""

    width: np.ndarray
    """In [m], negative where shapes overlap, infinite where they are far apart, shape
    (n,)."""

    direction: np.ndarray
    """Across the gap, from a to b, shape (n, 3)."""

    point_a: np.ndarray
    """Where the gap begins, in [m], shape (n, 3)."""


def _deepest(found: Contacts) -> np.ndarray:
    """Select the deepest contact of each frame and pair, in their order."""
    order = np.lexsort((found.distance, found.pair, found.frame))
    frame, pair = found.frame[order], found.pair[order]
    is_new = np.ones(len(order), dtype=bool)
    is_new[1:] = (frame[1:] != frame[:-1]) | (pair[1:] != pair[:-1])
    return order[is_new]
