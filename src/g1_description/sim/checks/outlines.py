"""The outlines of a robot's links above the floor."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from g1_description.core.checks.ground import Outline
from g1_description.core.robot.description import Description
from g1_description.sim.collisions.convex_shapes import robot_shapes


def outlines_of(description: Description, visual_hulls: bool = True) -> list[Outline]:
    """Outline the shapes of all links: those that collide.

    Args:
        description: The robot.
        visual_hulls: Whether links without collision shapes count with the hulls of
            their visual ones.

    Returns:
        One per link and radius; links without shapes have none.
    """
    points = defaultdict(list)
    for shape in robot_shapes(description, visual_hulls).shapes:
        points[shape.link, shape.radius].append(shape.points)
    return [
        Outline(row, np.concatenate(parts), radius)
        for (row, radius), parts in points.items()
    ]
