"""A publisher that writes to its subscribers at once, and waits for none of them.

rospy's queue has a thread for each subscriber; waking them costs several times as much
as the sending, and they wait for the interpreter while it computes. Without a queue
rospy sends from the caller's thread, but then a subscriber that does not read stops
the caller. Here each subscriber gets a message at once where its socket has room, and
the newest few messages wait for those that have none.

Room is what the system reports, some hundred kilobytes: a message of megabytes to a
slow reader still blocks the caller, for half a second at most. This works with the
subscribers' sockets, which rospy does not give away: see subscribers.py.
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
from g1_description.ros.tcpros import HANDSHAKE

SEND_TIMEOUT = struct.pack("ll", 0, 500_000)
"""Longest time a subscriber may leave a message half read, as a struct timeval: 0.5 s.
After that rospy drops it."""

REFRESH_PERIOD = 0.5
"""Shortest time between two calls of getBusInfo, in [s]."""

PATIENCE = 10.0
"""Longest time in [s] that a connection is known before rospy tells the listener of it.
On a busy machine the thread of its handshake may wait for seconds for its turn."""

MAX_CALLS = 5
"""Number of times a node whose connection was closed is called again. A node that has
not noticed the end of a connection ignores the call."""

_SOCKET = re.compile(r"on socket (\d+)")
_OTHER, _DIRECTION, _TOPIC, _INFO = 1, 2, 4, 6  # where they are in a row of getBusInfo


@dataclass
class Peer:
    """One subscriber."""

    send: Callable
    """Publishes one message to it."""

    descriptor: int
    """Its socket."""

    waiting: deque
    """Messages that its socket had no room for."""

    is_own: bool
    """Whether it is this node itself."""

    is_stuck: bool = False
    """Whether it was waited for without success, and has read nothing since."""

    def send_waiting(self) -> None:
        """Send the messages that wait, as far as there is room."""
        room = select.poll()
        room.register(self.descriptor, select.POLLOUT)
        while self.waiting and room.poll(0):
            self.send(self.waiting.popleft())
            self.is_stuck = False


class Subscribers(rospy.SubscribeListener):
    """Advertises a topic and keeps a list of those who subscribe to it."""

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
            queue_size: Number of messages that wait for a slow subscriber.
            greet: Called with a subscriber, under the lock, before it is on the list.
            on_newcomer: Called after that, in the thread of the handshake.
        """
        self.name = rospy.resolve_name(name)
        self.lock = threading.Lock()
        """Held while messages are sent, so that a newcomer gets each message once."""
        self.peers: dict[int, Peer] = {}
        """Subscribers by the numbers of their connections; replaced, never changed."""
        self.poll = select.poll()
        """Watches the sockets of all peers."""
        self.n_known = 0
        """Number of connections that need no attention."""
        self._queue_size = queue_size
        self._greet, self._on_newcomer = greet, on_newcomer
        self._changing = threading.RLock()
        self._connections: dict[int, tuple[int, bool]] = {}
        self._strangers: dict[int, float] = {}  # since when, in [s]
        self._dismissed: dict[int, int] = {}
        self._refreshed = 0.0
        with warnings.catch_warnings():
            # rospy warns of a publisher that has no queue.
            warnings.simplefilter("ignore", SyntaxWarning)
            self.publisher = rospy.Publisher(name, kind, subscriber_listener=self)
        # rospy takes up subscribers before it knows the listener.
        self._update()
        self._turn_away({*self._strangers})

    def peer_subscribe(self, topic_name, topic_publish, peer_publish) -> None:
        """Add a subscriber; rospy calls this in the thread of its handshake."""
        descriptor = getattr(HANDSHAKE, "descriptor", None)
        with self._changing:
            self._update()
            # Without threads of their own, handshakes come one after the other.
            fitting = [
                number
                for number in sorted(self._strangers)
                if descriptor in (None, self._connections[number][0])
            ]
            if fitting:
                del self._strangers[fitting[-1]]
                with contextlib.suppress(OSError):  # it is gone again
                    self._add(fitting[-1], partial(self._publish, peer_publish))
        self._on_newcomer()

    def _publish(self, peer_publish: Callable, message) -> None:
        """Publish to one subscriber while no other publisher of the topic does."""
        shared = self.publisher.impl
        shared.acquire()
        try:
            peer_publish(message)
        finally:
            shared.release()

    def peer_unsubscribe(self, topic_name, num_peers) -> None:
        """Make the next refresh due; rospy calls this and does not say who left."""
        self._refreshed = 0.0

    def refresh(self) -> None:
        """Remove those who left; turn away those who were not added for a while."""
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
                rospy.logwarn_once("This node cannot reach itself: %s", error)
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
        """Count the peers, and the connections that are given up."""
        given_up = list(self._dismissed.values()).count(0)
        self.n_known = len(self.peers) + given_up

    def _add(self, number: int, send: Callable) -> None:
        """Put a connection on the list of subscribers."""
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
        """Close connections, and let the master call their nodes again."""
        for number in strangers:
            descriptor, _ = self._connections[number]
            with contextlib.suppress(OSError), _borrowed(descriptor) as sock:
                sock.shutdown(socket.SHUT_RDWR)
            self._dismissed[number] = MAX_CALLS
        if any(self._dismissed.values()):
            self._dismissed = {n: max(0, k - 1) for n, k in self._dismissed.items()}
            self._count_known()
            # A master that cannot be reached may take a minute to say so.
            threading.Thread(target=self._call, daemon=True).start()

    def _call(self) -> None:
        """Let the master notify all subscribers of this publisher."""
        with contextlib.suppress(*SLAVE_API_ERRORS, rosgraph.MasterException):
            rosgraph.Master(rospy.get_name()).registerPublisher(
                self.name, self.publisher.type, rospy.get_node_uri()
            )


def _connections_of(topic: str) -> dict[int, tuple[int, bool]]:
    """Ask the node for the outgoing connections of a topic."""
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
    """Open a socket by its number; it stays open, and as blocking as it was."""
    blocking = os.get_blocking(descriptor)
    with socket.socket(fileno=os.dup(descriptor)) as sock:
        # With a default timeout, which rospy sets, Python has unblocked it.
        os.set_blocking(descriptor, blocking)
        yield sock


OWN_SHARE = 10
"""A node that subscribes to itself, as rospy does to /clock, gets every tenth message,
and the last one when it flushes: it knows the time, and reading costs it time."""

ROOM_TIMEOUT = 10
"""Longest wait for room in one round of ``wait_for_room``, in [ms]."""


class DirectPublisher:
    """Publishes from the caller's thread, and lets no subscriber stop it."""

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
            kind: Class of its messages. rospy counts each subscriber's copy in
                ``header.seq``; a class that counts itself has ``_has_header = False``.
            queue_size: Number of messages that wait for a slow subscriber.
            latch: Whether a new subscriber gets the newest message.
            on_newcomer: Called when a subscriber has come, in the thread of its
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
        """Return whether a node has connected.

        Args:
            node: Its full name.
        """
        return self._publisher.impl.has_connection(node)

    def publish(self, message) -> None:
        """Send a message to all subscribers that have room, keep it for the others.

        While rospy closes the topics nothing is sent.
        """
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
        """Send a message to each subscriber, or keep it for it."""
        self._count += 1
        ready = dict(self._subscribers.poll.poll(0))  # by sockets; broken ones as well
        for peer in self._subscribers.peers.values():
            is_skipped = peer.is_own and self._count % OWN_SHARE
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
        """Send a new subscriber nothing until there is a new message."""
        with self._subscribers.lock:
            self._newest = None

    def flush(self) -> None:
        """Send the messages that wait to those who have room by now."""
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
        """Wait until no message waits for any subscriber.

        Args:
            timeout: Longest time in [s] in which a subscriber may read nothing. It is
                not waited for again until it does.
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
