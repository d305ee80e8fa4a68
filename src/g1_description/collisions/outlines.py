"""Points of the shapes of links that may be the lowest ones, and the soles of feet."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from g1_description.collisions.convex_shapes import ConvexShape
from g1_description.sim.meshes.hulls import edge_points

THIN = 1e-3
"""Extent up to which the middles of balls are in a plane, in [m]."""


def with_soles(shapes: Sequence[ConvexShape]) -> list[ConvexShape]:
    """Add the soles of feet that are only balls in a plane: a plate as thick as these.

    Other things than a floor fit between the balls.

    Args:
        shapes: The shapes of a robot.
    """
    found = list(shapes)
    for link in sorted({shape.link for shape in shapes}):
        own = [shape for shape in shapes if shape.link == link]
        centers = np.concatenate([shape.points for shape in own])
        radii = {shape.radius for shape in own}
        if len(own) > 2 and len(centers) == len(own) and len(radii) == 1:
            axes = np.linalg.svd(centers - centers.mean(axis=0))[2]
            _, width, height = np.ptp(centers @ axes.T, axis=0)
            if height < THIN < width:
                thick = axes[2] * radii.pop()
                plate = np.concatenate([centers + thick, centers - thick])
                found.append(ConvexShape(link, plate, 0.0))
    return found


def outlines_of(shapes: Iterable[ConvexShape]) -> list[ConvexShape]:
    """Join the shapes of each link that have the same radius."""
    points = defaultdict(list)
    for shape in shapes:
        points[shape.link, shape.radius].append(shape.points)
    return [
        ConvexShape(row, np.concatenate(parts), radius)
        for (row, radius), parts in points.items()
    ]


SPACING = 0.01
"""Distance between points of the outlines on edges of objects, in [m]."""


def edges_of(shapes: Iterable[ConvexShape]) -> list[ConvexShape]:
    """Find points on the edges of shapes, of which a part may be on an object."""
    parts = [
        replace(s, points=edge_points(s.points, SPACING)[len(s.points) :])
        for s in shapes
        if not s.radius
    ]
    return outlines_of(part for part in parts if len(part.points))
