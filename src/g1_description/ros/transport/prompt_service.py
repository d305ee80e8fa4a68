"""Services that answer soon beside a loop that computes all the time.

Python runs one thread at a time, and a step of PyBullet stops all others until it is
over. A thread of rospy that answers a client would be stopped several times on its way.
So the loop lets those that are on their way finish before it steps.

This extends rospy's own method that answers one request, which is private
(``rospy.impl.tcpros_service.ServiceImpl._handle_request``, rospy 1.15). A rospy that
has none of that name answers as before, only later.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import rospy


class Callers:
    """Counts the threads that are on their way to answer a client."""

    def __init__(self) -> None:
        """Begin with none."""
        self._count = 0
        self._changed = threading.Condition()

    def begin(self) -> None:
        """Count a thread: it has a request, or what it waited for."""
        with self._changed:
            self._count += 1

    def end(self) -> None:
        """Count a thread no more: it has answered, or waits for the loop."""
        with self._changed:
            self._count -= 1
            if self._count <= 0:
                self._changed.notify()

    def let_finish(self, end: float) -> None:
        """Wait until none is on its way; only the loop does.

        Args:
            end: Until when, in [s] of the monotonic clock.
        """
        if self._count > 0:
            with self._changed:
                left = end - time.monotonic()
                self._changed.wait_for(lambda: self._count <= 0, left)


class PromptService(rospy.Service):
    """A service whose threads are counted while they answer."""

    def __init__(
        self, name: str, kind: type, handler: Callable, callers: Callers
    ) -> None:
        """Advertise the service.

        Args:
            name: Its name.
            kind: Its class.
            handler: As for ``rospy.Service``.
            callers: Counts its threads.
        """
        self._callers = callers
        super().__init__(name, kind, handler)

    def _handle_request(self, transport, request) -> None:
        """Answer a request; rospy calls this in a thread of the connection."""
        self._callers.begin()
        try:
            super()._handle_request(transport, request)
        finally:
            self._callers.end()
