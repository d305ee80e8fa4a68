"""Services that answer soon beside a loop that computes all the time.

Python runs one thread at a time, and a step of PyBullet stops all others until it is
over. A thread of rospy that answers a client would be stopped several times on its way.
So the loop lets those that are on their way finish before it steps.

This extends two methods of rospy, ``handle`` and ``_handle_request`` of
``rospy.impl.tcpros_service.ServiceImpl`` (rospy 1.15), of which the second is private.
A rospy that has none of that name answers as before, only later.
"""

from __future__ import annotations

import select
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import rospy

PAUSE = 1e-4
"""Time in [s] for which the loop lets others run before it looks again."""


class Callers:
    """Counts the threads that are on their way to answer a client."""

    def __init__(self) -> None:
        """Begin with none."""
        self._count = 0
        self._changed = threading.Condition()
        self._requests = select.poll()

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

    @contextmanager
    def listening(self, sock: socket.socket) -> Iterator[None]:
        """Look for requests on a connection, which may be closed in the meantime."""
        descriptor = sock.fileno()
        self._requests.register(descriptor, select.POLLIN)
        try:
            yield
        finally:
            with suppress(KeyError):  # the system has given the number to another
                self._requests.unregister(descriptor)

    def let_finish(self, timeout: float) -> None:
        """Wait until none is on its way; only the loop does.

        Args:
            timeout: Longest wait in [s].
        """
        end = time.monotonic() + timeout
        while (self._count > 0 or self._requests.poll(0)) and time.monotonic() < end:
            with self._changed:
                self._changed.wait(PAUSE)


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

    def handle(self, transport, header) -> None:
        """Answer a connection's requests; rospy calls this in a thread of its own."""
        with self._callers.listening(transport.socket):
            super().handle(transport, header)

    def _handle_request(self, transport, request) -> None:
        """Answer a request; rospy calls this in a thread of the connection."""
        self._callers.begin()
        try:
            super()._handle_request(transport, request)
        finally:
            self._callers.end()
