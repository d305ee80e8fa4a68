"""What of joint commands was not obeyed to the letter, counted by joint."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Mapping, Sequence

NAMES = 50
"""Names of what is ignored that are counted one by one; the rest together."""

LONGEST_NAME = 80
"""Characters of such a name that count."""


class CommandTally:
    """Counts positions that the simulator clamps, and those that nobody sets.

    A million names take no more room than ``NAMES`` do.
    """

    def __init__(self, limits: Mapping[str, tuple[float, float]]) -> None:
        """Begin with none.

        Args:
            limits: Lower and upper limit in [rad] or [m] of each joint that moves.
        """
        self._limits = limits
        self.clamped: Counter[str] = Counter()
        """Positions beyond the limits, by joint."""
        self.ignored: Counter[str] = Counter()
        """Positions that were ignored, by the name as it came: unknown, without a
        position, or with one that is not finite; '' for positions without a name."""
        self.other_ignored = 0
        """Those under names beyond the first ``NAMES``."""
        self._last_clamped: dict[str, float] = {}

    def count(
        self, names: Sequence[str], positions: Sequence[float], now: float
    ) -> None:
        """Count what of a command is clamped or ignored.

        Args:
            names: Joint names as they came.
            positions: Positions in [rad] or [m] as they came.
            now: When, in [s] of a clock that does not go back.
        """
        for name, position in itertools.zip_longest(names, positions):
            if name not in self._limits or not _is_finite(position):
                self._ignore((name or "")[:LONGEST_NAME])
                continue
            lower, upper = self._limits[name]
            if not lower <= position <= upper:
                self.clamped[name] += 1
                self._last_clamped[name] = now

    def _ignore(self, name: str) -> None:
        """Count a position that nobody sets."""
        if name in self.ignored or len(self.ignored) < NAMES:
            self.ignored[name] += 1
        else:
            self.other_ignored += 1

    def clamped_since(self, time: float) -> list[str]:
        """Name the joints that were clamped after some time in [s]."""
        # A copy: another thread may be counting.
        last = self._last_clamped.copy()
        return [name for name, when in last.items() if when > time]

    @property
    def is_empty(self) -> bool:
        """Whether every position so far could be obeyed."""
        return not (self.clamped or self.ignored)


def _is_finite(position: float | None) -> bool:
    """Tell whether there is a position, and it is a finite number."""
    return position is not None and math.isfinite(position)
