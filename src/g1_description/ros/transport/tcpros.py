"""rospy's TCP server, taught what roscpp's does.

rospy shakes hands with one client after the other, and a client that connects and
says nothing holds up all that come after it. Here each shakes hands in a thread of
its own, and has a few seconds for it. roscpp also names the types of a service's
request and response in its handshake; rospy does not.

A client whose request makes no sense is let go; rospy would let it wait for ever.
Many clients may come at the same time; rospy lets five wait for their turn.

rospy offers no way to set any of it, so its classes are changed, for the process of
the node that asks for it.
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

PATIENCE = 5
"""How long a client may take for its handshake, in [s]."""

WAITING = 1024
"""Clients that may wait for their turn."""

LONGEST_HEADER = 65536
"""Longest handshake header in bytes."""

HANDSHAKE = threading.local()
"""In the thread of a handshake: the number of its socket, as ``descriptor``."""

_LENGTH = struct.Struct("<I")


def serve_as_roscpp() -> None:
    """Change rospy's server; to be called before ``rospy.init_node``."""
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
        sock.listen(WAITING)
        return sock

    TCPROSServer._tcp_server_callback = in_a_thread
    TCPServer._create_server_sock = with_room
    ServiceImpl.handle = handle_and_let_go
    TCPService.get_header_fields = with_types


def _header_has_come(sock: socket.socket) -> bool:
    """Wait until a whole handshake header can be read, and leave it unread."""
    with contextlib.suppress(OSError):
        _set_patience(sock, PATIENCE)
        length = sock.recv(_LENGTH.size, socket.MSG_PEEK | socket.MSG_WAITALL)
        if len(length) < _LENGTH.size:
            return False
        size = _LENGTH.size + _LENGTH.unpack(length)[0]
        if size > LONGEST_HEADER:
            return False
        header = sock.recv(size, socket.MSG_PEEK | socket.MSG_WAITALL)
        _set_patience(sock, 0)
        return len(header) == size
    return False


def _set_patience(sock: socket.socket, seconds: int) -> None:
    """Set how long the system lets a read wait; 0: for ever.

    Not Python's own timeout: rospy's threads share the socket and would inherit it.
    """
    wait = struct.pack("ll", seconds, 0)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, wait)
