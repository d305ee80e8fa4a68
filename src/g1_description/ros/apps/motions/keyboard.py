"""Keys of a terminal, as they are pressed."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import termios
import tty
from collections.abc import Iterator

KEYS = {
    b" ": "space",
    b"q": "q",
    b"\x1b[C": "right",
    b"\x1b[D": "left",
    b"\x1bOC": "right",
    b"\x1bOD": "left",
}
"""Names of the keys that mean something, by what a terminal sends."""


@contextlib.contextmanager
def raw_keys() -> Iterator[bool]:
    """Let the terminal hand on each key at once, without showing it.

    Yields:
        Whether there is a terminal to read from.
    """
    if not (sys.stdin.isatty() and os.getpgrp() == os.tcgetpgrp(sys.stdin.fileno())):
        yield False
        return
    descriptor = sys.stdin.fileno()
    before = termios.tcgetattr(descriptor)
    tty.setcbreak(descriptor)
    try:
        yield True
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


def next_key(timeout: float) -> str:
    """Wait for a key.

    Args:
        timeout: Longest wait in [s].

    Returns:
        Its name in ``KEYS``; empty if there was none, or another.
    """
    ready, _, _ = select.select([sys.stdin], [], [], timeout)
    return KEYS.get(os.read(sys.stdin.fileno(), 8), "") if ready else ""
