"""ROS' TCP protocol as bytes: lengths, handshakes, messages, service calls.

A client on raw sockets, so that what is sent may be anything, and costs little.
"""

import io
import socket
import struct
from urllib.parse import urlparse

import rosgraph
import rosservice

LENGTH = struct.Struct("<I")
ANSWER = struct.Struct("<BI")
TIMEOUT = 300.0
"""Longest wait for a connection or an answer in [s]."""
CALLER = "/tcpros_client"
"""What nodes are told of who calls."""


class HangupError(ConnectionError):
    """The node closed the connection."""


class ServiceError(ConnectionError):
    """The node answered with an error in place of a response."""


def packed(data):
    """Put a length in front of bytes."""
    return LENGTH.pack(len(data)) + data


def body_of(message):
    """Give the bytes of a message."""
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


def header_of(**fields):
    """Write a handshake."""
    lines = (f"{name}={value}".encode() for name, value in fields.items())
    return packed(b"".join(packed(line) for line in lines))


def received(sock, count):
    """Read so many bytes from a socket that waits for them.

    Raises:
        HangupError: If the connection ends before.
    """
    parts = []
    while count:
        try:
            part = sock.recv(min(count, 1 << 20))
        except ConnectionError as error:
            raise HangupError from error
        if not part:
            raise HangupError("the connection ended")
        parts.append(part)
        count -= len(part)
    return b"".join(parts)


def received_header(sock):
    """Read a handshake; give its fields by name."""
    data = received(sock, *LENGTH.unpack(received(sock, LENGTH.size)))
    fields, start = {}, 0
    while start < len(data):
        end = start + LENGTH.size + LENGTH.unpack_from(data, start)[0]
        name, _, value = data[start + LENGTH.size : end].partition(b"=")
        fields[name.decode()] = value.decode()
        start = end
    return fields


class Messages:
    """Cuts what comes from a socket into messages."""

    def __init__(self):
        """Begin with nothing."""
        self._buffer = bytearray()

    def cut(self, data):
        """Take bytes; give the bodies of the messages that are whole now."""
        buffer = self._buffer
        buffer += data
        bodies, start = [], 0
        while len(buffer) - start >= LENGTH.size:
            begin = start + LENGTH.size
            end = begin + LENGTH.unpack_from(buffer, start)[0]
            if end > len(buffer):
                break
            bodies.append(bytes(buffer[begin:end]))
            start = end
        del buffer[:start]
        return bodies


class Service:
    """One persistent connection to a service, made anew when it was lost."""

    def __init__(self, name, timeout=TIMEOUT):
        """Find the service.

        Args:
            name: Its full name.
            timeout: Longest wait for an answer in [s].
        """
        self.name = name
        self.kind = rosservice.get_service_class_by_name(name)
        self.request_class = self.kind._request_class
        place = urlparse(rosgraph.Master(CALLER).lookupService(name))
        self.place = place.hostname, place.port
        self._timeout = timeout
        self._socket = None

    def connect(self):
        """Shake hands; give the socket."""
        sock = socket.create_connection(self.place, self._timeout)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        fields = {"md5sum": self.kind._md5sum, "persistent": 1, "callerid": CALLER}
        sock.sendall(header_of(service=self.name, **fields))
        received_header(sock)
        return sock

    def send(self, body):
        """Send the bytes of a request; give those of the response.

        Raises:
            ServiceError: If the node answered with an error.
            HangupError: If the node closed the connection.
            socket.timeout: If it did not answer in time.
        """
        self._socket = self._socket or self.connect()
        try:
            self._socket.sendall(packed(body))
            ok, length = ANSWER.unpack(received(self._socket, ANSWER.size))
            answer = received(self._socket, length)
        except OSError:
            self.close()
            raise
        if not ok:
            raise ServiceError(answer.decode("utf-8", "replace"))
        return answer

    def request(self, *values, **fields):
        """Write the bytes of a request."""
        return body_of(self.request_class(*values, **fields))

    def __call__(self, *values, **fields):
        """Call the service as rospy does; give the response."""
        answer = self.send(self.request(*values, **fields))
        return self.kind._response_class().deserialize(answer)

    def close(self):
        """Hang up."""
        if self._socket is not None:
            self._socket.close()
        self._socket = None
