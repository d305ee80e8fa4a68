"""The bytes of messages that motions are made of, as rosbags have them.

Read without message classes: a bag brings definitions of its own, which ROS would
compile and run.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np

from g1_description.core.errors import WireFormatError

_COUNT = struct.Struct("<I")
_HEADER = struct.Struct("<III")
_DURATION = struct.Struct("<ii")
_POSE = 7
MAX_NAMES = 10_000
"""Most joints that a message names."""

_TWIST = 6


class JointSample(NamedTuple):
    """What a JointState says."""

    stamp: int
    """In [ns]; 0: none is given."""

    names: tuple[str, ...]
    positions: np.ndarray
    """In [rad] or [m], shape (n_joints,), or any other if the message is wrong."""

    velocities: np.ndarray
    """In [rad/s] or [m/s], likewise; mostly, or not at all."""


class Edge(NamedTuple):
    """A transform, or where an odometry is."""

    stamp: int
    """In [ns]; 0: none is given."""

    parent: str
    child: str
    pose: np.ndarray
    """T_parent_child, shape (7,)."""


class Points(NamedTuple):
    """A trajectory of joints, or of the base."""

    names: tuple[str, ...]
    frame: str
    times: list[float]
    """Since the start, in [s]."""

    positions: list[np.ndarray]
    """Of the joints, or the poses of the base, a row per time."""

    velocities: list[np.ndarray]


class MessageReader:
    """Reads one message after the other; names are only read when they change."""

    def __init__(self) -> None:
        """Begin without a message."""
        self._data, self._offset = b"", 0
        self._known: tuple[bytes, tuple[str, ...]] = b"", ()
        """The last list of names, and its bytes."""

    def start(self, data: bytes) -> None:
        """Go to the beginning of a message."""
        self._data, self._offset = data, 0

    def _take(self, size: int) -> int:
        """Go on by some bytes; return where they begin."""
        begin = self._offset
        if size > len(self._data) - begin:
            raise WireFormatError(f"The message ends after {len(self._data)} bytes.")
        self._offset = begin + size
        return begin

    def count(self) -> int:
        """Read a uint32."""
        return _COUNT.unpack_from(self._data, self._take(_COUNT.size))[0]

    def text(self) -> str:
        """Read a string."""
        size = self.count()
        begin = self._take(size)
        return self._data[begin : begin + size].decode("utf-8", "replace")

    def names(self) -> tuple[str, ...]:
        """Read a list of names."""
        data, names = self._known
        if data and self._data.startswith(data, self._offset):
            self._offset += len(data)
            return names
        begin, count = self._offset, self.count()
        if count > MAX_NAMES:
            raise WireFormatError(f"The message names {count} joints.")
        names = tuple([self.text() for _ in range(count)])
        self._known = self._data[begin : self._offset], names
        return names

    def header(self) -> tuple[int, str]:
        """Read a header: stamp in [ns] and frame."""
        _, seconds, rest = _HEADER.unpack_from(self._data, self._take(_HEADER.size))
        return seconds * 1_000_000_000 + rest, self.text()

    def duration(self) -> float:
        """Read a duration in [s]."""
        seconds, rest = _DURATION.unpack_from(self._data, self._take(_DURATION.size))
        return (seconds * 1_000_000_000 + rest) / 1e9

    def numbers(self, count: int) -> np.ndarray:
        """Read float64s."""
        return np.frombuffer(self._data, "<f8", count, self._take(8 * count))

    def array(self, width: int = 1) -> np.ndarray:
        """Read a list of rows of float64s, as one row."""
        return self.numbers(width * self.count())


def read_joint_state(reader: MessageReader) -> list[JointSample]:
    """Read a sensor_msgs/JointState.

    Raises:
        WireFormatError: If it is no whole message; likewise the others here.
    """
    stamp, _ = reader.header()
    return [JointSample(stamp, reader.names(), reader.array(), reader.array())]


def read_transforms(reader: MessageReader) -> list[Edge]:
    """Read a tf2_msgs/TFMessage."""
    return [
        Edge(*reader.header(), reader.text(), reader.numbers(_POSE))
        for _ in range(reader.count())
    ]


def read_odometry(reader: MessageReader) -> list[Edge]:
    """Read a nav_msgs/Odometry; covariances and twist are not wanted."""
    return [Edge(*reader.header(), reader.text(), reader.numbers(_POSE))]


def read_joint_trajectory(reader: MessageReader) -> list[Points]:
    """Read a trajectory_msgs/JointTrajectory."""
    return [_joint_points(reader)]


def read_robot_trajectory(reader: MessageReader) -> list[Points]:
    """Read a RobotTrajectory: the joints, then the base."""
    return [_joint_points(reader), _base_points(reader)]


def _joint_points(reader: MessageReader) -> Points:
    """Read the points of joints."""
    _, frame = reader.header()
    found = Points(reader.names(), frame, [], [], [])
    for _ in range(reader.count()):
        found.positions.append(reader.array())
        found.velocities.append(reader.array())
        reader.array(), reader.array()  # accelerations, efforts
        found.times.append(reader.duration())
    return found


def _base_points(reader: MessageReader) -> Points:
    """Read the points of joints with several degrees of freedom."""
    _, frame = reader.header()
    found = Points(reader.names(), frame, [], [], [])
    for _ in range(reader.count()):
        found.positions.append(reader.array(_POSE))
        found.velocities.append(reader.array(_TWIST))
        reader.array(_TWIST)  # accelerations
        found.times.append(reader.duration())
    return found


READERS = {
    "3066dcd76a6cfaef579bd0f34173e9fd": ("JointState", read_joint_state),
    "94810edda583a504dfda3829e70d7eec": ("TFMessage", read_transforms),
    "cd5e73d190d741a2f92e81eda573aca7": ("Odometry", read_odometry),
    "65b4f94a94d1ed67169da35a02f33d3f": ("JointTrajectory", read_joint_trajectory),
    "dfa9556423d709a3729bcef664bddf67": ("RobotTrajectory", read_robot_trajectory),
}
"""Kinds of messages, and what reads them, by the md5 sums of their definitions:
moveit_msgs, tf and this package have names of their own for some."""
