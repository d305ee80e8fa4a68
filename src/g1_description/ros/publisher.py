"""A publisher that sends from the caller's thread and never waits for a subscriber.

rospy's queue has a thread per subscriber; waking it costs several times as much as the
sending. Without a queue rospy sends from the caller's thread, but a subscriber that
does not read blocks it. Here a message is sent at once if the socket has room;
otherwise the newest few are queued.

A message of megabytes to a slow reader still blocks, for half a second at most.
rospy does not expose the subscribers' sockets: ``Subscribers`` finds them.
"""

from __future__ import annotations

import contextlib
import os
import re
import select
import socket
import struct
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import rosgraph
import rospy

from g1_description.ros.master import SLAVE_API_ERRORS, slave_api
from g1_description.ros.rospy_tcp import HANDSHAKE

SEND_TIMEOUT = struct.pack("ll", 0, 500_000)
"""Longest time to send one message, as a struct timeval: 0.5 s. After that rospy drops
the subscriber."""

REFRESH_PERIOD = 0.5
"""Shortest time between two calls of getBusInfo, in [s]."""

PATIENCE = 10.0
"""Longest time in [s] from a connection to rospy's callback ``peer_subscribe``. On a
busy machine the thread of the handshake may wait for seconds."""

MAX_CALLS = 5
"""Number of times a node whose connection was closed is notified again: it ignores the
notification until it has noticed the closing."""

_SOCKET = re.compile(r"on socket (\d+)")
_OTHER, _DIRECTION, _TOPIC, _INFO = 1, 2, 4, 6  # where they are in a row of getBusInfo


@dataclass
class Peer:
    """One subscriber."""

    send: Callable
    """Sends it one message."""

    descriptor: int
    """Its socket."""

    waiting: deque
    """Queued messages, for which the socket had no room."""

    is_own: bool
    """Whether it belongs to this node."""

    is_stuck: bool = False
    """Whether a wait for it timed out, and it has read nothing since."""

    def send_waiting(self) -> None:
        """Send queued messages while there is room."""
        room = select.poll()
        room.register(self.descriptor, select.POLLOUT)
        while self.waiting and room.poll(0):
            self.send(self.waiting.popleft())
            self.is_stuck = False


class Subscribers(rospy.SubscribeListener):
    """Advertises a topic and lists its subscribers with their sockets."""

    def __init__(
        self,
        name: str,
        kind: type,
        queue_size: int,
        greet: Callable[[Peer], None],
        on_newcomer: Callable[[], None],
    ) -> None:
        """Advertise a topic.

        Args:
            name: The topic.
            kind: Class of its messages.
            queue_size: Number of messages queued for a slow subscriber.
            greet: Called with a new subscriber, under the lock, before it is listed.
            on_newcomer: Called after that, in the thread of the handshake.
        """
        self.name = rospy.resolve_name(name)
        self.lock = threading.Lock()
        """Locked while messages are sent, so that a new one gets each message once."""
        self.peers: dict[int, Peer] = {}
        """Subscribers by connection number; replaced, never mutated."""
        self.poll = select.poll()
        """Watches the sockets of all peers."""
        self.n_known = 0
        """Number of connections that are listed or given up."""
        self._queue_size = queue_size
        self._greet, self._on_newcomer = greet, on_newcomer
        self._changing = threading.RLock()
        self._connections: dict[int, tuple[int, bool]] = {}
        self._strangers: dict[int, float] = {}  # since when, in [s]
        self._dismissed: dict[int, int] = {}
        self._refreshed = 0.0
        with warnings.catch_warnings():
            # rospy warns of a publisher without a queue.
            warnings.simplefilter("ignore", SyntaxWarning)
            self.publisher = rospy.Publisher(name, kind, subscriber_listener=self)
        # rospy may have accepted subscribers before it knew this listener.
        self._update()
        self._turn_away({*self._strangers})

    def peer_subscribe(self, topic_name, topic_publish, peer_publish) -> None:
        """Add a subscriber; rospy calls this in the thread of its handshake."""
        descriptor = getattr(HANDSHAKE, "descriptor", None)
        with self._changing:
            self._update()
            # Without serve_as_roscpp handshakes are sequential.
            fitting = [
                number
                for number in sorted(self._strangers)
                if descriptor in (None, self._connections[number][0])
            ]
            if fitting:
                del self._strangers[fitting[-1]]
                with contextlib.suppress(OSError):  # it has disconnected
                    self._add(fitting[-1], partial(self._publish, peer_publish))
        self._on_newcomer()

    def _publish(self, peer_publish: Callable, message) -> None:
        """Send to one subscriber, under rospy's lock of the topic."""
        shared = self.publisher.impl
        shared.acquire()
        try:
            peer_publish(message)
        finally:
            shared.release()

    def peer_unsubscribe(self, topic_name, num_peers) -> None:
        """Make the next refresh due; rospy does not pass the connection."""
        self._refreshed = 0.0

    def refresh(self) -> None:
        """Prune closed connections; disconnect those that were never listed."""
        now = time.monotonic()
        if now - self._refreshed < REFRESH_PERIOD:
            return
        if self._changing.acquire(blocking=False):
            try:
                self._refreshed = now
                self._update()
                since = self._strangers.items()
                self._turn_away({n for n, begin in since if now - begin > PATIENCE})
            finally:
                self._changing.release()

    def _update(self) -> None:
        """Compare the subscribers with the node's connections."""
        try:
            self._connections = _connections_of(self.name)
        except SLAVE_API_ERRORS as error:
            if not rospy.core.is_shutdown_requested():
                rospy.logwarn_once(
                    "This node cannot reach its own slave API: %s", error
                )
            return
        here = set(self._connections)
        for number in set(self.peers) - here:
            with contextlib.suppress(KeyError):
                self.poll.unregister(self.peers[number].descriptor)
        self.peers = {n: peer for n, peer in self.peers.items() if n in here}
        self._dismissed = {n: k for n, k in self._dismissed.items() if n in here}
        now, known = time.monotonic(), {*self.peers, *self._dismissed}
        self._strangers = {n: self._strangers.get(n, now) for n in here - known}
        self._count_known()

    def _count_known(self) -> None:
        """Count listed and given up connections."""
        given_up = list(self._dismissed.values()).count(0)
        self.n_known = len(self.peers) + given_up

    def _add(self, number: int, send: Callable) -> None:
        """List a connection as a subscriber."""
        descriptor, is_own = self._connections[number]
        with _borrowed(descriptor) as sock:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, SEND_TIMEOUT)
        self.poll.register(descriptor, select.POLLOUT)
        waiting: deque = deque(maxlen=1 if is_own else self._queue_size)
        peer = Peer(send, descriptor, waiting, is_own)
        with self.lock:
            self._greet(peer)
            self.peers = {**self.peers, number: peer}
        self._count_known()

    def _turn_away(self, strangers: set[int]) -> None:
        """Close connections, and let the master notify their nodes again."""
        for number in strangers:
            descriptor, _ = self._connections[number]
            with contextlib.suppress(OSError), _borrowed(descriptor) as sock:
                sock.shutdown(socket.SHUT_RDWR)
            self._dismissed[number] = MAX_CALLS
        if any(self._dismissed.values()):
            self._dismissed = {n: max(0, k - 1) for n, k in self._dismissed.items()}
            self._count_known()
            # In a thread: a call of an unreachable master may take a minute.
            threading.Thread(target=self._call, daemon=True).start()

    def _call(self) -> None:
        """Let the master notify all subscribers of this publisher."""
        with contextlib.suppress(*SLAVE_API_ERRORS, rosgraph.MasterException):
            rosgraph.Master(rospy.get_name()).registerPublisher(
                self.name, self.publisher.type, rospy.get_node_uri()
            )


def _connections_of(topic: str) -> dict[int, tuple[int, bool]]:
    """Return socket, and whether it is the node's own, of outgoing connections."""
    own = rospy.get_name()
    with slave_api() as node:
        rows = node.getBusInfo(own)[2]
    found = (
        (row[0], _SOCKET.search(row[_INFO]), row[_OTHER] == own)
        for row in rows
        if row[_TOPIC] == topic and row[_DIRECTION] == "o"
    )
    return {n: (int(match.group(1)), is_own) for n, match, is_own in found if match}


@contextlib.contextmanager
def _borrowed(descriptor: int) -> Iterator[socket.socket]:
    """Open a socket by its descriptor; it stays open, and its blocking mode is kept."""
    blocking = os.get_blocking(descriptor)
    with socket.socket(fileno=os.dup(descriptor)) as sock:
        # With a default timeout, which rospy sets, Python has unblocked it.
        os.set_blocking(descriptor, blocking)
        yield sock


OWN_INTERVAL = 10
"""A node that subscribes to itself, as rospy does to /clock, gets every tenth message,
and the last one with a flush: reading costs processor time."""

ROOM_TIMEOUT = 10
"""Longest wait for room in one round of ``wait_for_room``, in [ms]."""


class DirectPublisher:
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
        self._latch, self._newest = latch, None
        self._count = 0
        self._subscribers = Subscribers(
            name, kind, queue_size, self._greet, on_newcomer
        )
        self.name = self._subscribers.name
        self._publisher = self._subscribers.publisher

    def get_num_connections(self) -> int:
        """Return the number of subscribers."""
        return self._publisher.get_num_connections()

    def is_heard_by(self, node: str) -> bool:
        """Return whether a node, given by its full name, has connected."""
        return self._publisher.impl.has_connection(node)

    def publish(self, message) -> None:
        """Send a message to all subscribers with room, queue it for the others."""
        subscribers = self._subscribers
        if self._publisher.get_num_connections() != subscribers.n_known:
            subscribers.refresh()
        if not subscribers.peers and not self._latch:
            return
        with subscribers.lock:
            if self._latch:
                self._newest = message
            try:
                self._send(message)
            except rospy.ROSException:
                # rospy closes topics before its ``is_shutdown`` turns true.
                if not rospy.core.is_shutdown_requested():
                    raise

    def _send(self, message) -> None:
        """Send a message to each subscriber, or queue it."""
        self._count += 1
        ready = dict(self._subscribers.poll.poll(0))  # by socket; broken ones, too
        for peer in self._subscribers.peers.values():
            is_skipped = peer.is_own and self._count % OWN_INTERVAL
            if peer.descriptor not in ready or is_skipped:
                peer.waiting.append(message)
            elif peer.waiting:
                peer.waiting.append(message)
                peer.send_waiting()
            else:
                peer.send(message)

    def _greet(self, peer: Peer) -> None:
        """Send the newest message to a new subscriber."""
        if self._newest is not None:
            peer.send(self._newest)

    def forget(self) -> None:
        """Forget the latched message."""
        with self._subscribers.lock:
            self._newest = None

    def flush(self) -> None:
        """Send queued messages to the subscribers that have room now."""
        subscribers = self._subscribers
        if self._publisher.get_num_connections() != subscribers.n_known:
            subscribers.refresh()
        if any(peer.waiting for peer in subscribers.peers.values()):
            with subscribers.lock:
                ready = dict(subscribers.poll.poll(0))
                for peer in subscribers.peers.values():
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
                for peer in self._subscribers.peers.values()
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
