"""Pairs of links that are not checked for collisions, each with the reason."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from g1_description.errors import AllowedPairsError
from g1_description.files.atomic import write_whole
from g1_description.files.yaml import YamlError, read_yaml
from g1_description.text import listed

ADJACENT, ALWAYS, DEFAULT = "adjacent", "always", "default"
NEVER, USER = "never", "user"

REASONS = {
    ADJACENT: "a joint connects them",
    ALWAYS: "they overlap in all samples",
    DEFAULT: "they overlap with all joints at zero",
    NEVER: "they were never near each other in the samples",
    USER: "added by hand",
}
"""Reasons for not checking a pair."""


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
    """The links with shapes that were examined."""

    pairs: tuple[AllowedPair, ...]

    samples: int = 0
    """Number of random configurations in which they were examined."""

    seed: int = 0
    """Seed of the random numbers."""

    place: str = ""
    """The file that they were read from."""

    def check_links(self, robot: str, links: Iterable[str]) -> None:
        """Check that all links of a robot were examined.

        Args:
            robot: Its name.
            links: Its links with shapes; it may lack some of ``self.links``.

        Raises:
            AllowedPairsError: If a link was not examined.
        """
        unknown = [name for name in links if name not in self.links]
        if unknown:
            raise AllowedPairsError(
                f"The allowed collisions{self.place and ' in '}{self.place} are for "
                f"'{self.robot}' and lack links of '{robot}': {listed(unknown)}. "
                "Write a file for this robot with collision_pairs."
            )


def with_pairs(allowed: AllowedPairs, pairs: Iterable[AllowedPair]) -> AllowedPairs:
    """Add pairs; a pair of the same links is replaced.

    Pairs of links that the robot does not have are ignored.
    """
    added = [pair for pair in pairs if pair.links <= {*allowed.links}]
    names = {pair.links for pair in added}
    kept = [pair for pair in allowed.pairs if pair.links not in names]
    return replace(allowed, pairs=(*kept, *added))


KEYS = ("robot", "samples", "seed", "links", "pairs")


def read_allowed_pairs(file: Path) -> AllowedPairs:
    """Read a file of allowed pairs.

    Raises:
        AllowedPairsError: If it cannot be read or is invalid.
    """
    try:
        return _allowed_pairs(read_yaml(file), str(file))
    except (YamlError, AllowedPairsError) as error:
        raise AllowedPairsError(
            f"The file of allowed collisions {file}: {error}."
        ) from error


def _allowed_pairs(content: object, place: str) -> AllowedPairs:
    """Read the content of a file."""
    if not isinstance(content, dict) or not set(KEYS) <= set(content):
        raise AllowedPairsError(f"it must have the keys {', '.join(KEYS)}")
    links, pairs = content["links"], content["pairs"]
    if not isinstance(links, list) or not all(isinstance(n, str) for n in links):
        raise AllowedPairsError("links must be a list of names")
    if not isinstance(pairs, list):
        raise AllowedPairsError("pairs must be a list")
    for key in ("samples", "seed"):
        count = content[key]
        if not isinstance(count, int) or isinstance(count, bool) or count < 0:
            raise AllowedPairsError(f"{key} must be a whole number of at least 0")
    return AllowedPairs(
        str(content["robot"]),
        tuple(links),
        tuple(_pair(pair, links) for pair in pairs),
        content["samples"],
        content["seed"],
        place,
    )


def _pair(value: object, links: Collection[str]) -> AllowedPair:
    """Read an entry."""
    if not (isinstance(value, list) and len(value) == 3):
        raise AllowedPairsError(
            f"each of pairs must be [link, link, reason], not {value!r}"
        )
    pair = AllowedPair(*map(str, value))
    unknown = [name for name in (pair.link_a, pair.link_b) if name not in links]
    if unknown:
        raise AllowedPairsError(f"pairs contain {listed(unknown)}, missing in links")
    if pair.reason not in REASONS:
        raise AllowedPairsError(
            f"unknown reason '{pair.reason}' of {pair.link_a} and {pair.link_b}. "
            f"Known reasons: {listed(REASONS)}"
        )
    return pair


def write_allowed_pairs(file: Path, allowed: AllowedPairs, about: str) -> None:
    """Write a file of allowed pairs.

    Args:
        file: The file; an existing one is replaced.
        allowed: The pairs.
        about: Text of the comment at the top.

    Raises:
        InvalidValueError: If it cannot be written; an existing file is kept.
    """
    write_whole(file, allowed_pairs_text(allowed, about).encode("utf-8"))


def allowed_pairs_text(allowed: AllowedPairs, about: str) -> str:
    """Format a file of allowed pairs, with a pair per line."""
    head = [f"# {line}".rstrip() for line in about.splitlines()]
    numbers = [f"samples: {allowed.samples}", f"seed: {allowed.seed}"]
    links = ["links:", *(f"- {_scalar(name)}" for name in allowed.links)]
    pairs = ["pairs:"] if allowed.pairs else ["pairs: []"]
    for reason, meaning in REASONS.items():
        group = [pair for pair in allowed.pairs if pair.reason == reason]
        pairs += [f"# {meaning}"] if group else []
        for pair in group:
            names = f"{_scalar(pair.link_a)}, {_scalar(pair.link_b)}"
            pairs.append(f"- [{names}, {reason}]")
    lines = [*head, f"robot: {_scalar(allowed.robot)}", *numbers, *links, *pairs]
    return "\n".join(lines) + "\n"


def _scalar(name: str) -> str:
    """Format a name for YAML, quoted where necessary."""
    plain = name.replace("_", "").replace("-", "")
    is_plain = plain.isascii() and plain.isalnum() and name[0].isalpha()
    if is_plain and name.lower() not in {"null", "true", "false", "yes", "no", "on"}:
        return name
    return "'" + name.replace("'", "''") + "'"
