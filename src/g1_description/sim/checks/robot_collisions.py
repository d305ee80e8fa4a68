"""What of a robot collides, with itself and with the floor."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from g1_description.core.checks.ground.frames import Outline
from g1_description.core.collisions.pairs_file import read_allowed_pairs
from g1_description.core.errors import AllowedPairsError
from g1_description.core.files.share import share_folder
from g1_description.core.robot.description import Description
from g1_description.sim.collisions.convex_shapes import ConvexShape
from g1_description.sim.collisions.find_pairs import (
    QUICK_SAMPLES,
    quick_allowed_pairs,
)
from g1_description.sim.collisions.self_collisions import SelfCollisions

G1_PAIRS = "config/collisions_g1.yaml"
"""The allowed pairs of the G1 and its revisions."""


def collisions_of(
    description: Description, file: Path | None = None, visual_hulls: bool = True
) -> tuple[SelfCollisions, tuple[str, ...]]:
    """Prepare a robot's self-collisions.

    Args:
        description: The robot.
        file: Its allowed pairs. By default those of the G1, and for a robot with other
            links pairs that are found now.
        visual_hulls: Whether links without collision shapes have the hulls of their
            visual ones.

    Returns:
        They, and messages on what was assumed and what could not be read.

    Raises:
        AllowedPairsError: If a file cannot be read, or the given one is another
            robot's.
    """
    if file is not None:
        given = SelfCollisions(description, read_allowed_pairs(file), visual_hulls)
        return given, given.left_out
    known = read_allowed_pairs(share_folder() / G1_PAIRS)
    try:
        own = SelfCollisions(description, known, visual_hulls)
        return own, own.left_out
    except AllowedPairsError:
        found = quick_allowed_pairs(description)
    other = SelfCollisions(description, found, visual_hulls)
    note = (
        f"Which links of {description.name} overlap by design was found in "
        f"{QUICK_SAMPLES} random configurations; collision_pairs makes a file of it."
    )
    return other, (note, *other.left_out)


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
