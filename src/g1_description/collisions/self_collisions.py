"""Collisions of a robot with itself."""

from __future__ import annotations

from collections.abc import Collection
from itertools import combinations
from typing import Any

import numpy as np

from g1_description.collisions.allowed_pairs import AllowedPair, AllowedPairs, names_of
from g1_description.collisions.convex_shapes import robot_shapes
from g1_description.collisions.distances import Contacts, ShapeCollisions
from g1_description.errors import InvalidValueError
from g1_description.robot.assembly import rigid_frames
from g1_description.robot.description import Description

__all__ = ["Contacts", "SelfCollisions"]


class SelfCollisions:
    """Finds where links of a robot touch each other.

    It has a PyBullet of its own. Pairs that are allowed, and those of links that fixed
    joints hold together, are not checked.
    """

    def __init__(
        self,
        description: Description,
        allowed: Collection[AllowedPair] | AllowedPairs,
        visual_hulls: bool = True,
    ) -> None:
        """Read the meshes and prepare the shapes.

        Args:
            description: The robot; names of its meshes can be found from anywhere.
            allowed: Pairs that are not checked.
            visual_hulls: Whether the convex hulls of the visuals stand for a link that
                has no collision shape.

        Raises:
            AllowedPairsError: If the allowed pairs are those of another robot.
        """
        found = robot_shapes(description, visual_hulls)
        if isinstance(allowed, AllowedPairs):
            allowed.check_links(description.name, found.judged)
            allowed = allowed.pairs
        self.shapes = found.shapes
        """What stands for the links."""
        self.links = found.judged
        """Names of the links that have shapes, in the order of the description."""
        self.by_visuals = found.by_visuals
        """Those of them that have no collision shape: their visuals stand for them."""
        self.without_shapes = found.without_shapes
        """Names of the links that are never found, as nothing stands for them."""
        self.notes = found.left_out
        """A message for each mesh that cannot be read, and on what was assumed."""
        self.pairs = _checked_pairs(description, self.links, names_of(allowed))
        """The pairs of links that are checked."""
        self._rows = {name: row for row, name in enumerate(found.links)}
        self._prepare()

    def _prepare(self) -> None:
        self._collisions = ShapeCollisions(self.shapes)
        # Listing them takes as long as finding the contacts of one configuration.
        self._all = self._shape_pairs(np.arange(len(self.pairs)))

    def __getstate__(self) -> dict[str, Any]:
        """Go to other processes without PyBullet."""
        own = ("_collisions", "_all")
        return {name: v for name, v in self.__dict__.items() if name not in own}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Arrive there."""
        self.__dict__.update(state)
        self._prepare()

    def contacts(
        self,
        link_poses: np.ndarray,
        margin: float = 0.0,
        pairs: Collection[int] | None = None,
    ) -> Contacts:
        """Find the pairs of links that are nearer than a margin.

        Args:
            link_poses: Poses of all links in the world, in the order of the
                description, without a root that is the world, shape (n, n_links, 7).
            margin: In [m]; 0: what overlaps.
            pairs: Indices of the pairs to check; by default all.

        Returns:
            The contacts; each configuration has the same ones to the last bit, whatever
            others are checked with it.

        Raises:
            InvalidValueError: If the poses have another shape or are no numbers.
        """
        shape = (len(self._rows), 7)
        if link_poses.ndim != 3 or link_poses.shape[1:] != shape:
            raise InvalidValueError(
                f"Poses of {shape[0]} links have the shape (n, {shape[0]}, 7), not "
                f"{link_poses.shape}."
            )
        if not np.isfinite(link_poses).all():
            raise InvalidValueError("A pose of a link is not a finite number.")
        if not np.isfinite(margin):
            raise InvalidValueError(f"The margin is {margin}, which is no number.")
        rows = self._all
        if pairs is not None:
            rows = self._shape_pairs(np.array([*pairs], dtype=int))
        return self._collisions.between(link_poses, rows, margin)

    def _shape_pairs(self, indices: np.ndarray) -> np.ndarray:
        """List the pairs of shapes of some pairs of links, and the pairs' indices."""
        chosen = (self.pairs[index] for index in indices.tolist())
        links = [(self._rows[a], self._rows[b]) for a, b in chosen]
        rows = self._collisions.shape_pairs(links)
        rows[:, 2] = indices[rows[:, 2]]
        return rows


def _checked_pairs(
    description: Description, links: Collection[str], allowed: set[frozenset[str]]
) -> tuple[tuple[str, str], ...]:
    """List the pairs of links that can move against each other and are not allowed."""
    group = {
        link: body
        for tree in description.trees
        for link, (body, _) in rigid_frames(tree).items()
    }
    return tuple(
        (a, b)
        for a, b in combinations(links, 2)
        if group[a] != group[b] and frozenset((a, b)) not in allowed
    )
