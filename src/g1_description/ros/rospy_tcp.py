"""Changes to rospy's TCP server that make it behave like roscpp's.

rospy's handshakes are sequential, so a client that connects and sends nothing blocks
all others. Here each handshake has its own thread and a timeout. As in roscpp, it also
has the types of a service's request and response.

A client with a malformed request is disconnected; rospy would let it wait for ever.
The backlog of the socket is larger than rospy's five.

rospy has no options for these, so four private functions of its classes are replaced in
the process that calls ``serve_as_roscpp``.
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
"""Backlog of the server's socket."""

MAX_HEADER_SIZE = 65536
"""Longest handshake header in bytes: a few names and a message definition."""

_LENGTH = struct.Struct("<I")


def serve_as_roscpp() -> None:
    """Change rospy's server. Call it before ``rospy.init_node``."""
    shake_hands = TCPROSServer._tcp_server_callback
    header_fields = TCPService.get_header_fields
    handle, make_socket = ServiceImpl.handle, TCPServer._create_server_sock

    def wait_and_shake_hands(server, sock, address):
        if _header_has_come(sock):
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
        # first part of a header would be taken for all of it.
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
    """Set the system's timeout of reads; 0: none.

    Not Python's timeout, which rospy's threads would inherit with the socket.
    """
    wait = struct.pack("ll", seconds, 0)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, wait)
