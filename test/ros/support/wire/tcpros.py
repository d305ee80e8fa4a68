"""Services on the wire: raw sockets, so that what is sent may be anything."""

import io
import socket
import struct
from urllib.parse import urlparse

import rosgraph
import rosservice

LENGTH = struct.Struct("<I")
ANSWER = struct.Struct("<BI")


class ServiceError(Exception):
    """The node answered with an error in place of a response."""


class HangupError(Exception):
    """The node closed the connection."""


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
    """Read so many bytes.

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
            raise HangupError
        parts.append(part)
        count -= len(part)
    return b"".join(parts)


class Service:
    """One persistent connection to a service, made anew when it was lost."""

    def __init__(self, name, patience=60.0):
        """Find the service.

        Args:
            name: Its full name.
            patience: Longest wait for an answer in [s].
        """
        self.name = name
        self.kind = rosservice.get_service_class_by_name(name)
        self.request_class = self.kind._request_class
        place = urlparse(rosgraph.Master("/fuzz").lookupService(name))
        self.place = place.hostname, place.port
        self._patience = patience
        self._socket = None

    def connect(self):
        """Shake hands; give the socket."""
        sock = socket.create_connection(self.place, self._patience)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        fields = {"md5sum": self.kind._md5sum, "persistent": 1, "callerid": "/fuzz"}
        sock.sendall(header_of(service=self.name, **fields))
        received(sock, *LENGTH.unpack(received(sock, LENGTH.size)))
        return sock

    def send(self, body):
        """Send the bytes of a request; give the bytes of the response.

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
        except (OSError, HangupError):
            self.close()
            raise
        if not ok:
            raise ServiceError(answer.decode("utf-8", "replace"))
        return answer

    def call(self, *args, **fields):
        """Call the service as rospy does."""
        answer = self.send(body_of(self.request_class(*args, **fields)))
        return self.kind._response_class().deserialize(answer)

    def close(self):
        if self._socket is not None:
            self._socket.close()
        self._socket = None


class Services:
    """All services of the node by their names below it."""

    def __init__(self, node="/gazebo"):
        master = rosgraph.Master("/fuzz")
        scope = f"{node}/"
        offered = (name for name, _ in master.getSystemState()[2])
        self.names = sorted(n[len(scope) :] for n in offered if n.startswith(scope))
        self._services = {name: Service(scope + name) for name in self.names}

    def __getitem__(self, name):
        """Give the connection to a service."""
        return self._services[name]

    def call(self, name, *args, **fields):
        """Call a service as rospy does."""
        return self._services[name].call(*args, **fields)

    def close(self):
        for service in self._services.values():
            service.close()
