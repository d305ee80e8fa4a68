"""A publisher that writes to its subscribers at once, and waits for none of them.

rospy's queue has a thread for each subscriber; waking them costs several times what
the sending does, and they wait for the interpreter while it computes. Without its
queue rospy sends from the caller's thread, but a subscriber that stands still would
stop the caller. Here each subscriber gets a message at once where its socket has
room; for those that have none the newest few messages are kept. Room is the system's
word, some hundred kilobytes: a message of megabytes to a slow reader takes its time,
half a second at most. All by public means: a SubscribeListener gives what publishes
to one subscriber, the slave API's getBusInfo tells its socket.
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
from collections.abc import Callable
from dataclasses import dataclass

import rosgraph
import rospy

from g1_description.ros.node.own_node import FAILURES, own_node

from .tcpros import HANDSHAKE

STALLED = struct.pack("ll", 0, 500_000)
"""How long a subscriber may leave a message half taken, as a struct timeval: 0.5 s.
Then rospy lets it go."""

LOOK = 0.5
"""Who is there is asked for no more often than this, in [s]."""

CALLS = 5
"""How often a node that was turned away is called again."""

OWN = 10
"""A node that listens to itself, as one does that publishes /clock, gets each message
of so many; the last one too, when it flushes."""

_SOCKET = re.compile(r"on socket (\d+)")
_OTHER, _DIRECTION, _TOPIC, _INFO = 1, 2, 4, 6  # where they are in a row of getBusInfo


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

    is_stuck: bool = False
    """Whether it was waited for in vain, and has taken nothing since."""


class DirectPublisher(rospy.SubscribeListener):
    """Publish from the caller's thread, and let no subscriber stop it."""

    def __init__(
        self,
        name: str,
        kind,
        queue_size: int,
        latch: bool = False,
        on_newcomer: Callable[[], None] = lambda: None,
    ) -> None:
        """Advertise a topic.

        Args:
            name: The topic.
            kind: Class of its messages. rospy counts each subscriber's copy in
                ``header.seq``; a class that counts itself has ``_has_header = False``.
            queue_size: Messages kept for a subscriber that is slow.
            latch: Whether a subscriber that comes gets the newest message.
            on_newcomer: Called when a subscriber has come, in the thread of its
                handshake.
        """
        self.name = rospy.resolve_name(name)
        self._queue_size = queue_size
        self._latch, self._newest = latch, None
        self._on_newcomer = on_newcomer
        self._changing, self._sending = threading.RLock(), threading.Lock()
        self._peers: dict[int, Peer] = {}
        self._strangers: set[int] = set()
        self._dismissed: dict[int, int] = {}
        self._looked = 0.0
        self._n_known = 0
        self._count = 0
        self._poll = select.poll()
        with warnings.catch_warnings():
            # rospy warns of a publisher that has no queue.
            warnings.simplefilter("ignore", SyntaxWarning)
            self._publisher = rospy.Publisher(name, kind, subscriber_listener=self)
        # rospy takes up subscribers before it takes up the listener.
        self._look_who_is_there()
        self._turn_away(self._strangers)

    def get_num_connections(self) -> int:
        """Count the subscribers."""
        return self._publisher.get_num_connections()

    def publish(self, message) -> None:
        """Send a message to all subscribers that have room, keep it for the others."""
        self._look_again()
        if self._peers or self._latch:
            with self._sending:
                if self._latch:
                    self._newest = message
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

    def forget(self) -> None:
        """Send a subscriber that comes nothing until there is something new."""
        with self._sending:
            self._newest = None

    def flush(self) -> None:
        """Send what is kept to those who have room by now."""
        self._look_again()
        if any(peer.waiting for peer in self._peers.values()):
            with self._sending:
                ready = self._ready()
                for peer in self._peers.values():
                    if peer.descriptor in ready:
                        self._send_waiting(peer)

    def wait_for_room(self, patience: float) -> None:
        """Wait until nothing is kept for any subscriber.

        Args:
            patience: How long one may take nothing, in [s]. It is not waited for
                again until it does.
        """
        end = time.monotonic() + patience
        while True:
            self.flush()
            behind = [
                peer
                for peer in self._peers.values()
                if peer.waiting and not (peer.is_own or peer.is_stuck)
            ]
            if not behind:
                return
            room = select.poll()
            for peer in behind:
                room.register(peer.descriptor, select.POLLOUT)
            if room.poll(10):
                end = time.monotonic() + patience
            elif time.monotonic() > end:
                for peer in behind:
                    peer.is_stuck = True

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
            peer.is_stuck = False

    def peer_subscribe(self, topic_name, topic_publish, peer_publish) -> None:
        """Take up a subscriber; rospy calls this in the thread of its handshake."""
        descriptor = getattr(HANDSHAKE, "descriptor", None)
        with self._changing:
            self._look_who_is_there()
            # Without threads of their own, handshakes come one after the other.
            fitting = [
                number
                for number in sorted(self._strangers)
                if descriptor in (None, self._connections[number][0])
            ]
            if fitting:
                self._strangers.remove(fitting[-1])
                with contextlib.suppress(OSError):  # it is gone again
                    self._take_up(fitting[-1], peer_publish)
        self._on_newcomer()

    def peer_unsubscribe(self, topic_name, num_peers) -> None:
        """Look who left, the next time; rospy calls this and does not say who."""
        self._looked = 0.0

    def _look_again(self) -> None:
        """Forget who left, and turn away who has not been taken up for a while."""
        if self._publisher.get_num_connections() == self._n_known:
            return
        now = time.monotonic()
        if now - self._looked < LOOK:
            return
        if self._changing.acquire(blocking=False):
            try:
                self._looked = now
                before = self._strangers
                self._look_who_is_there()
                self._turn_away(before & self._strangers)
            finally:
                self._changing.release()

    def _look_who_is_there(self) -> None:
        """Compare the subscribers with the node's connections."""
        try:
            self._connections = self._ask()
        except FAILURES as error:
            if not rospy.core.is_shutdown_requested():
                rospy.logwarn_once("This node cannot reach itself: %s", error)
            return
        here = set(self._connections)
        for number in set(self._peers) - here:
            with contextlib.suppress(KeyError):
                self._poll.unregister(self._peers[number].descriptor)
        self._peers = {n: peer for n, peer in self._peers.items() if n in here}
        self._dismissed = {n: k for n, k in self._dismissed.items() if n in here}
        self._strangers = here - set(self._peers) - set(self._dismissed)
        self._count_the_known()

    def _count_the_known(self) -> None:
        """Count the connections that nothing is to be done about."""
        given_up = list(self._dismissed.values()).count(0)
        self._n_known = len(self._peers) + given_up

    def _take_up(self, number: int, send) -> None:
        """Make a connection one of the subscribers."""
        descriptor, is_own = self._connections[number]
        with _borrowed(descriptor) as sock:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, STALLED)
        self._poll.register(descriptor, select.POLLOUT)
        waiting = deque(maxlen=1 if is_own else self._queue_size)
        peer = Peer(send, descriptor, waiting, is_own)
        with self._sending:
            if self._newest is not None:
                send(self._newest)
            self._peers = {**self._peers, number: peer}
        self._count_the_known()

    def _turn_away(self, strangers: set[int]) -> None:
        """Let connections go, and let the master call their nodes again.

        A node that has not noticed yet does not listen to the master, so it is called
        several times.
        """
        for number in strangers:
            descriptor, _ = self._connections[number]
            with contextlib.suppress(OSError), _borrowed(descriptor) as sock:
                sock.shutdown(socket.SHUT_RDWR)
            self._dismissed[number] = CALLS
        if any(self._dismissed.values()):
            self._dismissed = {n: max(0, k - 1) for n, k in self._dismissed.items()}
            self._count_the_known()
            # A master that is far and gone may keep who asks it for a minute.
            threading.Thread(target=self._call, daemon=True).start()

    def _call(self) -> None:
        """Let the master tell all subscribers of this publisher."""
        with contextlib.suppress(*FAILURES, rosgraph.MasterException):
            rosgraph.Master(rospy.get_name()).registerPublisher(
                self.name, self._publisher.type, rospy.get_node_uri()
            )

    def _ask(self) -> dict[int, tuple[int, bool]]:
        """Ask the node for the topic's connections.

        Returns:
            By their numbers, their sockets and whether they are the node's own.
        """
        own = rospy.get_name()
        with own_node() as node:
            rows = node.getBusInfo(own)[2]
        found = (
            (row[0], _SOCKET.search(row[_INFO]), row[_OTHER] == own)
            for row in rows
            if row[_TOPIC] == self.name and row[_DIRECTION] == "o"
        )
        return {n: (int(match.group(1)), is_own) for n, match, is_own in found if match}


@contextlib.contextmanager
def _borrowed(descriptor: int):
    """Give a socket by its number; it stays open, and as blocking as it was."""
    blocking = os.get_blocking(descriptor)
    with socket.socket(fileno=os.dup(descriptor)) as sock:
        # With a default timeout, which rospy sets, Python has unblocked it.
        os.set_blocking(descriptor, blocking)
        yield sock
