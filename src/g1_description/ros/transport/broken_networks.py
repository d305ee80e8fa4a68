"""Connections that go on soon after a network was broken, and notice hosts that died.

TCP waits twice as long before each further try, up to two minutes, so after a break
data may stay away for as long again. A host that dies says nothing: whoever only
listens to it would wait for ever, and rospy asks after a minute for the first time.

So each connection of this process tries again every second, where the system can
(Linux 6.15), and ends when it had no answer for a while. Connecting has a time limit
as well; rospy's are 60 s, or none. Who lost a connection makes another: see
``ros.node.master``.

rospy has no option for any of this. ``TCPROSTransport.socket`` becomes a property, and
``TCPROSTransport.connect`` and ``xmlrpc.client.Transport`` are changed, for the process
that calls ``mend_broken_networks``.
"""

from __future__ import annotations

import contextlib
import errno
import socket
import threading
import time
from collections.abc import Iterator
from operator import attrgetter
from typing import Any
from xmlrpc.client import Transport

from rospy.impl.tcpros_base import TCPROSTransport

CONNECT_TIMEOUT = 3.0
"""Longest time to connect in [s]: where a fifth of the packets is lost, three tries are
enough for nineteen in twenty."""

TRY_TIMEOUT = 0.5
"""Time in [s] after which a call of another node begins a new try to connect. The
system's own tries would be 1 s apart, then 2 s, then 4 s."""

DEAD_AFTER = 10
"""Time without an answer in [s] after which a connection that this node has made is
closed; it makes another."""

CALLER_DEAD_AFTER = 3600
"""The same for a connection that another node has made. Many nodes, such as all of
rospy's, do not make another: a break may last so long for them. So may a callback or a
debugger that keeps one from reading, as Linux ends that, too."""

MAX_QUESTIONS = 60
"""Questions without an answer after which who only listens is done."""

TRY_PERIOD = 1
"""Longest time between two tries to send, and between two questions of who only listens
whether the other is there, in [s]."""

IDLE = 1
"""Time in [s] after which who only listens asks for the first time."""

TCP_RTO_MAX_MS = 44
"""Linux's option for the longest time between two tries, since 6.15; Python does not
name it."""

_UNREACHABLE = (errno.EHOSTUNREACH, errno.ENETUNREACH, errno.ENETDOWN, errno.ETIMEDOUT)
_CALLS = threading.local()
_KEPT = "_g1_description_socket"


def mend_broken_networks() -> None:
    """Change rospy's connections. Call it before ``rospy.init_node``."""
    if isinstance(getattr(TCPROSTransport, "socket", None), property):
        return
    connect, make_connection = TCPROSTransport.connect, Transport.make_connection

    def set_socket(transport: Any, sock: socket.socket | None) -> None:
        if sock is not None:
            is_own = transport.dest_address is not None
            set_options(sock, DEAD_AFTER if is_own else CALLER_DEAD_AFTER)
        setattr(transport, _KEPT, sock)

    def connect_in_time(
        transport: Any,
        address: str,
        port: int,
        endpoint_id: str,
        timeout: float | None = None,
    ) -> None:
        limit = CONNECT_TIMEOUT if timeout is None else min(timeout, CONNECT_TIMEOUT)
        connect(transport, address, port, endpoint_id, timeout=limit)

    def make_connection_in_time(transport: Any, host: Any) -> Any:
        connection = make_connection(transport, host)
        connection._create_connection = _create_connection
        return connection

    TCPROSTransport.socket = property(attrgetter(_KEPT), set_socket)
    TCPROSTransport.connect = connect_in_time
    Transport.make_connection = make_connection_in_time


@contextlib.contextmanager
def answers_within(seconds: float) -> Iterator[None]:
    """Limit the time that each answer to this thread's calls of nodes may take.

    Not for ``socket.setdefaulttimeout``, which is of all threads.

    Args:
        seconds: The limit in [s]; whoever calls gets an OSError after it.
    """
    _CALLS.timeout = seconds
    try:
        yield
    finally:
        _CALLS.timeout = None


def set_options(sock: socket.socket, dead_after: int) -> None:
    """Let a connection try often, and end when there is no answer.

    Args:
        sock: Its socket.
        dead_after: Time without an answer in [s] after which it ends.
    """
    tcp = socket.IPPROTO_TCP
    options = (
        (socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1),
        (tcp, socket.TCP_KEEPIDLE, IDLE),
        (tcp, socket.TCP_KEEPINTVL, TRY_PERIOD),
        (tcp, socket.TCP_KEEPCNT, min(dead_after, MAX_QUESTIONS)),
        (tcp, socket.TCP_USER_TIMEOUT, 1000 * dead_after),
        (tcp, TCP_RTO_MAX_MS, 1000 * TRY_PERIOD),
    )
    for option in options:
        # The last one is unknown to most systems; a socket that the other side has
        # closed takes none, and whoever uses it finds out.
        with contextlib.suppress(OSError):
            sock.setsockopt(*option)


def _create_connection(
    address: tuple[str, int], timeout: Any, source: Any = None
) -> socket.socket:
    """Connect as ``socket.create_connection`` does, in several tries.

    Args:
        address: Host and port.
        timeout: Of all that follows.
        source: Own address; None: any.

    Raises:
        OSError: If there is no connection in time.
    """
    end = time.monotonic() + CONNECT_TIMEOUT
    while True:
        begin = time.monotonic()
        try:
            sock = socket.create_connection(address, TRY_TIMEOUT, source)
            break
        except OSError as error:
            is_late = isinstance(error, socket.timeout) or error.errno in _UNREACHABLE
            if not is_late or begin + TRY_TIMEOUT > end:
                raise
        time.sleep(max(0.0, begin + TRY_TIMEOUT - time.monotonic()))
    if timeout is socket._GLOBAL_DEFAULT_TIMEOUT:
        timeout = socket.getdefaulttimeout()
    sock.settimeout(getattr(_CALLS, "timeout", None) or timeout)
    set_options(sock, DEAD_AFTER)
    return sock
