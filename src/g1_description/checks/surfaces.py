"""Level surfaces of objects, on which a robot stands as on a floor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from g1_description.checks.support import support_polygon
from g1_description.collisions.contacts import Contacts
from g1_description.collisions.convex_shapes import ConvexShape
from g1_description.collisions.obstacles import Obstacles
from g1_description.robot.rotation import rotate

REACH = 0.05
"""Points up to this far below a surface, or half the thickness of the object, are still
in contact with it, in [m]; deeper ones are inside of the object or below it."""

BESIDE = 0.01
"""Points that are deeper by more than this than they are away from the edge have come
from the side, in [m]."""

FLAT = 1e-3
"""Differences in height within a level surface, in [m]."""

UPRIGHT = 0.999
"""Least cosine between the vertical and the normal of a level surface."""

LEAST_AREA = 1e-3
"""Smallest area of a surface in [m^2]: balls are level only about their top."""


@dataclass(frozen=True, eq=False)
class LevelSurface:
    """A level surface that ends at a convex polygon."""

    row: int
    """Row of the object in the scene."""

    height: float
    """In the map, in [m]."""

    reach: float
    """Largest depth of points that are in contact with it, in [m]."""

    corners: np.ndarray | None
    """Corners along the map's x and y, counter-clockwise, in [m], shape (k, 2); None:
    it has no end."""


class Surfaces:
    """The level surfaces of objects; an object that is ever carried has none."""

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
        found = sorted(_surfaces(obstacles, object_poses), key=lambda each: each.height)
        self.names = tuple(obstacles.scene)
        """Names of the objects."""
        self._objects = obstacles.pair_rows[:, 1] - obstacles.n_links
        self._tops: dict[int, list[float]] = {}
        for each in found:
            self._tops.setdefault(each.row, []).append(each.height)
        above = [each for each in found if each.height > floor]
        self._rows = [each.row for each in above]
        self._heights = np.array([each.height - floor for each in above])
        self._reach = [each.reach for each in above]
        self._edges = [_edges(each.corners) for each in above]
        everywhere = np.array([[-np.inf] * 2, [np.inf] * 2])
        ends = [everywhere if e.corners is None else e.corners for e in above]
        shape = (len(above), 2)
        self._low = np.array([each.min(axis=0) for each in ends]).reshape(shape)
        self._high = np.array([each.max(axis=0) for each in ends]).reshape(shape)

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
            depth, edges = self._heights[number] - points[..., 2], self._edges[number]
            inside = (points[..., :2] @ edges[:, :2].T + edges[:, 2]).min(axis=-1)
            deepest = np.where(inside >= 0.0, depth, -np.inf).max(axis=1, keepdims=True)
            is_above = (inside >= 0.0) & (depth <= inside + BESIDE)
            is_above &= deepest <= self._reach[number]
            height[is_above], row[is_above] = self._heights[number], self._rows[number]
        return height, row

    def near(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """List the surfaces below a box, from the lowest to the highest.

        Args:
            low: Its lower corner, heights relative to the floor, in [m], shape (3,).
            high: Its upper corner, shape (3,).
        """
        is_near = (self._low <= high[:2]) & (self._high >= low[:2])
        return np.flatnonzero(is_near.all(axis=1) & (self._heights <= high[2] + REACH))

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
        if not len(self._heights):
            return found
        around, reach = reaches.max(), reaches[:, np.newaxis, np.newaxis]
        low, high = centers.min(axis=(0, 1)), centers.max(axis=(0, 1))
        for number in self.near(low - around, high + around):
            at, z = centers[..., :2], centers[..., 2]
            is_over = (at + reach >= self._low[number]).all(axis=-1)
            is_over &= (at - reach <= self._high[number]).all(axis=-1)
            found |= is_over & (np.abs(z - self._heights[number]) <= reach[..., 0])
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
        is_top = (contacts.normal[:, 2] < -UPRIGHT) & (contacts.distance > -REACH)
        for number in np.flatnonzero(is_top):
            height = contacts.points_b[number, 2]
            tops = self._tops.get(found[number], ())
            is_top[number] = any(abs(top - height) < 2.0 * FLAT for top in tops)
        return np.where(is_top, found, -1)


def _surfaces(obstacles: Obstacles, object_poses: np.ndarray) -> Iterator[LevelSurface]:
    """Yield the surfaces of all objects that are never carried."""
    objects = [*obstacles.scene.values()]
    for shape in obstacles.shapes:
        row = shape.link - obstacles.n_links
        if row >= 0 and not shape.radius and not objects[row].attachments:
            yield from _top(shape, row, object_poses[row])
    for row, each in enumerate(objects):
        for flat in each.link.collisions:
            if flat.kind == "plane":
                pose = object_poses[row]
                normal = rotate(pose[3:], rotate(flat.pose[3:], np.array(flat.size)))
                if normal[2] > UPRIGHT:
                    point = pose[:3] + rotate(pose[3:], flat.pose[:3])
                    yield LevelSurface(row, float(point[2]), REACH, None)


def _top(shape: ConvexShape, row: int, pose: np.ndarray) -> Iterator[LevelSurface]:
    """Yield the top of a shape, if it is level."""
    points = pose[:3] + rotate(pose[3:], shape.points)
    height = float(points[:, 2].max())
    corners = np.array(support_polygon(points[points[:, 2] > height - FLAT, :2]))
    x, y = corners.T
    area = 0.5 * (x * np.roll(y, -1) - np.roll(x, -1) * y).sum()
    if area >= LEAST_AREA:
        thickness = float(np.ptp(points[:, 2]))
        yield LevelSurface(row, height, min(REACH, thickness / 2), corners)


def _edges(corners: np.ndarray | None) -> np.ndarray:
    """Find how far points are inside a polygon: (x, y, 1) times rows, shape (k, 3)."""
    if corners is None:
        return np.array([[0.0, 0.0, np.inf]])
    along = np.roll(corners, -1, axis=0) - corners
    inward = np.stack([-along[:, 1], along[:, 0]], axis=1)
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    return np.column_stack([inward, -(inward * corners).sum(axis=1)])
