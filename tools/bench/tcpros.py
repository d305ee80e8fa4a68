"""ROS' TCP protocol as bytes: lengths, handshakes, messages, service calls."""

import io
import socket
import struct
from urllib.parse import urlparse

import rosgraph
import rosservice

LENGTH = struct.Struct("<I")
ANSWER = struct.Struct("<BI")
PATIENCE = 10.0  # [s]


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
        ConnectionError: If the connection ends before.
    """
    parts = []
    while count:
        part = sock.recv(min(count, 1 << 20))
        if not part:
            raise ConnectionError("the connection ended")
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
    """One persistent connection to a service."""

    def __init__(self, name):
        """Find the service and shake hands."""
        self.kind = rosservice.get_service_class_by_name(name)
        place = urlparse(rosgraph.Master("/benchmark").lookupService(name))
        self._socket = socket.create_connection((place.hostname, place.port), PATIENCE)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        fields = {"md5sum": self.kind._md5sum, "persistent": 1}
        self._socket.sendall(header_of(service=name, callerid="/benchmark", **fields))
        received_header(self._socket)

    def send(self, request):
        """Send the bytes of a request, length and all; give those of the answer.

        Raises:
            ConnectionError: If the node refused.
        """
        self._socket.sendall(request)
        ok, length = ANSWER.unpack(received(self._socket, ANSWER.size))
        answer = received(self._socket, length)
        if not ok:
            raise ConnectionError(answer.decode("utf-8", "replace"))
        return answer

    def request(self, *values):
        """Write a request, length and all."""
        return packed(body_of(self.kind._request_class(*values)))

    def __call__(self, *values):
        """Call it; give the response."""
        return self.kind._response_class().deserialize(self.send(self.request(*values)))

    def close(self):
        """Hang up."""
        self._socket.close()
