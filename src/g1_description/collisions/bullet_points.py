"""Closest or deepest points of pairs of convex shapes, by PyBullet.

PyBullet finds the direction. The distance is that of the two planes normal to it that
bound the shapes: never more than the true one, and independent of PyBullet's precision.
Where both disagree, the direction is wrong and the pair is measured exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from operator import itemgetter

import numpy as np

from g1_description.collisions.closest_points import (
    ClosestPoints,
    SignedDistances,
    measured,
)
from g1_description.collisions.convex_shapes import (
    ConvexShape,
    Separation,
    ShapePairs,
)
from g1_description.robot.rotation import from_z
from g1_description.sim.bullet.client import connect, pybullet

DOUBT = 1e-4
"""Largest difference between PyBullet's distance and that of the planes, in [m]; a
larger one means that the direction is wrong."""

MARGIN = 0.001
"""Thickness that PyBullet adds to a hull on all sides, in [m]."""


class BulletPoints:
    """The shapes of a robot in a separate PyBullet client.

    Each shape exists twice, at the origin and placed relative to another shape, so
    results depend only on their relative pose.
    """

    def __init__(self, shapes: Sequence[ConvexShape], separation: Separation) -> None:
        self._shapes, self._separation = shapes, separation
        self._client = connect()
        self._margin = [0.0 if shape.radius else MARGIN for shape in shapes]
        forms = [self._create(shape) for shape in shapes]
        self._still, self._placed = (
            [self._client.createMultiBody(0.0, form) for form in forms]
            for _ in range(2)
        )

    @cached_property
    def _exact(self) -> ClosestPoints:
        return ClosestPoints(self._shapes, self._separation)

    def _create(self, shape: ConvexShape) -> int:
        """Create a shape; return its number."""
        client = self._client
        if shape.radius:
            center = shape.points.mean(axis=0).tolist()
            form = {"radius": shape.radius, "collisionFramePosition": center}
            if len(shape.points) == 1:
                return int(client.createCollisionShape(pybullet.GEOM_SPHERE, **form))
            along = shape.points[1] - shape.points[0]
            form["height"] = float(np.linalg.norm(along))
            form["collisionFrameOrientation"] = from_z(along).tolist()
            return int(client.createCollisionShape(pybullet.GEOM_CAPSULE, **form))
        vertices = shape.points.tolist()
        return int(client.createCollisionShape(pybullet.GEOM_MESH, vertices=vertices))

    def distances(self, placed: ShapePairs, reach: float) -> SignedDistances:
        """Measure the widest gaps, or the least overlaps.

        Args:
            placed: Pairs of shapes.
            reach: Pairs farther apart than this may be ignored, in [m].

        Returns:
            Their error is 0.1 mm.
        """
        distance, direction, middle = self._ask(placed, reach)
        is_far = np.isnan(distance)
        direction[is_far], middle[is_far], distance[is_far] = 0.0, 0.0, 0.0
        gaps = measured(self._separation, placed, direction, middle)
        doubtful = np.flatnonzero(np.abs(gaps[0] - distance) > DOUBT)
        doubtful = doubtful[~is_far[doubtful]]
        if len(doubtful):
            exact = self._exact.distances(placed[doubtful], reach)
            for values, better in zip(gaps, exact):
                values[doubtful] = better
        gaps[0][is_far] = np.inf
        return gaps

    def _ask(
        self, placed: ShapePairs, reach: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Find the closest or deepest points of shapes.

        Returns:
            Distances in [m], negative for overlaps, NaN if PyBullet found nothing,
            shape (n,). Their error is 0.05 mm, but some millimetres in three of ten
            thousand pairs. Directions from a to b, and midpoints, in the frames of a's
            links, shapes (n, 3).
        """
        # The functions of the module are a microsecond faster than the client's.
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
                deepest = min(points, key=itemgetter(8))
                thick = self._margin[a] + self._margin[b]
                found[row] = (deepest[8] + thick, *deepest[7], *deepest[5], *deepest[6])
        return found[:, 0], -found[:, 1:4], (found[:, 4:7] + found[:, 7:]) / 2.0
