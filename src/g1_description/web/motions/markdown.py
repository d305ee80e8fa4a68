"""Texts of others in markdown: file names, names of links, notes."""

from __future__ import annotations

SPECIAL = frozenset("\\`*_{}[]()#+-.!|<>&~$:/@")
"""Characters that mean something; ``:`` and the like make links of addresses."""


def plain(text: str) -> str:
    """Write a text so that it is read as it is, in one line."""
    line = " ".join(text.split())
    return "".join(f"\\{c}" if c in SPECIAL else c for c in line)
