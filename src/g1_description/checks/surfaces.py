"""Flat, nearly level surfaces of objects, on which a robot stands as on a floor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from g1_description.checks.support import support_polygon
from g1_description.collisions.contacts import Contacts
from g1_description.collisions.convex_shapes import ConvexShape
from g1_description.collisions.obstacles import FLAT, Obstacles
from g1_description.robot.rotation import rotate

REACH = 0.05
"""Points up to this far below a surface, or half the thickness of the object, are still
in contact with it, in [m]; deeper ones are inside of the object or below it."""

BESIDE = 0.01
"""Points that are deeper by more than this than they are away from the edge have come
from the side, in [m]."""

EVEN = 1e-3
"""Largest distance of corners from the plane of a surface, in [m]."""

LEAST_AREA = 1e-3
"""Smallest area of a surface in [m^2]: balls are level only about their top."""


@dataclass(frozen=True, eq=False)
class FlatSurface:
    """A flat surface, level within ``FLAT``, that ends at a convex polygon."""

    row: int
    """Row of the object in the scene."""

    plane: np.ndarray
    """Its height in the map is the product with (x, y, 1), in [m], shape (3,)."""

    reach: float
    """Largest depth of points that are in contact with it, in [m]."""

    corners: np.ndarray | None
    """Corners along the map's x and y, counter-clockwise, in [m], shape (k, 2); None:
    it has no end."""

    def ends(self) -> np.ndarray:
        """Return the lower and the upper end in the map, in [m], shape (2, 3)."""
        if self.corners is None:
            return np.array([[-np.inf] * 3, [np.inf] * 3])
        corners = np.column_stack([self.corners, _heights(self.plane, self.corners)])
        return np.array([corners.min(axis=0), corners.max(axis=0)])


class Surfaces:
    """The flat surfaces of objects; an object that is ever carried has none."""

    def __init__(
        self, obstacles: Obstacles, object_poses: np.ndarray, floor: float
    ) -> None:
        """Find them.

        Args:
            obstacles: The objects and their shapes.
            object_poses: Poses in the map, in the order of the scene, shape
                (n_objects, 7).
            floor: Height of the floor in [m].
        """
        self.names = tuple(obstacles.scene)
        """Names of the objects."""
        self._objects = obstacles.pair_rows[:, 1] - obstacles.n_links
        self._tops: dict[int, list[np.ndarray]] = {}
        found = [*_surfaces(obstacles, object_poses)]
        for each in found:
            self._tops.setdefault(each.row, []).append(each.plane)
        ends = [each.ends() - [0.0, 0.0, floor] for each in found]
        above = [n for n, (_, high) in enumerate(ends) if high[2] > 0.0]
        self._rows = [found[n].row for n in above]
        self._planes = [found[n].plane - [0.0, 0.0, floor] for n in above]
        self._reach = [found[n].reach for n in above]
        self._edges = [_edges(found[n].corners) for n in above]
        self._low, self._high = (
            np.array([ends[n][end] for n in above]).reshape(-1, 3) for end in (0, 1)
        )

    def below(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Find the highest surface below each point of a link.

        A link that reaches deeper is not on a surface, but beside or inside the object.

        Args:
            points: In the map, heights relative to the floor, in [m], shape (n, k, 3).

        Returns:
            Heights of surfaces above the floor, in [m], and rows of their objects,
            shapes (n, k); 0 and -1 above the floor.
        """
        height, row = np.zeros(points.shape[:-1]), np.full(points.shape[:-1], -1)
        low, high = points.min(axis=(0, 1)), points.max(axis=(0, 1))
        for number in self.near(low, high):
            level, edges = _heights(self._planes[number], points), self._edges[number]
            depth = level - points[..., 2]
            inside = (points[..., :2] @ edges[:, :2].T + edges[:, 2]).min(axis=-1)
            deepest = np.where(inside >= 0.0, depth, -np.inf).max(axis=1, keepdims=True)
            is_above = (inside >= 0.0) & (depth <= inside + BESIDE)
            is_above &= (deepest <= self._reach[number]) & (level > height)
            height[is_above], row[is_above] = level[is_above], self._rows[number]
        return height, row

    def near(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """List the surfaces below a box.

        Args:
            low: Its lower corner, heights relative to the floor, in [m], shape (3,).
            high: Its upper corner, shape (3,).
        """
        is_near = (self._low[:, :2] <= high[:2]) & (self._high[:, :2] >= low[:2])
        is_near = is_near.all(axis=1) & (self._low[:, 2] <= high[2] + REACH)
        return np.flatnonzero(is_near)

    def reached(self, centers: np.ndarray, reaches: np.ndarray) -> np.ndarray:
        """Mark balls that may touch a surface.

        Args:
            centers: Their middles, heights relative to the floor, in [m], shape
                (n_balls, n, 3).
            reaches: Their radii in [m], shape (n_balls,).

        Returns:
            Shape (n_balls, n).
        """
        found = np.zeros(centers.shape[:2], dtype=bool)
        if not self._planes:
            return found
        around, reach = reaches.max(), reaches[:, np.newaxis, np.newaxis]
        low, high = centers.min(axis=(0, 1)), centers.max(axis=(0, 1))
        for number in self.near(low - around, high + around):
            is_over = (centers + reach >= self._low[number]).all(axis=-1)
            found |= is_over & (centers - reach <= self._high[number]).all(axis=-1)
        return found

    def holds(self, contacts: Contacts) -> np.ndarray:
        """Find the objects that contacts are on top of.

        Args:
            contacts: Of the robot with objects.

        Returns:
            Rows of the objects, -1 for contacts with other sides of objects, or deeper
            than ``REACH``, shape (n,).
        """
        found = self._objects[contacts.pair]
        is_top = (contacts.normal[:, 2] < -FLAT) & (contacts.distance > -REACH)
        for number in np.flatnonzero(is_top):
            point, planes = contacts.points_b[number], self._tops.get(found[number], ())
            heights = (_heights(plane, point) for plane in planes)
            is_top[number] = any(abs(z - point[2]) < 2.0 * EVEN for z in heights)
        return np.where(is_top, found, -1)


def _surfaces(obstacles: Obstacles, object_poses: np.ndarray) -> Iterator[FlatSurface]:
    """Yield the surfaces of all objects that are never carried."""
    objects = [*obstacles.scene.values()]
    for shape, normals in zip(obstacles.shapes, obstacles.face_normals):
        row = shape.link - obstacles.n_links
        if row >= 0 and not objects[row].attachments:
            yield from _tops(shape, normals, row, object_poses[row])
    for row, each in enumerate(objects):
        for flat in each.link.collisions:
            if flat.kind == "plane":
                pose = object_poses[row]
                normal = rotate(pose[3:], rotate(flat.pose[3:], np.array(flat.size)))
                if normal[2] > FLAT:
                    point = pose[:3] + rotate(pose[3:], flat.pose[:3])
                    yield FlatSurface(row, _plane(normal, point @ normal), REACH, None)


def _tops(
    shape: ConvexShape, normals: np.ndarray, row: int, pose: np.ndarray
) -> Iterator[FlatSurface]:
    """Yield the flat upper sides of a shape; normals are those of its faces."""
    points, normals = (
        pose[:3] + rotate(pose[3:], shape.points),
        rotate(pose[3:], normals),
    )
    normals = normals[normals[:, 2] > FLAT]
    along = points @ normals.T
    ends = along.max(axis=0)
    is_on = along > ends - EVEN
    known: list[np.ndarray] = []
    for number in np.argsort(-is_on.sum(axis=0), kind="stable"):
        own = is_on[:, number]
        if any((other >= own).all() for other in known):
            continue  # an uneven part of that surface
        known.append(own)
        corners = np.array(support_polygon(points[own, :2]))
        x, y = corners.T
        area = 0.5 * (x * np.roll(y, -1) - np.roll(x, -1) * y).sum()
        if area >= LEAST_AREA:
            reach = min(REACH, float(np.ptp(along[:, number])) / 2)
            plane = _plane(normals[number], ends[number])
            yield FlatSurface(row, plane, reach, corners)


def _plane(normal: np.ndarray, offset: float) -> np.ndarray:
    """Return the factors of the height of a plane, as in ``FlatSurface``."""
    return np.array([-normal[0], -normal[1], offset]) / normal[2]


def _heights(plane: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return the heights of a plane at points, shape (..., 2) or (..., 3)."""
    return np.asarray(plane[0] * points[..., 0] + plane[1] * points[..., 1] + plane[2])


def _edges(corners: np.ndarray | None) -> np.ndarray:
    """Find how far points are inside a polygon: (x, y, 1) times rows, shape (k, 3)."""
    if corners is None:
        return np.array([[0.0, 0.0, np.inf]])
    along = np.roll(corners, -1, axis=0) - corners
    inward = np.stack([-along[:, 1], along[:, 0]], axis=1)
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    return np.column_stack([inward, -(inward * corners).sum(axis=1)])
