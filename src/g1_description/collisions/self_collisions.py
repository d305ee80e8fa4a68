"""Self-collisions of a robot in many configurations."""

from __future__ import annotations

from collections.abc import Collection
from itertools import combinations

from g1_description.collisions.allowed_pairs import AllowedPair, AllowedPairs
from g1_description.collisions.contacts import ShapeContacts
from g1_description.collisions.convex_shapes import posed_links, robot_shapes
from g1_description.robot.assembly import bodies_of
from g1_description.robot.description import Description


class SelfCollisions(ShapeContacts):
    """Finds self-collisions of a robot.

    Allowed pairs and links connected by fixed joints are not checked.
    """

    def __init__(
        self,
        description: Description,
        allowed: Collection[AllowedPair] | AllowedPairs,
        visual_hulls: bool = True,
    ) -> None:
        """Read the meshes and prepare the shapes.

        Args:
            description: The robot, with absolute mesh URIs.
            allowed: Pairs that are not checked.
            visual_hulls: Whether links without collision shapes use the convex hulls of
                their visuals.

        Raises:
            AllowedPairsError: If the allowed pairs are for another robot.
        """
        shapes, self.notes = robot_shapes(description, visual_hulls)
        """Messages on meshes that cannot be read, and on assumptions."""
        names = [link.name for link in posed_links(description)]
        row_of = {name: row for row, name in enumerate(names)}
        rows = {shape.link for shape in shapes}
        self.links = tuple(name for row, name in enumerate(names) if row in rows)
        """Names of the links that have shapes, in the order of the description."""
        if isinstance(allowed, AllowedPairs):
            allowed.check_links(description.name, self.links)
            allowed = allowed.pairs
        self.allowed = tuple(allowed)
        """Pairs that are not checked, with the reasons."""
        free = {pair.links for pair in self.allowed}
        body = bodies_of(description)
        self.pairs = tuple(
            (a, b)
            for a, b in combinations(self.links, 2)
            if body[a] != body[b] and frozenset((a, b)) not in free
        )
        """The pairs of links that are checked."""
        rows_of_pairs = [(row_of[a], row_of[b]) for a, b in self.pairs]
        super().__init__(shapes, rows_of_pairs, len(names))
