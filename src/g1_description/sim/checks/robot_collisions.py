"""The self-collisions of a robot, with the pairs of links that may touch by design."""

from __future__ import annotations

from pathlib import Path

from g1_description.core.robot.description import Description
from g1_description.sim.collisions.find_pairs import allowed_pairs_of
from g1_description.sim.collisions.self_collisions import SelfCollisions


def collisions_of(
    description: Description, file: Path | None = None, visual_hulls: bool = True
) -> tuple[SelfCollisions, tuple[str, ...]]:
    """Prepare a robot's self-collisions.

    Args:
        description: The robot.
        file: Its allowed pairs. By default those of the G1, and for another robot pairs
            that are found now.
        visual_hulls: Whether links without collision shapes have the hulls of their
            visual ones.

    Returns:
        They, and messages on what was assumed and what could not be read.

    Raises:
        AllowedPairsError: If the given file cannot be read, or is another robot's.
    """
    allowed = allowed_pairs_of(description, file)
    collisions = SelfCollisions(description, allowed, visual_hulls)
    if allowed.place:
        return collisions, collisions.left_out
    found = (
        f"Which links of {description.name} overlap by design was found in "
        f"{allowed.samples} random configurations; collision_pairs makes a file of it."
    )
    return collisions, (found, *collisions.left_out)
