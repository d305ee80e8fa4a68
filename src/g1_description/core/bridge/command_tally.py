"""Counts of the commanded positions that were clamped or ignored, by joint."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Mapping, Sequence

MAX_NAMES = 50
"""Largest number of ignored names that are counted one by one; the rest together. Names
come from outside, and there may be any number of them."""

MAX_NAME_LENGTH = 80
"""Number of characters of such a name that are kept."""


class CommandTally:
    """Counts positions that the simulator clamps, and those that nobody sets."""

    def __init__(self, limits: Mapping[str, tuple[float, float]]) -> None:
        """Begin with zero counts.

        Args:
            limits: Lower and upper limit in [rad] or [m] of each joint that moves.
        """
        self._limits = limits
        self.clamped: Counter[str] = Counter()
        """Positions beyond the limits, by joint."""
        self.ignored: Counter[str] = Counter()
        """Ignored positions, by the name in the command: unknown, without a position,
        or with one that is not finite; '' for positions without a name."""
        self.other_ignored = 0
        """Ignored positions under names beyond the first ``MAX_NAMES``."""
        self._last_clamped: dict[str, float] = {}

    def count(
        self, names: Sequence[str], positions: Sequence[float], now: float
    ) -> None:
        """Count the positions of a command that are clamped or ignored.

        Args:
            names: Joint names in the command.
            positions: Positions in [rad] or [m] in the command.
            now: Time of the command in [s] on a clock that does not go back.
        """
        for name, position in itertools.zip_longest(names, positions):
            is_finite = position is not None and math.isfinite(position)
            if name not in self._limits or not is_finite:
                self._ignore((name or "")[:MAX_NAME_LENGTH])
                continue
            lower, upper = self._limits[name]
            if not lower <= position <= upper:
                self.clamped[name] += 1
                self._last_clamped[name] = now

    def _ignore(self, name: str) -> None:
        """Count a position that nobody sets."""
        if name in self.ignored or len(self.ignored) < MAX_NAMES:
            self.ignored[name] += 1
        else:
            self.other_ignored += 1

    def clamped_since(self, time: float) -> list[str]:
        """Return the joints that were clamped after a time in [s]."""
        # A copy: another thread counts meanwhile.
        last = self._last_clamped.copy()
        return [name for name, when in last.items() if when > time]

    @property
    def is_empty(self) -> bool:
        """Whether every position so far was obeyed."""
        return not (self.clamped or self.ignored)
