"""A publisher that sends from the caller's thread and never waits for a subscriber.

rospy's queue has a thread per subscriber; waking it costs several times as much as the
sending. Without a queue rospy sends from the caller's thread, but a subscriber that
does not read blocks it. Here a message is sent at once if the socket has room;
otherwise the newest few are queued.

A message of megabytes to a slow reader still blocks, for half a second at most.
"""

from __future__ import annotations

import contextlib
import select
import socket
import struct
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable

import rospy

SEND_TIMEOUT = struct.pack("ll", 0, 500_000)
"""Longest time to send one message, as a struct timeval: 0.5 s. After that rospy drops
the subscriber."""

OWN_INTERVAL = 10
"""A node that subscribes to itself, as rospy does to /clock, gets every tenth message,
and the last one with a flush: reading costs processor time."""

ROOM_TIMEOUT = 10
"""Longest wait for room in one round of ``wait_for_room``, in [ms]."""


class Peer:
    """One subscriber: a connection of rospy's, and messages queued for it."""

    def __init__(self, topic, connection, queue_size: int) -> None:
        """Limit how long a message to it may take.

        Args:
            topic: rospy's implementation of the publisher.
            connection: One of its connections.
            queue_size: Number of messages queued while its socket has no room.
        """
        self._topic, self.connection = topic, connection
        self.descriptor: int = connection.fileno()
        self.is_own: bool = connection.endpoint_id == rospy.get_name()
        self.waiting: deque = deque(maxlen=1 if self.is_own else queue_size)
        self.is_stuck = False
        """Whether a wait for it timed out, and it has read nothing since."""
        connection.socket.setsockopt(
            socket.SOL_SOCKET, socket.SO_SNDTIMEO, SEND_TIMEOUT
        )

    def send(self, message) -> None:
        """Send a message, under rospy's lock of the topic."""
        self._topic.acquire()
        try:
            self._topic.publish(message, connection_override=self.connection)
        finally:
            self._topic.release()

    def send_waiting(self) -> None:
        """Send queued messages while there is room."""
        room = select.poll()
        room.register(self.descriptor, select.POLLOUT)
        while self.waiting and room.poll(0):
            self.send(self.waiting.popleft())
            self.is_stuck = False


class DirectPublisher(rospy.SubscribeListener):
    """Publishes from the caller's thread; slow subscribers do not block it."""

    def __init__(
        self,
        name: str,
        kind: type,
        queue_size: int,
        latch: bool = False,
        on_newcomer: Callable[[], None] = lambda: None,
    ) -> None:
        """Advertise a topic.

        Args:
            name: The topic.
            kind: Class of its messages. rospy sets ``header.seq`` unless a class has
                ``_has_header = False``.
            queue_size: Number of messages queued for a slow subscriber.
            latch: Whether a new subscriber gets the newest message.
            on_newcomer: Called after a subscriber has connected, in the thread of its
                handshake.
        """
        self.name = rospy.resolve_name(name)
        self._queue_size, self._latch, self._newest = queue_size, latch, None
        self._on_newcomer = on_newcomer
        self._count = 0
        self._lock = threading.Lock()
        """Locked while messages are sent, so that a new subscriber gets each once."""
        self._poll = select.poll()
        self._connections: list = []
        """rospy's list that ``_peers`` was made from; replaced at each change."""
        self._peers: list[Peer] = []
        with warnings.catch_warnings():
            # rospy warns of a publisher without a queue.
            warnings.simplefilter("ignore", SyntaxWarning)
            self._publisher = rospy.Publisher(name, kind)
        # Subscribers may have come before; the first publish takes them up.
        self._publisher.impl.add_subscriber_listener(self)

    def peer_subscribe(self, topic_name, topic_publish, peer_publish) -> None:
        """Add a subscriber; rospy calls this in the thread of its handshake."""
        with self._lock:
            self._update()
        self._on_newcomer()

    def get_num_connections(self) -> int:
        """Return the number of subscribers."""
        return self._publisher.get_num_connections()

    def publish(self, message) -> None:
        """Send a message to all subscribers with room, queue it for the others."""
        with self._lock:
            try:
                self._update()
                if self._latch:
                    self._newest = message
                self._send(message)
            except rospy.ROSException:
                # rospy closes topics before its ``is_shutdown`` turns true.
                if not rospy.core.is_shutdown_requested():
                    raise

    def _update(self) -> None:
        """Send the newest message to new subscribers; forget those that have left."""
        connections = self._publisher.impl.connections
        if connections is self._connections:
            return
        known = {peer.connection: peer for peer in self._peers}
        peers, poll = [], select.poll()  # numbers of sockets are used again
        for connection in connections:
            with contextlib.suppress(OSError, AttributeError):  # it has disconnected
                peer = known.get(connection)
                if peer is None:
                    peer = Peer(self._publisher.impl, connection, self._queue_size)
                    if self._newest is not None:
                        peer.send(self._newest)
                poll.register(peer.descriptor, select.POLLOUT)
                peers.append(peer)
        self._connections, self._poll, self._peers = connections, poll, peers

    def _send(self, message) -> None:
        """Send a message to each subscriber, or queue it."""
        self._count += 1
        ready = dict(self._poll.poll(0))  # by socket; broken ones, too
        for peer in self._peers:
            is_skipped = peer.is_own and self._count % OWN_INTERVAL
            if peer.descriptor not in ready or is_skipped:
                peer.waiting.append(message)
            elif peer.waiting:
                peer.waiting.append(message)
                peer.send_waiting()
            else:
                peer.send(message)

    def forget(self) -> None:
        """Forget the latched message."""
        with self._lock:
            self._newest = None

    def flush(self) -> None:
        """Send queued messages to the subscribers that have room now."""
        if not any(peer.waiting for peer in self._peers):
            return
        with self._lock:
            self._update()
            ready = dict(self._poll.poll(0))
            for peer in self._peers:
                if peer.descriptor in ready:
                    peer.send_waiting()

    def wait_for_room(self, timeout: float) -> None:
        """Wait until no message is queued.

        Args:
            timeout: Longest time in [s] without progress. A subscriber that has timed
                out is not waited for until it reads again.
        """
        end = time.monotonic() + timeout
        while True:
            self.flush()
            behind = [
                peer
                for peer in self._peers
                if peer.waiting and not (peer.is_own or peer.is_stuck)
            ]
            if not behind:
                return
            room = select.poll()
            for peer in behind:
                room.register(peer.descriptor, select.POLLOUT)
            if room.poll(ROOM_TIMEOUT):
                end = time.monotonic() + timeout
            elif time.monotonic() > end:
                for peer in behind:
                    peer.is_stuck = True
