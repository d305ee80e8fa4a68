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
    """The last sentence since then, still to be told."""

    count: int = 0


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
            state = self._kinds.get(kind)
            if state is not None and now - state.told < state.period:
                state.sentence, state.count = sentence, state.count + 1
                return
            self._kinds[kind] = _Kind(period, now)
        rospy.logwarn("%s", sentence)

    def tell_kept(self) -> None:
        """Log the last warning of each kind that was kept for its period."""
        now = time.monotonic()
        with self._lock:
            due = [
                state
                for state in self._kinds.values()
                if state.count and now - state.told >= state.period
            ]
            lines = [(state.sentence, state.count) for state in due]
            for state in due:
                state.told, state.sentence, state.count = now, "", 0
        for sentence, count in lines:
            others = f" ({count - 1} more like it)" if count > 1 else ""
            rospy.logwarn("%s%s", sentence, others)
