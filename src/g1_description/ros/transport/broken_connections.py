"""Connections to publishers that were broken for a while, and are made anew.

A publisher's system tries again after a break, but waits for up to as long as it
lasted. Only who sends can shorten that, and not every publisher is one of this package.
A subscriber can ask for a new connection, which goes on at once; what waits on the old
one is old.

rospy does not give away its connections: see ``rospy.impl.registration`` for how they
are found here.
"""

from __future__ import annotations

import contextlib
import socket
import struct
from collections.abc import Iterator
from typing import Any

from rospy.impl.registration import get_topic_manager

MIN_UNANSWERED = 2
"""Questions without an answer that tell of a break; one may be on its way."""

MIN_SILENCE = 1000
"""Time in [ms] without data after which a connection has not gone on by itself."""

_PROBES_AT = 3
_LAST_DATA_AT = 52
_INFO_SIZE = _LAST_DATA_AT + 4
"""Where Linux's struct tcp_info has the number of questions without an answer, and the
time since data came in [ms]."""


class BrokenConnections:
    """Closes the connections of this node's subscribers that were broken."""

    def __init__(self) -> None:
        """Begin without any."""
        self._broken: set[Any] = set()

    def close(self) -> bool:
        """Close those that can be made anew; call it again and again.

        Returns:
            Whether there were any.
        """
        broken, closed = set(), False
        for connection, sock in _connections():
            with contextlib.suppress(OSError):  # it was closed meanwhile
                unanswered, silence = _state(sock)
                if unanswered >= MIN_UNANSWERED:
                    broken.add(connection)
                elif connection in self._broken and silence > MIN_SILENCE:
                    sock.shutdown(socket.SHUT_RDWR)
                    closed = True
        self._broken = broken
        return closed


def _connections() -> Iterator[tuple[Any, socket.socket]]:
    """Find the connections to publishers, and the socket of each."""
    manager = get_topic_manager()
    with manager.lock:
        subscriptions = [*manager.subs.values()]
    for subscription in subscriptions:
        for connection in [*subscription.connections]:
            sock = connection.socket
            if sock is not None:
                yield connection, sock


def _state(sock: socket.socket) -> tuple[int, int]:
    """Count the questions without an answer, and the time since data came in [ms].

    Raises:
        OSError: If the connection is closed.
    """
    info = sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _INFO_SIZE)
    (silence,) = struct.unpack_from("I", info, _LAST_DATA_AT)
    return info[_PROBES_AT], silence
