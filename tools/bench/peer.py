"""A node of the graph without rospy: one thread, one loop, raw bytes.

What it sends and receives goes through no queue, no lock and no other thread, so
that the times it notes are those of the sockets.
"""

import select
import socket
import struct
import time
from contextlib import suppress
from http.client import HTTPException
from xmlrpc.client import Error, ServerProxy
from xmlrpc.server import SimpleXMLRPCServer

import rosgraph

from .graph import MeasurementError
from tcpros import TIMEOUT, Messages, header_of, received_header

HOST = "127.0.0.1"
CHUNK = 1 << 18  # bytes read at once
KEPT = 100  # messages that wait for a slow subscriber, as in a queue of rospy


class Output:
    """A topic that is published, to whom shook hands for it."""

    def __init__(self, kind):
        """Begin without subscribers; ``kind`` is the message class."""
        self.kind = kind
        self.callers = {}  # names by socket
        self.unsent = {}  # bytes by socket

    def send(self, data):
        """Send a message, length and all; it is dropped for who is far behind."""
        for sock, waiting in self.unsent.items():
            if len(waiting) < KEPT * len(data):
                waiting += data
                self.flush(sock)

    def flush(self, sock):
        """Send what the socket takes."""
        with suppress(BlockingIOError, ConnectionError):
            del self.unsent[sock][: sock.send(self.unsent[sock])]

    def waiting(self):
        """List the sockets that could not take all."""
        return [sock for sock, waiting in self.unsent.items() if waiting]


class Input:
    """A topic that is subscribed to, at whoever publishes it."""

    def __init__(self, kind, take):
        """Begin without publishers.

        Args:
            kind: The message class.
            take: Called with the time it came and the bytes of each message.
        """
        self.kind = kind
        self.take = take
        self.sources = {}  # sockets by URI of the publisher


class Peer:
    """The node; ``serve`` is its loop."""

    def __init__(self, name="/benchmark"):
        """Open its two servers: for the master and nodes, and for data."""
        self.name = name
        self._master = rosgraph.Master(name)
        self._api = SimpleXMLRPCServer((HOST, 0), logRequests=False)
        for method, answer in (
            ("getPid", lambda caller: (1, "", 0)),
            ("paramUpdate", lambda caller, key, value: (1, "", 0)),
            ("shutdown", lambda caller, reason="": (1, "", 0)),
            ("requestTopic", self._request_topic),
            ("publisherUpdate", self._update_publishers),
        ):
            self._api.register_function(answer, method)
        self.uri = f"http://{HOST}:{self._api.server_address[1]}/"
        self._listener = socket.socket()
        self._listener.bind((HOST, 0))
        self._listener.listen(1024)
        self._outputs, self._inputs, self._services = {}, {}, {}
        self._wanted = []  # topics and URIs to connect to
        self._readers = {
            self._api.socket: self._api.handle_request,
            self._listener: self._accept,
        }

    def advertise(self, topic, kind):
        """Publish a topic; give its ``Output``."""
        self._outputs[topic] = Output(kind)
        self._master.registerPublisher(topic, kind._type, self.uri)
        return self._outputs[topic]

    def subscribe(self, topic, kind, take):
        """Subscribe to a topic; see ``Input``."""
        self._inputs[topic] = Input(kind, take)
        sources = self._master.registerSubscriber(topic, kind._type, self.uri)
        self._update_publishers("", topic, sources)
        return self._inputs[topic]

    def offer(self, service):
        """Be there for who waits for a service; nobody may call it."""
        place = "{}:{}".format(*self._listener.getsockname())
        self._services[service] = f"rosrpc://{place}"
        self._master.registerService(service, self._services[service], self.uri)

    def serve(self, until, enough=lambda: False):
        """Handle what comes until a moment, or until it is enough.

        Args:
            until: Time on the monotonic clock in [s].
            enough: Asked after each event.
        """
        late = False
        while not late and not enough():
            while self._wanted:
                self._connect(*self._wanted.pop())
            left = until - time.monotonic()
            late = left <= 0.0
            waiting = {s: o for o in self._outputs.values() for s in o.waiting()}
            readable, writable, _ = select.select(
                self._readers, waiting, (), max(left, 0.0)
            )
            for sock in writable:
                waiting[sock].flush(sock)
            for sock in readable:
                self._readers.get(sock, lambda: None)()

    def wait(self, condition, what, timeout=30.0):
        """Serve until a condition is true.

        Raises:
            MeasurementError: If it does not become true in time.
        """
        self.serve(time.monotonic() + timeout, condition)
        if not condition():
            raise MeasurementError(f"waited {timeout:.0f} s in vain for {what}")

    def close(self):
        """Leave the graph."""
        for topic in self._outputs:
            self._master.unregisterPublisher(topic, self.uri)
        for topic in self._inputs:
            self._master.unregisterSubscriber(topic, self.uri)
        for service, place in self._services.items():
            self._master.unregisterService(service, place)
        for sock in self._readers:
            sock.close()

    def _request_topic(self, caller, topic, protocols):
        """Tell a subscriber where the data is."""
        return 1, "", ["TCPROS", *self._listener.getsockname()]

    def _update_publishers(self, caller, topic, uris):
        """Note who publishes; the loop connects to those that are new."""
        known = self._inputs[topic].sources
        self._wanted += [(topic, uri) for uri in uris if uri not in known]
        return 1, "", 0

    def _accept(self):
        """Shake hands with a subscriber; who looks for a service goes by itself."""
        sock, _ = self._listener.accept()
        sock.settimeout(TIMEOUT)
        asked = received_header(sock)
        if "topic" not in asked:
            sock.close()
            return
        output = self._outputs[asked["topic"]]
        sock.sendall(self._header(asked["topic"], output.kind, latching=0))
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        sock.setblocking(False)
        output.callers[sock], output.unsent[sock] = asked["callerid"], bytearray()
        self._readers[sock] = lambda: self._hang_up_if_closed(sock, output)

    def _hang_up_if_closed(self, sock, output):
        """Forget a subscriber that hung up; they say nothing else."""
        if not received_or_nothing(sock):
            del output.callers[sock], output.unsent[sock], self._readers[sock]
            sock.close()

    def _connect(self, topic, uri):
        """Shake hands with a publisher; one that is gone is left out."""
        source, messages = self._inputs[topic], Messages()
        with suppress(OSError, Error, HTTPException):
            asked = ServerProxy(uri).requestTopic(self.name, topic, [["TCPROS"]])
            sock = socket.create_connection(tuple(asked[2][1:]), TIMEOUT)
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            sock.sendall(self._header(topic, source.kind, tcp_nodelay=1))
            received_header(sock)
            sock.setblocking(False)
            source.sources[uri] = sock

            def read():
                data = received_or_nothing(sock)
                now = time.monotonic()
                for body in messages.cut(data):
                    source.take(now, body)
                if not data:
                    del source.sources[uri], self._readers[sock]
                    sock.close()

            self._readers[sock] = read

    def _header(self, topic, kind, **fields):
        """Write our side of a handshake."""
        return header_of(
            callerid=self.name,
            topic=topic,
            type=kind._type,
            md5sum=kind._md5sum,
            message_definition=kind._full_text,
            **fields,
        )


def received_or_nothing(sock):
    """Read what is there; nothing where the connection ended."""
    try:
        return sock.recv(CHUNK)
    except ConnectionError:
        return b""


def stamp_of(body):
    """Return the stamp of an encoded message with a header, in [s]."""
    seconds, nanoseconds = struct.unpack_from("<II", body, 4)
    return seconds + 1e-9 * nanoseconds
