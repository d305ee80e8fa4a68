"""What goes wrong, told in few lines: one kind of fault makes one line at a time."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass

import rospy

PERIOD = 10.0
"""Time between two lines of one kind in [s] of wall time."""


@dataclass
class _Kind:
    """The lines of one kind of fault."""

    period: float
    told: float
    """When the last line was logged."""

    sentence: str = ""
    """The last of those since then, still to be told."""

    count: int = 0
    """How many there were."""

    def take(self, now: float) -> str:
        """Give the line that is due, if any; then it is told."""
        if not self.count or now - self.told < self.period:
            return ""
        others = f" ({self.count - 1} more like it)" if self.count > 1 else ""
        line = self.sentence + others
        self.told, self.sentence, self.count = now, "", 0
        return line


class Complaints:
    """Warnings by kind. The first is logged at once, what follows later and counted.

    rospy's own throttles go by simulated time, which may stand still or go back.
    """

    def __init__(self) -> None:
        """Begin without any."""
        self._lock = threading.Lock()
        self._kinds: dict[str, _Kind] = {}

    def tell(self, kind: str, sentence: str, period: float = PERIOD) -> None:
        """Log a warning, or keep it where one of its kind was logged just now.

        Args:
            kind: Which fault, and whose.
            sentence: What is wrong, with names.
            period: Time between two lines of this kind in [s].
        """
        now = time.monotonic()
        with self._lock:
            state = self._kinds.setdefault(kind, _Kind(period, -period))
            state.sentence, state.count = sentence, state.count + 1
            line = state.take(now)
        if line:
            rospy.logwarn("%s", line)

    def tell_kept(self) -> None:
        """Log the last warning of each kind that was kept for its period."""
        now = time.monotonic()
        with self._lock:
            lines = [state.take(now) for state in self._kinds.values()]
        for line in filter(None, lines):
            rospy.logwarn("%s", line)
