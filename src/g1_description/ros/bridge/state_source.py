"""Where the bridge has its states from, and the time of each."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable

import rosgraph
import rospy

from g1_description.core.errors import WireFormatError
from g1_description.ros.node.complaints import Complaints
from g1_description.ros.node.own_node import FAILURES
from g1_description.ros.wire.link_states import LinkStatesArrays, LinkStatesDecoder

from .backlog import Backlog

QUEUE = 100
"""Messages that may come at once; of more that have no stamps the newest count."""

BUFFER = 1 << 16
"""Bytes read at once: a dozen messages of a humanoid."""

KEPT = 0.1
"""The newest of the states that are kept for a later stamp is taken after this, in [s]
of wall time, if no such stamp comes."""


class StateSource:
    """A simulator's world_state where it has one, else its link_states.

    Each message of world_state has a stamp and is taken. A message of link_states is
    given the newest time of /clock; of those that come under one time, or sooner than
    ``max_rate`` allows, the first is taken, and the newest kept for a later time.
    Those that piled up while the bridge was held up are passed over: nobody can tell
    when they were true.

    Subscribes: <gazebo>/world_state (gazebo_msgs/WorldState), <gazebo>/link_states
        (gazebo_msgs/LinkStates)
    """

    def __init__(
        self,
        gazebo: str,
        max_rate: float,
        take: Callable[[int, LinkStatesArrays], None],
        complaints: Complaints,
    ) -> None:
        """Prepare; nothing comes before ``start``.

        Args:
            gazebo: Namespace of the simulator.
            max_rate: States without stamps taken per second of /clock; 0: all.
            take: Takes a state's time in [ns] and the state, one at a time.
            complaints: Where to tell what cannot be read.
        """
        self._unstamped_topic = rospy.resolve_name(f"{gazebo}/link_states")
        self._stamped_topic = rospy.resolve_name(f"{gazebo}/world_state")
        self._take = take
        self._complaints = complaints
        self._decoder = LinkStatesDecoder()
        # rospy has a thread for each publisher; there may be several.
        self._one_at_a_time = threading.RLock()
        self._min_interval = 1e9 / max_rate if max_rate else 1.0
        self._stamp = 0
        self._backlog = Backlog(QUEUE)
        self._kept: tuple[bytes, float] | None = None
        self._has_stamps: dict[str, bool] = {}
        self._stamped: rospy.Subscriber | None = None
        self._unstamped: rospy.Subscriber | None = None
        self.last_came: float | None = None
        """When the last good message came, on the monotonic clock."""
        self.timeless = 0
        """Messages of link_states that came before any time on /clock."""
        self.malformed = 0
        """Messages that could not be read."""

    def start(self) -> None:
        """Subscribe."""
        # Without simulated time all nodes go by the wall, and no state tells that.
        if not rospy.rostime.is_wallclock():
            self._stamped = self._subscribe(self._stamped_topic, self._on_stamped, None)
        self._unstamped = self._listen_to_unstamped()

    def _listen_to_unstamped(self) -> rospy.Subscriber:
        """Subscribe to link_states."""
        return self._subscribe(self._unstamped_topic, self._on_unstamped, QUEUE)

    @staticmethod
    def _subscribe(
        topic: str, callback: Callable, queue_size: int | None
    ) -> rospy.Subscriber:
        """Subscribe to the bytes of a topic; without a queue size all are wanted."""
        return rospy.Subscriber(
            topic,
            rospy.AnyMsg,
            callback,
            queue_size=queue_size,
            buff_size=BUFFER,
            tcp_nodelay=True,
        )

    @property
    def topic(self) -> str:
        """The topic that states come on, or are waited for."""
        has_stamps = any(self._has_stamps.values())
        return self._stamped_topic if has_stamps else self._unstamped_topic

    @property
    def is_connected(self) -> bool:
        """Whether there is a simulator."""
        return any(
            subscriber and subscriber.get_num_connections()
            for subscriber in (self._stamped, self._unstamped)
        )

    @property
    def passed_over(self) -> int:
        """Messages that were passed over because newer ones had come."""
        return self._backlog.passed_over

    @property
    def age(self) -> float | None:
        """How old the last good message is in [s]; None before the first."""
        came = self.last_came
        return None if came is None else time.monotonic() - came

    @property
    def lock(self) -> threading.RLock:
        """What is held while a state is taken."""
        return self._one_at_a_time

    def _on_stamped(self, message: rospy.AnyMsg) -> None:
        """Take a message of world_state."""
        with self._one_at_a_time:
            self._has_stamps[_sender_of(message)] = True
            self._decode(message._buff, None)

    def _on_unstamped(self, message: rospy.AnyMsg) -> None:
        """Take a message of link_states, or keep it for later."""
        if self._comes_with_stamps(message):
            return
        with self._one_at_a_time:
            stamp = rospy.Time.now().to_nsec()
            if not stamp:  # simulated time has not come yet, and is not invented
                self.timeless += 1
            elif self._backlog.is_old() or (
                0 <= stamp - self._stamp < self._min_interval
            ):
                since = self._kept[1] if self._kept else time.monotonic()
                self._kept = message._buff, since
            else:
                self._decode(message._buff, stamp)
            self._backlog.end()

    def _comes_with_stamps(self, message: rospy.AnyMsg) -> bool:
        """Tell whether the node that sent this sends world_state, too."""
        node = _sender_of(message)
        if self._stamped and node not in self._has_stamps:
            with contextlib.suppress(*FAILURES, rosgraph.MasterException):
                publishers, _, _ = rosgraph.Master(rospy.get_name()).getSystemState()
                found = node in dict(publishers).get(self._stamped_topic, ())
                self._has_stamps[node] = found
        return self._has_stamps.get(node, False)

    def _decode(self, data: bytes, stamp: int | None) -> None:
        """Read a message and hand it on; without a stamp it has its own."""
        try:
            if stamp is None:
                stamp, states = self._decoder.decode_stamped(data)
            else:
                states = self._decoder.decode(data)
        except WireFormatError as error:
            self.malformed += 1
            self._complaints.tell(
                "malformed", f"A message of the simulator cannot be read: {error}"
            )
            return
        self._kept, self._stamp = None, stamp
        self.last_came = time.monotonic()
        self._take(stamp, states)

    def look_after(self) -> None:
        """Take what was kept, and hear link_states just where it is needed."""
        with self._one_at_a_time:
            if self._kept:
                (data, since), now = self._kept, rospy.Time.now().to_nsec()
                is_due = now - self._stamp >= self._min_interval
                if now < self._stamp:  # it is of the time before a reset
                    self._kept = None
                elif is_due or time.monotonic() - since > KEPT:
                    self._decode(data, now)
        if not self._stamped:
            return
        is_needed = not self._stamped.get_num_connections()
        if is_needed and not self._unstamped:
            self._has_stamps.clear()
            self._unstamped = self._listen_to_unstamped()
        elif self._unstamped and not is_needed and any(self._has_stamps.values()):
            self._unstamped.unregister()
            self._unstamped = None


def _sender_of(message: rospy.AnyMsg) -> str:
    """Tell which node sent a message."""
    return message._connection_header.get("callerid", "")
