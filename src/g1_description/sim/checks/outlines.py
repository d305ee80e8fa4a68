"""The outlines of a robot's links above the floor."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

import numpy as np

from g1_description.core.checks.ground import Outline
from g1_description.sim.collisions.convex_shapes import ConvexShape


def outlines_of(shapes: Iterable[ConvexShape]) -> list[Outline]:
    """Outline the shapes that collide: one outline per link and radius.

    Args:
        shapes: Of all links.
    """
    points = defaultdict(list)
    for shape in shapes:
        points[shape.link, shape.radius].append(shape.points)
    return [
        Outline(row, np.concatenate(parts), radius)
        for (row, radius), parts in points.items()
    ]
