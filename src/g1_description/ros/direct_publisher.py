"""A publisher that writes to its subscribers at once, and waits for none of them.

rospy's queue has a thread for each subscriber; waking them costs several times what
the sending does, and they wait for the interpreter while it computes. Without its
queue rospy sends from the caller's thread, but a subscriber that stands still would
stop the caller. Here each subscriber gets a message at once where its socket has
room; for those that have none the newest few messages are kept. All by public means:
a SubscribeListener gives what publishes to one subscriber, the slave API's getBusInfo
tells its socket.
"""

from __future__ import annotations

import contextlib
import os
import re
import select
import socket
import struct
import threading
import warnings
from collections import deque
from dataclasses import dataclass
from xmlrpc.client import ServerProxy

import rospy

STALLED = struct.pack("ll", 0, 500_000)
"""How long a subscriber may leave a message half taken, as a struct timeval: 0.5 s.
Then rospy lets it go."""

OWN = 10
"""A node that listens to itself, as one does that publishes /clock, gets each message
of so many; the last one too, when it flushes."""

_SOCKET = re.compile(r"on socket (\d+)")
_OTHER, _TOPIC, _INFO = 1, 4, 6  # where they are in a row of getBusInfo


@dataclass
class Peer:
    """One subscriber."""

    send: object
    """Publishes one message to it."""

    descriptor: int
    """Its socket."""

    waiting: deque
    """Messages that its socket had no room for."""

    is_own: bool
    """Whether it is this node itself."""


class DirectPublisher(rospy.SubscribeListener):
    """Publish from the caller's thread, and let no subscriber stop it."""

    def __init__(self, name: str, kind, queue_size: int) -> None:
        """Advertise a topic.

        Args:
            name: The topic.
            kind: Class of its messages. rospy counts each subscriber's copy in
                ``header.seq``; a class that counts itself has ``_has_header = False``.
            queue_size: Messages kept for a subscriber that is slow.
        """
        self._name = rospy.resolve_name(name)
        self._queue_size = queue_size
        self._changing, self._sending = threading.Lock(), threading.Lock()
        self._peers: dict[int, Peer] = {}
        self._coming = self._left = False
        self._count = 0
        self._poll = select.poll()
        with warnings.catch_warnings():
            # rospy warns of a publisher that has no queue.
            warnings.simplefilter("ignore", SyntaxWarning)
            self._publisher = rospy.Publisher(name, kind, subscriber_listener=self)

    def get_num_connections(self) -> int:
        """Count the subscribers."""
        return self._publisher.get_num_connections()

    def publish(self, message) -> None:
        """Send a message to all subscribers that have room, keep it for the others."""
        if self._left:
            self._left = False
            self._look_who_is_there()
        unknown = self.get_num_connections() > len(self._peers)
        if unknown and not self._coming:
            self._publisher.publish(message)
        elif self._peers:
            with self._sending:
                self._send(message)

    def _send(self, message) -> None:
        """Send a message to each subscriber, or keep it for it."""
        self._count += 1
        ready = self._ready()
        for peer in self._peers.values():
            if peer.descriptor not in ready or (peer.is_own and self._count % OWN):
                peer.waiting.append(message)
            elif peer.waiting:
                peer.waiting.append(message)
                self._send_waiting(peer)
            else:
                peer.send(message)

    def flush(self) -> None:
        """Send what is kept to those who have room by now."""
        if any(peer.waiting for peer in self._peers.values()):
            with self._sending:
                ready = self._ready()
                for peer in self._peers.values():
                    if peer.descriptor in ready:
                        self._send_waiting(peer)

    def _ready(self) -> set[int]:
        """Find the sockets that can be written to, or are broken."""
        return {descriptor for descriptor, _ in self._poll.poll(0)}

    @staticmethod
    def _send_waiting(peer: Peer) -> None:
        """Send what is kept for a subscriber, as far as there is room."""
        room = select.poll()
        room.register(peer.descriptor, select.POLLOUT)
        while peer.waiting and room.poll(0):
            peer.send(peer.waiting.popleft())

    def peer_subscribe(self, topic_name, topic_publish, peer_publish) -> None:
        """Take up a subscriber; rospy calls this, for one at a time."""
        self._coming = True
        self._look_who_is_there(peer_publish)
        self._coming = False

    def peer_unsubscribe(self, topic_name, num_peers) -> None:
        """Note that a subscriber left; rospy calls this and does not say which."""
        self._left = True

    def _look_who_is_there(self, send=None) -> None:
        """Take up a new subscriber and forget those who left.

        Args:
            send: What publishes to the new one, if there is one.
        """
        try:
            connections = self._connections()
        except OSError as error:
            rospy.logwarn("This node cannot be reached at its address: %s", error)
            return
        with self._changing:
            peers = {n: peer for n, peer in self._peers.items() if n in connections}
            for number in set(self._peers) - set(peers):
                with contextlib.suppress(KeyError):
                    self._poll.unregister(self._peers[number].descriptor)
            for number in set(connections) - set(peers) if send else ():
                peers[number] = self._peer(send, *connections[number])
            self._peers = peers

    def _peer(self, send, descriptor: int, is_own: bool) -> Peer:
        """Make what is kept of a new subscriber."""
        _bound_patience(descriptor)
        self._poll.register(descriptor, select.POLLOUT)
        waiting = deque(maxlen=1 if is_own else self._queue_size)
        return Peer(send, descriptor, waiting, is_own)

    def _connections(self) -> dict[int, tuple[int, bool]]:
        """Ask the node for the topic's connections.

        Returns:
            By their numbers, their sockets and whether they are the node's own.
        """
        own = rospy.get_name()
        with ServerProxy(rospy.get_node_uri()) as node:
            rows = node.getBusInfo(own)[2]
        found = (
            (row[0], _SOCKET.search(row[_INFO]), row[_OTHER] == own)
            for row in rows
            if row[_TOPIC] == self._name and row[2] == "o"
        )
        return {n: (int(match.group(1)), is_own) for n, match, is_own in found if match}


def _bound_patience(descriptor: int) -> None:
    """Set how long the system lets a write to a socket wait."""
    with contextlib.suppress(OSError), socket.socket(fileno=os.dup(descriptor)) as sock:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, STALLED)
