"""A publisher on raw sockets: known to the master as a node, and sends any bytes."""

import contextlib
import socket
import struct
import threading
from xmlrpc.server import SimpleXMLRPCServer

import rosgraph

from ..ros_testing import wait_for
from tcpros import LENGTH, HangupError, header_of, packed, received

RESET = struct.pack("ii", 1, 0)
"""SO_LINGER that makes closing a socket reset its connection."""


class RawPublisher:
    """A node with one topic. Its subscribers get what the test sends, as it is."""

    def __init__(self, topic, kind, name, answers=True):
        """Register with a master.

        Args:
            topic: Full name of the topic.
            kind: Class of the messages that it claims to send.
            name: Full name of the node.
            answers: Whether subscribers that connect get an answer at all.
        """
        self.topic, self._kind, self._name = topic, kind, name
        self._answers = answers
        self.sockets = []
        """Connections of subscribers."""
        self._listener = socket.create_server(("localhost", 0))
        self._node = SimpleXMLRPCServer(("localhost", 0), logRequests=False)
        self._node.register_function(self._request_topic, "requestTopic")
        self._node.register_function(lambda *_: (1, "", 0), "getPid")
        self._node.register_function(lambda *_: (1, "", 0), "publisherUpdate")
        self.uri = f"http://localhost:{self._node.server_address[1]}/"
        for target, *arguments in ((self._accept,), (self._node.serve_forever, 0.01)):
            threading.Thread(target=target, args=arguments, daemon=True).start()
        self._master = rosgraph.Master(name)
        self.register()

    def register(self):
        """Make the master tell the subscribers of this node."""
        self._master.registerPublisher(self.topic, self._kind._type, self.uri)

    def _request_topic(self, caller, topic, protocols):
        """Answer a subscriber's call."""
        place = ["TCPROS", "localhost", self._listener.getsockname()[1]]
        return 1, "ready", place

    def _accept(self):
        """Shake hands with each subscriber, one after the other."""
        with contextlib.suppress(OSError):  # closed
            while True:
                sock, _ = self._listener.accept()
                with contextlib.suppress(HangupError):
                    self._shake_hands(sock)

    def _shake_hands(self, sock):
        """Read a subscriber's handshake, and answer if this is to be done."""
        received(sock, LENGTH.unpack(received(sock, LENGTH.size))[0])
        if self._answers:
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            fields = {"type": self._kind._type, "md5sum": self._kind._md5sum}
            sock.sendall(header_of(callerid=self._name, topic=self.topic, **fields))
        self.sockets = [*self.sockets, sock]

    def wait_for_subscriber(self, count=1):
        """Wait until so many have connected."""
        wait_for(lambda: len(self.sockets) >= count, f"a connection to {self._name}")

    def send(self, data):
        """Send the bytes of one message."""
        self.send_raw(packed(data))

    def send_raw(self, data):
        """Send bytes without a length in front, to all who are still there."""
        for sock in self.sockets:
            with contextlib.suppress(OSError):
                sock.sendall(data)

    def reset(self):
        """Reset the connections, as a network does that fails."""
        sockets, self.sockets = self.sockets, []
        for sock in sockets:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
            sock.close()

    def die(self):
        """End at once and tell nobody, as a process does that is killed."""
        with contextlib.suppress(OSError):  # closed before
            self._listener.shutdown(socket.SHUT_RDWR)  # else accept() goes on
        self._listener.close()
        self._node.shutdown()
        self._node.server_close()
        self.reset()

    def close(self):
        """End as a node does."""
        with contextlib.suppress(OSError, rosgraph.MasterException):
            self._master.unregisterPublisher(self.topic, self.uri)
        self.die()
