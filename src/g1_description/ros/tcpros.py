"""Changes to rospy's TCP server that make it behave like roscpp's.

rospy shakes hands with one client after the other, so a client that connects and says
nothing blocks all that follow. Here each handshake has a thread of its own and a few
seconds. roscpp also sends the types of a service's request and response in its
handshake; rospy does not.

A client with a malformed request is disconnected; rospy would let it wait for ever.
Many clients may connect at the same time; rospy lets five wait for their turn.

rospy has no option for any of this, so four private functions of its classes are
replaced, for the process of the node that calls ``serve_as_roscpp``.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import threading

import rospy
from rospy.exceptions import TransportException
from rospy.impl.tcpros_base import TCPROSServer, TCPServer
from rospy.impl.tcpros_service import ServiceImpl, TCPService

HANDSHAKE_TIMEOUT = 5
"""Longest time of a client's handshake in [s]."""

MAX_WAITING_CLIENTS = 1024
"""Number of clients that may wait for their turn, far more than a robot's nodes."""

MAX_HEADER_SIZE = 65536
"""Longest handshake header in bytes. It holds a few names and a message definition;
its length is the client's word, and as many bytes are waited for."""

HANDSHAKE = threading.local()
"""In the thread of a handshake: the number of its socket, as ``descriptor``. It tells
``subscribers`` which socket a new subscriber has."""

_LENGTH = struct.Struct("<I")


def serve_as_roscpp() -> None:
    """Change rospy's server. Call it before ``rospy.init_node``."""
    shake_hands = TCPROSServer._tcp_server_callback
    header_fields = TCPService.get_header_fields
    handle, make_socket = ServiceImpl.handle, TCPServer._create_server_sock

    def wait_and_shake_hands(server, sock, address):
        if _header_has_come(sock):
            HANDSHAKE.descriptor = sock.fileno()
            shake_hands(server, sock, address)
        else:
            sock.close()

    def in_a_thread(*arguments):
        threading.Thread(
            target=wait_and_shake_hands, args=arguments, daemon=True
        ).start()

    def with_types(protocol):
        kind = protocol.service_class._type
        types = {"request_type": f"{kind}Request", "response_type": f"{kind}Response"}
        return {**header_fields(protocol), **types}

    def handle_and_let_go(service, transport, header):
        try:
            handle(service, transport, header)
        except TransportException as error:
            rospy.logwarn("%s: %s", service.resolved_name, error)
            transport.close()

    def with_room(server):
        sock = make_socket(server)
        sock.listen(MAX_WAITING_CLIENTS)
        return sock

    TCPROSServer._tcp_server_callback = in_a_thread
    TCPServer._create_server_sock = with_room
    ServiceImpl.handle = handle_and_let_go
    TCPService.get_header_fields = with_types


def _header_has_come(sock: socket.socket) -> bool:
    """Wait until a whole handshake header can be read, and leave it unread."""
    with contextlib.suppress(OSError):
        # With a default timeout, which rospy sets, Python has unblocked the socket: the
        # first piece of a header would be taken for all of it.
        sock.setblocking(True)
        _set_timeout(sock, HANDSHAKE_TIMEOUT)
        length = sock.recv(_LENGTH.size, socket.MSG_PEEK | socket.MSG_WAITALL)
        if len(length) < _LENGTH.size:
            return False
        size = _LENGTH.size + _LENGTH.unpack(length)[0]
        if size > MAX_HEADER_SIZE:
            return False
        header = sock.recv(size, socket.MSG_PEEK | socket.MSG_WAITALL)
        _set_timeout(sock, 0)
        return len(header) == size
    return False


def _set_timeout(sock: socket.socket, seconds: int) -> None:
    """Set how long the system lets a read wait; 0: for ever.

    Not Python's own timeout: rospy's threads share the socket and would inherit it.
    """
    wait = struct.pack("ll", seconds, 0)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, wait)
