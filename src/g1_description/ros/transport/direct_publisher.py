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

import select
import time
from collections.abc import Callable

import rospy

from .subscribers import Peer, Subscribers

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
