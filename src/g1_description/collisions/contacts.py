"""Contacts between convex shapes of many frames, in many configurations.

Three vectorized stages exclude pairs of shapes that are certainly apart: bounding
spheres, bounding boxes, and a search for a separating plane. The others are measured
with PyBullet, or exactly where it is not installed.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from g1_description.collisions.closest_points import ClosestPoints, SignedDistances
from g1_description.collisions.convex_shapes import (
    Bounds,
    ConvexShape,
    Separation,
    ShapePairs,
    axes_of,
    place,
    turn,
)
from g1_description.errors import InvalidValueError
from g1_description.former import former

CHUNK = 256
"""Configurations per chunk; limits memory, and does not affect results."""

NO_PAIRS: SignedDistances = (np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))

SLACK = 5e-4
"""Additional gap of pairs that are excluded early, in [m]: more than PyBullet's error,
so results do not depend on the stage."""


@dataclass(frozen=True)
class Contacts:
    """Pairs of links nearer than a margin, sorted by sample and pair."""

    sample: np.ndarray
    """Index of the configuration, shape (n,)."""

    pair: np.ndarray
    """Index of the pair of links, shape (n,)."""

    distance: np.ndarray
    """In [m], shape (n,); negative: the penetration depth."""

    points_a: np.ndarray
    points_b: np.ndarray
    """Closest or deepest points of the links in the world, in [m], shape (n, 3).
    ``points_b - points_a`` is ``distance * normal``."""

    normal: np.ndarray
    """Directions from the first link of the pair to the second, in the world, shape
    (n, 3)."""

    frame = former("Contacts.frame", "sample")

    def __getitem__(self, rows: np.ndarray) -> Contacts:
        return Contacts(*(getattr(self, part.name)[rows] for part in fields(self)))

    @staticmethod
    def joined(parts: Sequence[Contacts]) -> Contacts:
        """Concatenate contacts of successive configurations."""
        names = [part.name for part in fields(Contacts)]
        return Contacts(
            *(np.concatenate([getattr(part, name) for part in parts]) for name in names)
        )


class ShapeContacts:
    """Finds contacts between shapes on frames that move."""

    def __init__(
        self,
        shapes: Sequence[ConvexShape],
        pairs: Sequence[tuple[int, int]],
        n_frames: int,
    ) -> None:
        """Prepare the shapes.

        Args:
            shapes: Each on a frame, ``link``.
            pairs: Rows of the two frames of each pair.
            n_frames: Number of frames.
        """
        self.shapes = tuple(shapes)
        """The convex shapes."""
        self._rows, self._n_frames = pairs, n_frames
        self._link = np.array([shape.link for shape in self.shapes], dtype=int)
        self._prepare()

    def _prepare(self) -> None:
        self._bounds, self._separation = Bounds(self.shapes), Separation(self.shapes)
        # Cached: listing takes as long as checking one configuration.
        self._all = self._shape_pairs(range(len(self._rows)))

    def __getstate__(self) -> dict[str, Any]:
        """Pickle without PyBullet."""
        own = ("_bounds", "_separation", "_distances", "_all")
        return {name: v for name, v in self.__dict__.items() if name not in own}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore PyBullet's part."""
        self.__dict__.update(state)
        self._prepare()

    def contacts(
        self,
        link_poses: np.ndarray,
        margin: float = 0.0,
        pairs: Collection[int] | None = None,
    ) -> Contacts:
        """Find pairs of links nearer than a margin.

        Args:
            link_poses: Poses of all links in the world, in the order of the
                description, without a root that is the world, shape (n, n_links, 7).
            margin: In [m]; 0: only overlaps.
            pairs: Indices of the pairs to check; by default all.

        Returns:
            The contacts. Those of a configuration do not depend on the others in the
            batch.

        Raises:
            InvalidValueError: If the poses have another shape or are not finite.
        """
        shape = (self._n_frames, 7)
        if link_poses.ndim != 3 or link_poses.shape[1:] != shape:
            raise InvalidValueError(
                f"Poses of {shape[0]} links must have the shape (n, {shape[0]}, 7) "
                f"(got {link_poses.shape})."
            )
        if not np.isfinite(link_poses).all():
            raise InvalidValueError("Poses of links must be finite.")
        if not np.isfinite(margin):
            raise InvalidValueError(f"The margin must be finite (got {margin}).")
        rows = self._all if pairs is None else self._shape_pairs(pairs)
        parts = [
            self._chunk(link_poses[first : first + CHUNK], rows, margin, first)
            for first in range(0, max(len(link_poses), 1), CHUNK)
        ]
        return Contacts.joined(parts)

    def _shape_pairs(self, pairs: Collection[int]) -> np.ndarray:
        """List the indices of two shapes and of their pair of links, shape (n, 3)."""
        of_link: dict[int, list[int]] = {}
        for number, shape in enumerate(self.shapes):
            of_link.setdefault(shape.link, []).append(number)
        found = [
            (a, b, pair)
            for pair in pairs
            for a in of_link.get(self._rows[pair][0], ())
            for b in of_link.get(self._rows[pair][1], ())
        ]
        return np.array(found, dtype=int).reshape(-1, 3)

    def _chunk(
        self, link_poses: np.ndarray, rows: np.ndarray, margin: float, first: int
    ) -> Contacts:
        """Find the contacts of some configurations.

        Args:
            link_poses: Poses of the links in the world, shape (n, n_links, 7).
            rows: As ``_shape_pairs`` returns them.
            margin: In [m].
            first: Index of the first configuration.
        """
        rows = self._near_rows(link_poses, rows, margin + SLACK)
        sample, pair, placed = self._candidates(link_poses, rows, margin + SLACK)
        gaps = self._distances(placed, margin + SLACK) if len(placed.a) else NO_PAIRS
        width, direction, point_a = gaps
        near = np.flatnonzero(width < margin)
        sample, pair, distance = sample[near], pair[near], width[near]
        pose = link_poses[sample, self._link[placed.a[near]]]
        axes = axes_of(pose[:, 3:])
        normal = turn(axes, direction[near])
        points_a = pose[:, :3] + turn(axes, point_a[near])
        points_b = points_a + distance[:, np.newaxis] * normal
        found = Contacts(sample + first, pair, distance, points_a, points_b, normal)
        return found[deepest(found)]

    def _near_rows(self, poses: np.ndarray, rows: np.ndarray, gap: float) -> np.ndarray:
        """Leave out pairs of shapes that are far apart in all configurations."""
        return rows

    def _candidates(
        self, link_poses: np.ndarray, rows: np.ndarray, gap: float
    ) -> tuple[np.ndarray, np.ndarray, ShapePairs]:
        """Find pairs that may be nearer than a gap, for all configurations at once.

        Args:
            link_poses: Poses of the links in the world, shape (n, n_links, 7).
            rows: As ``_shape_pairs`` returns them.
            gap: In [m].

        Returns:
            Frames and pairs of links, shapes (m,), and the shapes.
        """
        n_frames, n_links = link_poses.shape[:2]
        axes = axes_of(link_poses.reshape(-1, 7)[:, 3:])
        axes = axes.reshape(n_frames, n_links, 3, 3)
        sample, row = self._bounds.near(link_poses, axes, rows[:, :2], gap)
        a, b, pair = rows[row].T
        link_a, link_b = self._link[a], self._link[b]
        poses = link_poses[sample, link_a], link_poses[sample, link_b]
        placed = place(a, b, *poses, axes[sample, link_a])
        kept = self._bounds.overlap(placed, gap)
        kept = kept[~self._separation.apart(placed[kept], gap)]
        return sample[kept], pair[kept], placed[kept]

    @cached_property
    def _distances(self) -> Callable[[ShapePairs, float], SignedDistances]:
        """Use PyBullet where it is: ours is slower for shapes that overlap."""
        try:
            from g1_description.collisions.bullet_points import BulletPoints
        except ImportError:
            return ClosestPoints(self.shapes, self._separation).distances
        return BulletPoints(self.shapes, self._separation).distances


def deepest(found: Contacts) -> np.ndarray:
    """Select the deepest contact of each sample and pair, in their order."""
    order = np.lexsort((found.distance, found.pair, found.sample))
    sample, pair = found.sample[order], found.pair[order]
    is_new = np.ones(len(order), dtype=bool)
    is_new[1:] = (sample[1:] != sample[:-1]) | (pair[1:] != pair[:-1])
    return order[is_new]
