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
    """Those with shapes, which were examined."""

    pairs: tuple[AllowedPair, ...]

    samples: int = 0
    """Number of random configurations in which they were examined."""

    seed: int = 0
    """Seed of the random numbers."""

    place: str = ""
    """The file it is from."""

    def check_links(self, robot: str, links: Iterable[str]) -> None:
        """Check that a robot has no other links than were examined.

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


def with_pairs(allowed: AllowedPairs, pairs: Iterable[AllowedPair]) -> AllowedPairs:
    """Add pairs, each in place of the one of the same links if there is one.

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
        AllowedPairsError: If it cannot be read, or holds something else.
    """
    try:
        return _allowed_pairs(read_yaml(file), str(file))
    except (YamlError, AllowedPairsError) as error:
        raise AllowedPairsError(
            f"The file of allowed collisions {file}: {error}."
        ) from error


def _allowed_pairs(content: object, place: str) -> AllowedPairs:
    """Read what a file holds."""
    if not isinstance(content, dict) or not set(KEYS) <= set(content):
        raise AllowedPairsError(f"it must have {', '.join(KEYS)}")
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
        raise AllowedPairsError(f"pairs name {listed(unknown)}, which is not in links")
    if pair.reason not in REASONS:
        raise AllowedPairsError(
            f"{pair.link_a} and {pair.link_b} have the reason '{pair.reason}'; there "
            f"are {listed(REASONS)}"
        )
    return pair


def write_allowed_pairs(file: Path, allowed: AllowedPairs, about: str) -> None:
    """Write a file of allowed pairs.

    Args:
        file: The file; one that is there is replaced.
        allowed: What to write, sorted by reasons.
        about: Lines for its head, which become a comment.

    Raises:
        InvalidValueError: If it cannot be written; what was there stays.
    """
    write_whole(file, allowed_pairs_text(allowed, about).encode("utf-8"))


def allowed_pairs_text(allowed: AllowedPairs, about: str) -> str:
    """Write what a file of allowed pairs holds: a pair per line."""
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
    """Write a name: as it is where YAML takes it for text, else between quotes."""
    plain = name.replace("_", "").replace("-", "")
    is_plain = plain.isascii() and plain.isalnum() and name[0].isalpha()
    if is_plain and name.lower() not in {"null", "true", "false", "yes", "no", "on"}:
        return name
    return "'" + name.replace("'", "''") + "'"
