"""What goes wrong, told in few lines: one kind of fault makes one line at a time."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import rospy

PERIOD = 10.0
"""Time between two lines of one kind in [s] of wall time."""

LOOK = 0.5
"""Lines that were kept are looked for this often, in [s]."""

BREATH = 0.02
"""Time between two looks at least, in [s]."""

OVER = 2.5
"""A fault that was not repeated for this long is over, in [s]."""


@dataclass
class _Kind:
    """The lines of one kind of fault."""

    period: float
    log: Callable
    stands: bool
    """Whether it is a state that lasts, rather than events to be counted."""

    told: float = -math.inf
    """When the last line was logged."""

    last: float = 0.0
    """When it last happened."""

    sentence: str = ""
    """The last of those since then, still to be told."""

    count: int = 0
    """How many there were."""

    said: str = ""
    """The sentence that stands in the log and need not be said again."""

    def line(self, now: float) -> str:
        """Give the line that is due, if any; it is told then."""
        if not self.count or now - self.told < self.period:
            return ""
        line = ""
        if now - self.last < OVER:
            others = f" ({self.count - 1} more like it)" if self.count > 1 else ""
            line, self.told = self.sentence + others, now
            if self.stands:
                line = self.said = self.sentence
        self.sentence, self.count = "", 0
        return line


class Complaints:
    """Warnings by kind. The first is logged at once, what follows later and counted.

    rospy's own throttles go by simulated time, which may stand still or go back.
    """

    def __init__(self) -> None:
        """Begin without any.

        A thread of its own logs: rospy asks the master each time, which may hang.
        """
        self._lock = threading.Lock()
        self._kinds: dict[str, _Kind] = {}
        self._news = threading.Event()
        threading.Thread(target=self._log_forever, daemon=True).start()

    def tell(
        self,
        kind: str,
        sentence: str,
        period: float = PERIOD,
        log: Callable = rospy.logwarn,
        stands: bool = False,
    ) -> None:
        """Log a line, or keep it where one of its kind was logged just now.

        Args:
            kind: Which fault, and whose.
            sentence: What is wrong, with names.
            period: Time between two lines of this kind in [s].
            log: Takes a format and what goes into it.
            stands: Whether it is a state that is told again and again while it lasts:
                a line that says what the last one said is left out until it was over.
        """
        now = time.monotonic()
        with self._lock:
            state = self._kinds.setdefault(kind, _Kind(period, log, stands))
            if now - state.last > OVER:
                state.said = ""
            state.last = now
            if sentence == state.said:
                state.sentence, state.count = "", 0
                return
            state.sentence = sentence
            state.count += 1
        self._news.set()

    def _log_forever(self) -> None:
        """Log what is due when something is told, and what was kept for its period.

        A fault that was not repeated lately is over and not told any more.
        """
        while True:
            self._news.wait(LOOK)
            self._news.clear()
            now = time.monotonic()
            with self._lock:
                kinds = list(self._kinds.values())
                lines = [(kind.log, kind.line(now)) for kind in kinds]
            for log, line in lines:
                if line:
                    log("%s", line)
            # At 1 kHz one look in a while is enough.
            time.sleep(BREATH)
