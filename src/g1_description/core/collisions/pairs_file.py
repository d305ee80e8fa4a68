"""Files of allowed pairs: the one module that knows their form, which is YAML."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from g1_description.core.errors import AllowedPairsError
from g1_description.core.files.atomic import write_whole
from g1_description.core.text import listed

from .allowed_pairs import REASONS, AllowedPair, AllowedPairs

KEYS = ("robot", "samples", "seed", "links", "pairs")


def read_allowed_pairs(file: Path) -> AllowedPairs:
    """Read a file of allowed pairs.

    Raises:
        AllowedPairsError: If it cannot be read, or holds something else.
    """
    try:
        return _allowed_pairs(_load(file.read_bytes().decode("utf-8")), str(file))
    except (OSError, UnicodeDecodeError, AllowedPairsError) as error:
        problem = getattr(error, "strerror", None) or error
        raise AllowedPairsError(
            f"The file of allowed collisions {file}: {problem}."
        ) from error


def _load(text: str) -> object:
    """Read YAML."""
    # Only now: the library takes 40 ms, and a robot without a file does not need it.
    from ruamel.yaml import YAML, YAMLError
    from ruamel.yaml.constructor import DuplicateKeyError

    try:
        return YAML(typ="safe", pure=True).load(text)
    except (YAMLError, DuplicateKeyError, RecursionError, ValueError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}: " if mark else ""
        problem = str(getattr(error, "problem", None) or error).splitlines()[0]
        raise AllowedPairsError(f"{where}{problem}") from error


def _allowed_pairs(content: object, place: str) -> AllowedPairs:
    """Read what a file holds."""
    if not isinstance(content, dict) or not set(KEYS) <= set(content):
        raise AllowedPairsError(f"it must have {', '.join(KEYS)}")
    links = _names(content["links"])
    pairs = content["pairs"]
    if not isinstance(pairs, list):
        raise AllowedPairsError("pairs must be a list")
    return AllowedPairs(
        robot=str(content["robot"]),
        links=links,
        pairs=tuple(_pair(pair, links) for pair in pairs),
        samples=_count(content, "samples"),
        seed=_count(content, "seed"),
        place=place,
    )


def _names(value: object) -> tuple[str, ...]:
    """Check a list of names."""
    if isinstance(value, list) and all(isinstance(name, str) for name in value):
        return tuple(value)
    raise AllowedPairsError("links must be a list of names")


def _count(content: Mapping[str, object], key: str) -> int:
    """Check a number that counts something."""
    value = content[key]
    if isinstance(value, int) and not isinstance(value, bool) and value >= 0:
        return value
    raise AllowedPairsError(f"{key} must be a whole number of at least 0")


def _pair(value: object, links: tuple[str, ...]) -> AllowedPair:
    """Read an entry."""
    if not (isinstance(value, list) and len(value) == 3):
        raise AllowedPairsError(
            f"each of pairs must be [link, link, reason], not {value!r}"
        )
    link_a, link_b, reason = map(str, value)
    unknown = [name for name in (link_a, link_b) if name not in links]
    if unknown:
        raise AllowedPairsError(f"pairs name {listed(unknown)}, which is not in links")
    if reason not in REASONS:
        raise AllowedPairsError(
            f"{link_a} and {link_b} have the reason '{reason}'; there are "
            f"{listed(REASONS)}"
        )
    return AllowedPair(link_a, link_b, reason)


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
