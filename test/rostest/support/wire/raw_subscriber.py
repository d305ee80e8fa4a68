"""A subscriber on a raw socket, which reads when the test wants it to."""

import select
import socket
from xmlrpc.client import ServerProxy

import rospy

from ..ros_testing import DEADLINE
from tcpros import LENGTH, header_of, received


class RawSubscriber:
    """Connect to a topic of a node as another node of any name would."""

    def __init__(self, node_uri, topic, kind, name="/raw", buffer=None):
        self.topic = topic
        with ServerProxy(node_uri) as node:
            code, words, protocol = node.requestTopic(name, topic, [["TCPROS"]])
        assert code == 1, words
        self._socket = socket.socket()
        if buffer:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
        self._socket.connect((protocol[1], protocol[2]))
        self._socket.settimeout(DEADLINE)
        fields = {"topic": topic, "type": kind._type, "md5sum": kind._md5sum}
        self._socket.sendall(
            header_of(**fields, callerid=name, tcp_nodelay="1", message_definition="")
        )
        self.header = self._receive()

    def _receive(self):
        return received(self._socket, LENGTH.unpack(received(self._socket, 4))[0])

    def has_data(self, timeout=0.0):
        """Tell whether something is there to be read, or comes within so many [s]."""
        return bool(select.select([self._socket], [], [], timeout)[0])

    def read(self):
        """Give the next message's bytes."""
        return self._receive()

    def read_until(self, accept):
        """Read on to a message whose bytes are accepted; give all up to it."""
        read = [self._receive()]
        while not accept(read[-1]):
            read.append(self._receive())
        return read

    def read_all(self, quiet=0.5):
        """Read on until nothing has come for so long, in [s]; give all of it."""
        read = []
        while self.has_data(quiet):
            read.append(self._receive())
        return read

    def close(self):
        self._socket.close()


def own_uri():
    """Give the address of this node."""
    return rospy.get_node_uri()
