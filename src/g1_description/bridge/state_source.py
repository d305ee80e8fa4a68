"""The states of a simulator, and the time of each."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from typing import Callable, Mapping

import rosgraph
import rospy

from g1_description.errors import WireFormatError
from g1_description.ros.log import ThrottledLog
from g1_description.ros.waiting import SLAVE_API_ERRORS
from g1_description.ros.wire import LinkStatesArrays, LinkStatesDecoder, MotorArrays

MAX_IN_A_ROW = 100
"""Messages without stamps that may arrive at once; of more, only the newest is used."""

BUFFER_SIZE = 1 << 16
"""Bytes read at once: a dozen messages of a humanoid."""

MAX_KEEP_TIME = 0.1
"""Longest wait in [s] of wall time of a kept state for a later time on /clock."""

BACKLOG_DECAY = 0.005
"""Time constant in [s] with which the count of messages in a row decays. rospy delivers
messages in batches a millisecond apart, so one pause does not end a backlog."""

OnStates = Callable[[int, LinkStatesArrays, Mapping[str, MotorArrays]], None]


class StateSource:
    """Subscribes to simulator_state, or to link_states where there is none.

    Each message of simulator_state has a stamp and is used. A message of link_states
    gets the newest time of /clock; of several with the same time, or sooner than
    ``max_rate`` allows, the first is used, and the newest is kept for a later time.
    A backlog, after the bridge was suspended, is skipped, as its times are unknown.

    Subscribes: <gazebo>/simulator_state (g1_description/SimulatorState),
        <gazebo>/link_states (gazebo_msgs/LinkStates)
    """

    def __init__(
        self,
        gazebo: str,
        max_rate: float,
        on_states: OnStates,
        log: ThrottledLog,
    ) -> None:
        """Prepare; nothing is received before ``start``.

        Args:
            gazebo: Namespace of the simulator.
            max_rate: States without stamps used per second of /clock; 0: all.
            on_states: Called with the time of a state in [ns], its links, and its
                motors by model, from one thread at a time.
            log: Where to log malformed messages.
        """
        self._unstamped_topic = rospy.resolve_name(f"{gazebo}/link_states")
        self._stamped_topic = rospy.resolve_name(f"{gazebo}/simulator_state")
        self._on_states = on_states
        self._log = log
        self._decoder = LinkStatesDecoder()
        # rospy has a thread for each publisher; there may be several.
        self.lock = threading.RLock()
        """Held while a state is handled."""
        self._min_interval = 1e9 / max_rate if max_rate else 1.0
        self._stamp = 0
        self._in_a_row, self._handled = 0.0, 0.0
        """Messages without a pause, and when the last had been handled: monotonic."""
        self.skipped = 0
        """Number of messages that were skipped because newer ones had arrived."""
        self._kept: tuple[bytes, float] | None = None
        self._has_stamps: dict[str, bool] = {}
        self._stamped: rospy.Subscriber | None = None
        self._unstamped: rospy.Subscriber | None = None
        self._last_message: float | None = None
        self.timeless = 0
        """Number of messages of link_states before any time on /clock."""
        self.malformed = 0
        """Number of messages that could not be read."""

    def start(self) -> None:
        """Subscribe."""
        # Without simulated time all nodes use wall time, which no state has.
        if not rospy.rostime.is_wallclock():
            self._stamped = self._subscribe(self._stamped_topic, self._on_stamped, None)
        self._unstamped = self._subscribe(self._unstamped_topic, self._on_unstamped)

    @staticmethod
    def _subscribe(
        topic: str, callback: Callable, queue_size: int | None = MAX_IN_A_ROW
    ) -> rospy.Subscriber:
        """Subscribe to the bytes of a topic; without a queue size none is dropped."""
        return rospy.Subscriber(
            topic,
            rospy.AnyMsg,
            callback,
            queue_size=queue_size,
            buff_size=BUFFER_SIZE,
            tcp_nodelay=True,
        )

    @property
    def topic(self) -> str:
        """Name of the topic in use."""
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
    def age(self) -> float | None:
        """Age of the last good message in [s]; None before the first."""
        last = self._last_message
        return None if last is None else time.monotonic() - last

    def _on_stamped(self, message: rospy.AnyMsg) -> None:
        """Use a message of simulator_state."""
        with self.lock:
            self._has_stamps[message._connection_header.get("callerid", "")] = True
            self._decode(message._buff, None)

    def _on_unstamped(self, message: rospy.AnyMsg) -> None:
        """Use a message of link_states, or keep it for a later time."""
        node = message._connection_header.get("callerid", "")
        has_stamps = self._has_stamps.get(node)
        if has_stamps is None and self._stamped:
            has_stamps = self._publishes_stamps(node)
        if has_stamps:
            return
        with self.lock:
            stamp = rospy.Time.now().to_nsec()
            if not stamp:  # no simulated time yet
                self.timeless += 1
            elif self._is_old() or 0 <= stamp - self._stamp < self._min_interval:
                since = self._kept[1] if self._kept else time.monotonic()
                self._kept = message._buff, since
            else:
                self._decode(message._buff, stamp)
            self._handled = time.monotonic()

    def _is_old(self) -> bool:
        """Whether the message that has just arrived is part of a backlog.

        A node that was suspended finds seconds of messages in the socket's buffer. One
        by one, old states would look new, and the backlog might never shrink.
        """
        waited = time.monotonic() - self._handled
        self._in_a_row = 1.0 + self._in_a_row * math.exp(-waited / BACKLOG_DECAY)
        is_old = self._in_a_row > MAX_IN_A_ROW
        self.skipped += is_old
        return is_old

    def _publishes_stamps(self, node: str) -> bool:
        """Ask the master once whether a node publishes simulator_state, too."""
        with contextlib.suppress(*SLAVE_API_ERRORS, rosgraph.MasterException):
            publishers, _, _ = rosgraph.Master(rospy.get_name()).getSystemState()
            self._has_stamps[node] = node in dict(publishers).get(
                self._stamped_topic, ()
            )
        return self._has_stamps.get(node, False)

    def _decode(self, data: bytes, stamp: int | None) -> None:
        """Decode a message and pass it on; without a stamp it contains one."""
        try:
            if stamp is None:
                stamp, states, motors = self._decoder.decode_stamped(data)
            else:
                states, motors = self._decoder.decode(data), {}
        except WireFormatError as error:
            self.malformed += 1
            self._log.warn(
                "malformed", f"Cannot decode a message of the simulator: {error}"
            )
            return
        self._kept, self._stamp = None, stamp
        self._last_message = time.monotonic()
        self._on_states(stamp, states, motors)

    def keep_up(self) -> None:
        """Use a kept state, and subscribe to link_states if they are needed.

        To be called every few hundredths of a second.
        """
        with self.lock:
            if self._kept:
                (data, since), now = self._kept, rospy.Time.now().to_nsec()
                is_due = now - self._stamp >= self._min_interval
                if now < self._stamp:  # it is from before a reset
                    self._kept = None
                elif is_due or time.monotonic() - since > MAX_KEEP_TIME:
                    self._decode(data, now)
        if not self._stamped:
            return
        is_needed = not self._stamped.get_num_connections()
        if is_needed and not self._unstamped:
            self._has_stamps.clear()
            self._unstamped = self._subscribe(self._unstamped_topic, self._on_unstamped)
        elif self._unstamped and not is_needed and any(self._has_stamps.values()):
            self._unstamped.unregister()
            self._unstamped = None


MAX_STEP_BACK = 100_000
"""A stamp less than this far behind the last one, in [ns], is of the same instant.
A reset goes back by at least a time step, which is longer."""

MAX_CLOCK_LAG = 100_000_000
"""A clock further behind the last state, in [ns], was reset; the bridge may have the
state sooner than the clock."""

MAX_CLOCK_LEAD = 10 * MAX_CLOCK_LAG
"""After a reset, a state further ahead of the clock, in [ns], is from before it."""


class RisingStamps:
    """Gives each state a stamp of its own.

    TF keeps one transform per stamp and frame and refuses a second one. While time
    stands still there may be several states of one instant: their stamps are a
    nanosecond apart.
    """

    def __init__(self) -> None:
        self.last = 0
        """The last stamp in [ns]; 0 before the first."""
        self._now = 0
        self._was_reset = False

    def next(self, stamp: int, now: int) -> tuple[int, bool] | None:
        """Compute the stamp to publish a state under.

        Args:
            stamp: The state's time in [ns]. Zero, which means no time in ROS, becomes
                a nanosecond.
            now: Time on the clock in [ns].

        Returns:
            The stamp in [ns], and whether time went back. None for a state from before
            a reset that arrives after it: listeners must not have it.
        """
        self._was_reset |= now < self._now - MAX_CLOCK_LAG
        self._now = now
        if self._was_reset and stamp > now + MAX_CLOCK_LEAD:
            return None
        self._was_reset = False
        stamp = max(stamp, 1)
        went_back = stamp <= self.last - MAX_STEP_BACK
        if not went_back:
            stamp = max(stamp, self.last + 1)
        self.last = stamp
        return stamp, went_back

    def is_ahead_of(self, now: int) -> bool:
        """Whether a clock in [ns] was reset since the last stamp."""
        return now < self.last - MAX_CLOCK_LAG

    def again(self) -> int:
        """Compute the stamp to publish the last state under once more, in [ns]."""
        self.last += 1
        return self.last
