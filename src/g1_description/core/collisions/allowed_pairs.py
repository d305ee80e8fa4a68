"""Pairs of links whose contact says nothing, each with the reason."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace

from g1_description.core.errors import AllowedPairsError
from g1_description.core.text import listed

ADJACENT, ALWAYS, DEFAULT = "adjacent", "always", "default"
NEVER, USER = "never", "user"

REASONS = {
    ADJACENT: "a joint connects them",
    ALWAYS: "they overlap in all samples",
    DEFAULT: "they overlap with all joints at zero",
    NEVER: "they came near each other in no sample",
    USER: "somebody wrote so by hand",
}
"""Why a pair need not be checked."""


@dataclass(frozen=True)
class AllowedPair:
    """Two links that are not checked against each other."""

    link_a: str
    link_b: str
    reason: str
    """One of ``REASONS``."""

    @property
    def links(self) -> frozenset[str]:
        """Both names; their order is irrelevant."""
        return frozenset((self.link_a, self.link_b))


@dataclass(frozen=True)
class AllowedPairs:
    """All pairs of links of a robot that are not checked."""

    robot: str
    """Name of the robot."""

    links: tuple[str, ...]
    """The links that have shapes: for these it was found out."""

    pairs: tuple[AllowedPair, ...]

    samples: int = 0
    """Random configurations that it was found out with."""

    seed: int = 0
    """Of the random numbers."""

    place: str = ""
    """The file it is from."""

    def check_links(self, robot: str, links: Iterable[str]) -> None:
        """Check that it was found out for a robot.

        Args:
            robot: Its name.
            links: Its links that have shapes; it need not have all that are known.

        Raises:
            AllowedPairsError: If there is a link that is not known.
        """
        unknown = [name for name in links if name not in self.links]
        if unknown:
            raise AllowedPairsError(
                f"The allowed collisions{self.place and ' of '}{self.place} are those "
                f"of '{self.robot}', which does not have all links of '{robot}': "
                f"{listed(unknown)}."
            )


def names_of(pairs: Collection[AllowedPair]) -> set[frozenset[str]]:
    """Give the names of the links of pairs."""
    return {pair.links for pair in pairs}


def with_pairs(allowed: AllowedPairs, pairs: Iterable[AllowedPair]) -> AllowedPairs:
    """Add pairs, each in place of the one of the same links if there is one.

    Pairs of links that the robot does not have are left out.
    """
    added = [pair for pair in pairs if pair.links <= {*allowed.links}]
    names = names_of(added)
    kept = [pair for pair in allowed.pairs if pair.links not in names]
    return replace(allowed, pairs=(*kept, *added))
