"""The newest state of a robot: joints and base of one time.

A bridge publishes both in one message, ``robot_state``. Without a bridge, as with a bag
or a real robot, they are joined from ``joint_states`` and TF.
"""

from __future__ import annotations

import io
import posixpath
import struct
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace

import genpy
import numpy as np
import rospy
import tf2_ros
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

from g1_description.msg import RobotState as RobotStateMessage
from g1_description.robot.state import RobotState
from g1_description.robot.transform import IDENTITY
from g1_description.ros.conversions import (
    joint_states_to_arrays,
    robot_state_from_message,
    stamp_from_ns,
    vector_to_array,
)
from g1_description.ros.log import ThrottledLog
from g1_description.ros.waiting import BUFFER

PAUSE = 5e-4
"""Time between two messages, in [s], above which they are separate batches."""

_ends = threading.local()
"""Per thread of a connection: end of the last callback. Subscribers to one topic share
the connection, which then pauses only once."""


def gathered(act: Callable, period: float) -> Callable:
    """Read messages in batches.

    Waking up for a message costs more than handling it. So after a message that was
    waited for the connection pauses; the system buffers messages meanwhile.

    Args:
        act: The callback.
        period: Duration of a pause, in [s].

    Returns:
        A callback that calls ``act`` and then pauses.
    """

    def take(message) -> None:
        waited = time.monotonic() - getattr(_ends, "last", 0.0)
        act(message)
        if waited > PAUSE:
            time.sleep(period)
        _ends.last = time.monotonic()

    return take


MAX_STATES = 300
"""Joint states that are kept until the base of their time is known: 0.3 s at 1 kHz."""

MAX_BASE_AGE = 1_000_000_000
"""Age of a base relative to the joints above which it is unknown, in [ns]."""

RESET = 100_000_000
"""Step back of time above which it is a reset, in [ns]."""

_STAMP = struct.Struct("<II")
_STAMP_AT = 4
"""Offset of the stamp in a message with a header, in bytes."""


class RobotStates:
    """The newest state of one robot, from its bridge if there is one.

    Subscribes: robot_state (g1_description/RobotState); without a publisher, the topics
        of ``JoinedStates``.
    """

    def __init__(
        self,
        map_frame: str,
        base_frame: str,
        period: float,
        log: ThrottledLog,
        joint_states: str = "joint_states",
        changed: threading.Event | None = None,
    ) -> None:
        """Subscribe.

        Args:
            map_frame: Frame of the floor.
            base_frame: Frame of the robot's base; the map if that is the world.
            period: Longest delay before messages are read, in [s].
            log: Where to log malformed messages.
            joint_states: Topic of the joint states; ``robot_state`` is in the same
                namespace.
            changed: Event to set when a state has arrived; by default a new one.
        """
        self.changed = changed or threading.Event()
        """Set when a state has arrived; cleared by the reader."""
        self.began_again = threading.Event()
        """Set when time went back; cleared by the reader."""
        self._map, self._base_frame, self._log = map_frame, base_frame, log
        self._lock = threading.Lock()
        self._newest: bytes | None = None
        self._stamp = 0
        self._join = lambda: JoinedStates(
            map_frame,
            base_frame,
            period,
            log,
            joint_states,
            self.changed,
            self.began_again,
        )
        # In the namespace of joint_states, also if those are remapped.
        namespace = posixpath.dirname(rospy.resolve_name(joint_states))
        self._subscriber = _subscribe(
            posixpath.join(namespace, "robot_state"),
            _RobotStateBytes,
            gathered(self._on_robot_state, period),
            1,
        )
        self._joined: JoinedStates | None = self._join()

    def close(self) -> None:
        """Unsubscribe."""
        self._subscriber.unregister()
        joined = self._joined
        if joined is not None:
            joined.close()

    @property
    def is_published(self) -> bool:
        """Whether the robot's state has a publisher."""
        joined = self._joined
        return bool(
            self._subscriber.get_num_connections()
            or (joined is not None and joined.is_published)
        )

    @property
    def stamp(self) -> int:
        """Time of the newest state, in [ns]; 0 before the first."""
        joined = self._joined
        return self._stamp if joined is None else joined.stamp

    def _on_robot_state(self, data: bytes) -> None:
        """Keep a message."""
        if len(data) < _STAMP_AT + _STAMP.size:
            return
        stamp = _nanoseconds(data, _STAMP_AT)
        with self._lock:
            if stamp < self._stamp - RESET:
                self.began_again.set()
            self._newest, self._stamp = data, stamp
        self.changed.set()

    def newest(self) -> RobotState | None:
        """Return the newest state; None if it was returned before.

        To be called several times a second, also when nothing has changed, and by one
        thread at a time.

        Raises:
            InvalidValueError: If the lengths of its fields differ.
        """
        with self._lock:
            data, self._newest = self._newest, None
        state = None if data is None else self._read(data)
        joined = self._joined
        if state is not None:
            self._joined = None
            if joined is not None:
                joined.close()
            return state
        if joined is None and not self._subscriber.get_num_connections():
            joined = self._joined = self._join()
        return None if joined is None else joined.newest()

    def _read(self, data: bytes) -> RobotState | None:
        """Read a message; None if it is damaged or its poses are in another frame."""
        message = RobotStateMessage()
        try:
            message.deserialize(data)
        except genpy.DeserializationError as error:
            self._log.warn("state", f"Malformed message on robot_state: {error}.")
            return None
        if message.header.frame_id != self._map:
            return None
        state = robot_state_from_message(message)
        is_world = self._base_frame == self._map
        return replace(state, base_pose=IDENTITY) if is_world else state

    @property
    def no_base(self) -> str:
        """Why a state has no base."""
        return (
            f"neither robot_state nor TF has the pose of {self._base_frame} in "
            f"{self._map}"
        )


class JoinedStates:
    """States joined from joint states and TF between the map and the robot.

    For a bag or a real robot. Only joint states that are read are decoded.

    Subscribes: joint_states (sensor_msgs/JointState), /tf, /tf_static
        (tf2_msgs/TFMessage)
    """

    def __init__(
        self,
        map_frame: str,
        base_frame: str,
        period: float,
        log: ThrottledLog,
        joint_states: str,
        changed: threading.Event,
        began_again: threading.Event,
    ) -> None:
        """Subscribe; the arguments are those of ``RobotStates``."""
        self._changed, self._began_again = changed, began_again
        self._map, self._base_frame, self._log = map_frame, base_frame, log
        self._lock = threading.Lock()
        self._states: deque[tuple[int, bytes]] = deque(maxlen=MAX_STATES)
        """Stamps in [ns] and messages."""
        self._taken: tuple[object, bool] | None = None
        """The last returned one, and whether it had a base."""
        self._parents: dict[str, str] = {}
        self._newest: dict[str, int] = {}
        self._times: deque[int] = deque(maxlen=MAX_STATES)
        self._tf = tf2_ros.Buffer(debug=False)
        self._joint_states = _subscribe(
            joint_states,
            _JointStateBytes,
            gathered(self._on_joint_states, period),
            100,
        )
        self._subscribers = [
            self._joint_states,
            rospy.Subscriber(
                "/tf",
                TFMessage,
                gathered(self._on_tf, period),
                queue_size=100,
                buff_size=BUFFER,
            ),
            rospy.Subscriber("/tf_static", TFMessage, self._on_static_tf),
        ]

    def close(self) -> None:
        """Unsubscribe."""
        for subscriber in self._subscribers:
            subscriber.unregister()

    @property
    def is_published(self) -> bool:
        """Whether joint_states has a publisher."""
        return self._joint_states.get_num_connections() > 0

    def _on_joint_states(self, data: bytes) -> None:
        """Keep joint states."""
        if len(data) < _STAMP_AT + _STAMP.size:
            return
        stamp = _nanoseconds(data, _STAMP_AT)
        with self._lock:
            self._states.append((stamp, data))
        self._changed.set()

    def _begin_again(self) -> None:
        """Forget all but static transforms: time went back."""
        self._states.clear()
        self._tf.clear()
        self._newest.clear()
        self._times.clear()
        self._taken = None
        self._began_again.set()

    def _on_tf(self, message: TFMessage) -> None:
        """Keep transforms between the map and the robot."""
        with self._lock:
            self._learn_parents(message)
            above = self._above()
            edges = [e for e in message.transforms if e.child_frame_id in above]
            for edge in edges:
                stamp = edge.header.stamp.to_nsec()
                if stamp < self._newest.get(edge.child_frame_id, 0) - RESET:
                    self._begin_again()
                self._newest[edge.child_frame_id] = stamp
                self._times.append(stamp)
                self._tf.set_transform(edge, "tf")
        if edges:
            self._changed.set()

    def _on_static_tf(self, message: TFMessage) -> None:
        """Keep static transforms."""
        with self._lock:
            self._learn_parents(message)
            for edge in message.transforms:
                self._tf.set_transform_static(edge, "tf")
        self._changed.set()

    def _learn_parents(self, message: TFMessage) -> None:
        """Record the parents of frames."""
        for edge in message.transforms:
            self._parents[edge.child_frame_id] = edge.header.frame_id

    def _above(self) -> list[str]:
        """List the frames from the robot's base up to below the map."""
        names = [self._base_frame]
        while self._parents.get(names[-1]) not in (None, self._map, *names):
            names.append(self._parents[names[-1]])
        return names

    @property
    def stamp(self) -> int:
        """Time of the newest joint states, in [ns]; 0 before the first ones."""
        with self._lock:
            return self._states[-1][0] if self._states else 0

    def newest(self) -> RobotState | None:
        """Find the newest joint states whose base is known, too.

        Returns:
            The state, without a base if TF has none; None if it was returned before.

        Raises:
            InvalidValueError: If the lengths of the fields differ, or a name is
                repeated.
        """
        with self._lock:
            found = self._pair()
            if found is None:
                return None
            chosen, base = found
            last = self._taken
            if last and last[0] is chosen and last[1] == (base is not None):
                return None
            self._taken = chosen, base is not None
        stamp, data = chosen
        message = JointState()
        try:
            message.deserialize(data)
        except genpy.DeserializationError as error:
            self._log.warn("joints", f"Malformed message on joint_states: {error}.")
            return None
        if len(message.velocity) != len(message.name):
            message.velocity = []  # positions alone will do
        return RobotState(stamp, *joint_states_to_arrays(message), base)

    def _pair(self) -> tuple[tuple[int, bytes], np.ndarray | None] | None:
        """Choose joint states, and look up their base."""
        if not self._states:
            return None
        newest = self._states[-1]
        try:
            time = self._tf.get_latest_common_time(
                self._map, self._base_frame
            ).to_nsec()
            if time == 0:  # all transforms are static
                return newest, self._base(0)
            if newest[0] - time > MAX_BASE_AGE:
                return newest, None
            chosen = self._chosen(time)
            return chosen and (chosen, self._base(chosen[0]))
        except tf2_ros.TransformException:
            return newest, None

    def _chosen(self, time: int) -> tuple[int, bytes] | None:
        """Choose the newest joint states up to a time in [ns].

        Those with the stamp of a base are preferred: TF would interpolate between two
        bases, where a robot that jumps has never been.
        """
        times, newest = set(self._times), None
        for state in reversed(self._states):
            if state[0] <= time:
                newest = newest or state
                if state[0] in times:
                    return state
        return newest

    def _base(self, stamp: int) -> np.ndarray:
        """Look the base up, shape (7,)."""
        found = self._tf.lookup_transform_core(
            self._map, self._base_frame, stamp_from_ns(stamp)
        ).transform
        q = found.rotation
        turn = np.array([q.x, q.y, q.z, q.w])
        return np.concatenate([vector_to_array(found.translation), turn])


def _kept_as_bytes(kind: type) -> type:
    """Make a class of messages that are deserialized when a field is read.

    rospy gives all subscribers of a topic in a process messages of the first one's
    class, so these have to do for a program's own subscribers, too.
    """

    class Kept(kind):
        __slots__ = ("data",)

        def __init__(self):
            """Leave the fields unset."""

        def deserialize(self, data):
            self.data = data
            return self

        def __getattr__(self, name):
            if name not in kind.__slots__:
                raise AttributeError(name)
            kind.__init__(self)
            kind.deserialize(self, self.data)
            return getattr(self, name)

    return Kept


_JointStateBytes = _kept_as_bytes(JointState)
_RobotStateBytes = _kept_as_bytes(RobotStateMessage)


def _subscribe(
    topic: str, kind: type, act: Callable[[bytes], None], queue_size: int
) -> rospy.Subscriber:
    """Subscribe to the bytes of a topic."""

    def on_message(message):
        if isinstance(message, kind):
            act(message.data)
        else:  # the program subscribed first
            buffer = io.BytesIO()
            message.serialize(buffer)
            act(buffer.getvalue())

    return rospy.Subscriber(
        topic,
        kind,
        on_message,
        queue_size=queue_size,
        buff_size=BUFFER,
        tcp_nodelay=True,
    )


def _nanoseconds(data: bytes, place: int) -> int:
    """Unpack a time in [ns]."""
    seconds, nanoseconds = _STAMP.unpack_from(data, place)
    return seconds * 1_000_000_000 + nanoseconds
