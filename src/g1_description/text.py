"""Names as sentences list them."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping

MAX_NAMES = 8
"""Most names that a sentence lists."""

MAX_NAME = 80
"""Longest name that a sentence shows whole, in characters."""


def listed(names: Iterable[str]) -> str:
    """Join names for a sentence, cut short where there are very many."""
    once = list(dict.fromkeys(names))
    shown = ", ".join(
        name[:MAX_NAME] if name and name.isprintable() else repr(name[:MAX_NAME])
        for name in once[:MAX_NAMES]
    )
    more = len(once) - MAX_NAMES
    return shown + (f" and {more} more" if more > 0 else "")


def similar(name: str, names: Iterable[str]) -> list[str]:
    """Return at most three names like one that does not exist, the likest first."""
    return difflib.get_close_matches(name, list(names), n=3)


def did_you_mean(
    name: str, names: Iterable[str], shown: Mapping[str, str] | None = None
) -> str:
    """Suggest the name most like one that does not exist; empty if none is.

    Args:
        name: The name.
        names: Existing names.
        shown: Text to show for each; None: the name.
    """
    near = similar(name, names)
    return f" (did you mean {shown[near[0]] if shown else near[0]}?)" if near else ""


def similar_first(name: str, names: Iterable[str]) -> list[str]:
    """Sort names: first those like one that does not exist, then the others."""
    names = list(names)
    first = similar(name, names)
    return [*first, *(other for other in names if other not in first)]
