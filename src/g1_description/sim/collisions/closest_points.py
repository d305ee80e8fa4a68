"""Closest points of two convex shapes, as PyBullet finds them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from g1_description.sim.bullet.client import connect, pybullet

from .convex_shapes import ConvexShape
from .placing import Placed

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
        """Create the shapes."""
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
