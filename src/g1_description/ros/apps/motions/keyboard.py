"""Keys of a terminal, as they are pressed."""

from __future__ import annotations

import contextlib
import os
import re
import select
import sys
import termios
import tty

KEYS = {
    b" ": "space",
    b"q": "q",
    b"\x1b[C": "right",
    b"\x1b[D": "left",
    b"\x1bOC": "right",
    b"\x1bOD": "left",
}
"""Names of the keys that mean something, by what a terminal sends."""

END = "q"
"""What is read when the terminal is gone."""

ONE_KEY = re.compile(rb"\x1b(?:\[[0-?]*[ -/]*[@-~]|O[@-~])|[^\x1b]", re.DOTALL)
"""What a terminal sends for one key."""

PART_OF_KEY = re.compile(rb"\x1b(?:\[[0-?]*[ -/]*|O)?\Z")
"""The beginning of that, or the key Escape."""


class Keyboard:
    """Reads keys from a terminal one by one; without a terminal there are none."""

    def __init__(self, descriptor: int | None) -> None:
        """Let the terminal hand on each key at once, without showing it.

        Args:
            descriptor: Of the terminal; None: there is none.
        """
        self._descriptor = descriptor
        self._pending = b""
        if descriptor is not None:
            self._before = termios.tcgetattr(descriptor)
            tty.setcbreak(descriptor)

    def next_key(self, timeout: float) -> str:
        """Wait for a key.

        Args:
            timeout: Longest wait in [s].

        Returns:
            Its name in ``KEYS``, ``END`` when the terminal is gone; empty if there was
            no key that means something.
        """
        name = self._take()
        if name:
            return name
        descriptors = [] if self._descriptor is None else [self._descriptor]
        if not select.select(descriptors, [], [], timeout)[0]:
            self._pending = b""  # of a key that would be here by now
            return ""
        sent = self._read()
        self._pending += sent
        return self._take() if sent else END

    def _read(self) -> bytes:
        """Read what is there; nothing is there when the terminal is gone."""
        assert self._descriptor is not None
        try:
            return os.read(self._descriptor, 1024)
        except OSError:
            return b""

    def _take(self) -> str:
        """Take the first known key of what was read; return its name, or nothing."""
        while self._pending and not PART_OF_KEY.match(self._pending):
            key = ONE_KEY.match(self._pending)
            length = key.end() if key else 1
            taken, self._pending = self._pending[:length], self._pending[length:]
            if taken in KEYS:
                return KEYS[taken]
        return ""

    def close(self) -> None:
        """Let the terminal be as it was; from any thread, and as often as you like."""
        # From the background it would stop this program.
        if self._descriptor is not None and not _is_in_background(self._descriptor):
            with contextlib.suppress(termios.error):  # it may be gone
                # Without a wait for what was printed: Ctrl-S holds that back.
                termios.tcsetattr(self._descriptor, termios.TCSANOW, self._before)


def terminal() -> int | None:
    """Return the terminal whose keys are for this program; None: there is none."""
    if not sys.stdin.isatty():
        return None
    descriptor = sys.stdin.fileno()
    return None if _is_in_background(descriptor) else descriptor


def _is_in_background(descriptor: int) -> bool:
    """Return whether a terminal has another program in its foreground."""
    try:
        return os.getpgrp() != os.tcgetpgrp(descriptor)
    except OSError:  # it does not start programs for this session, or is gone
        return False
