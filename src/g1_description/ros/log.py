"""A throttled log of recurring faults, and the simulator's /rosout."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import rospy
from rosgraph_msgs.msg import Log

LOG_PERIOD = 10.0
"""Minimum time between two lines on one fault, in [s] of wall time."""

SHORT_PERIOD = 1.0
"""Minimum time for events whose messages differ, in [s]."""

EXPIRY = 2.5
"""Time in [s] without a repetition after which a fault is over."""

CHECK_PERIOD = 0.5
"""Longest time between two checks of delayed messages, in [s]."""

MIN_CHECK_PERIOD = 0.02
"""Shortest time between two checks, in [s]: a fault may recur at 1 kHz."""


@dataclass
class _Repeated:
    """The messages on one fault."""

    period: float
    log: Callable
    lasts: bool
    """Whether it is a state rather than a series of events to count."""

    time_logged: float = -math.inf
    """When its last line was logged."""

    time_seen: float = 0.0
    """When it last occurred."""

    message: str = ""
    """The newest message since the last line."""

    count: int = 0
    """Number of messages since the last line."""

    last_line: str = ""
    """Last line on a lasting state, which is not repeated."""

    def take_line(self, now: float) -> str:
        """Return the line that is due, empty if none is, and count it as logged."""
        if not self.count or now - self.time_logged < self.period:
            return ""
        line = ""
        if now - self.time_seen < EXPIRY:
            others = f" ({self.count - 1} more like it)" if self.count > 1 else ""
            line, self.time_logged = self.message + others, now
            if self.lasts:
                line = self.last_line = self.message
        self.message, self.count = "", 0
        return line


class ThrottledLog:
    """Logs the first message on a fault at once, later ones throttled and counted.

    rospy's throttles use simulated time, which may stand still or go back. The log has
    its own thread, because rospy calls the master for each line, which may hang.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._faults: dict[str, _Repeated] = {}
        self._changed = threading.Event()
        threading.Thread(target=self._run, daemon=True).start()

    def warn(
        self,
        key: str,
        message: str,
        period: float = LOG_PERIOD,
        log: Callable = rospy.logwarn,
        lasts: bool = False,
    ) -> None:
        """Log a message, or delay it if its fault was logged within the period.

        Args:
            key: Identifies the fault and its subject.
            message: The sentence to log.
            period: Time between two lines on this fault, in [s].
            log: Function of a format and its argument.
            lasts: Whether the fault is a state: its line is not repeated until it
                changes or is over.
        """
        now = time.monotonic()
        with self._lock:
            fault = self._faults.setdefault(key, _Repeated(period, log, lasts))
            if now - fault.time_seen > EXPIRY:
                fault.last_line = ""
            fault.time_seen = now
            if message == fault.last_line:
                fault.message, fault.count = "", 0
                return
            fault.message = message
            fault.count += 1
        self._changed.set()

    def _run(self) -> None:
        """Log new messages at once, and delayed ones when they are due."""
        while True:
            self._changed.wait(CHECK_PERIOD)
            self._changed.clear()
            now = time.monotonic()
            with self._lock:
                faults = list(self._faults.values())
                lines = [(fault.log, fault.take_line(now)) for fault in faults]
            for log, line in lines:
                if line:
                    log("%s", line)
            time.sleep(MIN_CHECK_PERIOD)


ROSOUT_LEVELS = {
    logging.DEBUG: Log.DEBUG,
    logging.INFO: Log.INFO,
    logging.WARNING: Log.WARN,
    logging.ERROR: Log.ERROR,
    logging.CRITICAL: Log.FATAL,
}


class RosoutHandler(logging.Handler):
    """Publishes log messages on /rosout as roscpp does: not latched.

    rospy latches it, so each new subscriber gets the last line again.
    Used with ``rospy.init_node(..., disable_rosout=True)``.
    """

    def __init__(self) -> None:
        super().__init__()
        self._topic = rospy.Publisher("/rosout", Log, queue_size=100)

    def emit(self, record: logging.LogRecord) -> None:
        """Publish a line, unless the node is shutting down."""
        message = Log(
            level=ROSOUT_LEVELS.get(record.levelno, Log.INFO),
            name=rospy.get_name(),
            msg=self.format(record),
            file=record.filename,
            line=record.lineno,
            function=record.funcName,
        )
        message.header.stamp = rospy.get_rostime()
        try:
            self._topic.publish(message)
        except rospy.ROSException:
            if not rospy.core.is_shutdown_requested():
                self.handleError(record)
