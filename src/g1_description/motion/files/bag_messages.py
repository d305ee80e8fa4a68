"""The bytes of messages that motions are made of, as rosbags have them.

Read without message classes: a bag brings definitions of its own, which ROS would
compile and run.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np

from g1_description.errors import WireFormatError

_COUNT = struct.Struct("<I")
_HEADER = struct.Struct("<III")
_FRAME = struct.Struct("<IIII")
"""A header and the size of its frame's name."""

_DURATION = struct.Struct("<ii")
_POSE = 7
_TWIST = 6
_NONE = np.empty(0)

MAX_NAMES = 10_000
"""Most joints that a message names."""

MAX_NUMBERS = 24_000_000
"""Most numbers that are kept of all messages: positions and velocities."""

MAX_PARTS = 1_000_000
"""Most points, transforms and names that are read of all messages."""

MESSAGE_PARTS = 3
"""What a message counts as: to read it takes as long."""

POINT_PARTS = 2
"""Likewise, what a point counts as."""

MAX_TEXT = 60_000_000
"""Most bytes of text that are read of all messages."""

N_KNOWN = 8
"""Lists of names that are remembered: who commands groups of joints has several."""


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
    data: bytes
    """T_parent_child; most transforms are of other frames, so it is read when used."""

    @property
    def pose(self) -> np.ndarray:
        """T_parent_child, shape (7,)."""
        return np.frombuffer(self.data, "<f8")


class Points(NamedTuple):
    """A trajectory of joints, or of the base."""

    names: tuple[str, ...]
    frame: str
    times: list[float]
    """Since the start, in [s]."""

    positions: list[np.ndarray]
    """Of the joints, or the poses of the base, a row per time."""

    velocities: list[np.ndarray]
    """Of the joints, likewise; of the base none."""


class MessageReader:
    """Reads one message after the other, until there is too much in all of them.

    A list of names is only read when it is another one than in the last messages.
    """

    def __init__(self) -> None:
        self._data, self._offset = b"", 0
        self._known: list[tuple[bytes, tuple[str, ...]]] = []
        """The last lists of names, and their bytes."""
        self._room = {"numbers": MAX_NUMBERS, "parts": MAX_PARTS, "bytes": MAX_TEXT}
        """How much may still come."""

    def start(self, data: bytes) -> None:
        """Go to the beginning of a message.

        Raises:
            WireFormatError: If there have been too many.
        """
        self._data, self._offset = data, 0
        self._spend(MESSAGE_PARTS, "parts")

    def _spend(self, count: int, what: str) -> None:
        """Refuse what is more than all messages may have."""
        self._room[what] -= count
        if self._room[what] < 0:
            words = {
                "numbers": f"{MAX_NUMBERS} numbers",
                "parts": f"{MAX_PARTS} points, transforms or names",
                "bytes": f"{MAX_TEXT // 1_000_000} MB of text",
            }
            raise WireFormatError(f"The messages have more than {words[what]}.")

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

    def parts(self, weight: int = 1) -> range:
        """Read how many parts a list has; return their numbers, from 1.

        Args:
            weight: What one counts as.
        """
        count = self.count()
        self._spend(weight * count, "parts")
        return range(1, count + 1)

    def text(self) -> str:
        """Read a string."""
        size = self.count()
        begin = self._take(size)
        self._spend(size, "bytes")
        return self._data[begin : begin + size].decode("utf-8", "replace")

    def names(self) -> tuple[str, ...]:
        """Read a list of names."""
        for data, names in self._known:
            if self._data.startswith(data, self._offset):
                self._offset += len(data)
                return names
        begin, count = self._offset, self.count()
        if count > MAX_NAMES:
            raise WireFormatError(f"The message names {count} joints.")
        self._spend(count, "parts")
        names = tuple([self.text() for _ in range(count)])
        known = self._data[begin : self._offset], names
        self._known = [known, *self._known[: N_KNOWN - 1]]
        return names

    def header(self) -> tuple[int, str]:
        """Read a header: stamp in [ns] and frame."""
        _, seconds, rest = _HEADER.unpack_from(self._data, self._take(_HEADER.size))
        return seconds * 1_000_000_000 + rest, self.text()

    def edge(self) -> Edge:
        """Read a header, a frame and a pose: at once, as there are very many."""
        data, begin = self._data, self._offset
        try:
            _, seconds, rest, size = _FRAME.unpack_from(data, begin)
            middle = begin + _FRAME.size + size
            child = middle + _COUNT.size
            pose = child + _COUNT.unpack_from(data, middle)[0]
        except struct.error:
            pose = len(data)
        self._take(pose + 8 * _POSE - begin)
        self._spend(pose - begin, "bytes")
        return Edge(
            seconds * 1_000_000_000 + rest,
            data[middle - size : middle].decode("utf-8", "replace"),
            data[child:pose].decode("utf-8", "replace"),
            data[pose : self._offset],
        )

    def duration(self) -> float:
        """Read a duration in [s]."""
        seconds, rest = _DURATION.unpack_from(self._data, self._take(_DURATION.size))
        return (seconds * 1_000_000_000 + rest) / 1e9

    def numbers(self, count: int) -> np.ndarray:
        """Read float64s; the message itself is not kept."""
        begin = self._take(8 * count)
        if not count:
            return _NONE
        self._spend(count, "numbers")
        return np.frombuffer(self._data[begin : self._offset], "<f8")

    def array(self, width: int = 1) -> np.ndarray:
        """Read a list of rows of float64s, as one row."""
        return self.numbers(width * self.count())

    def skip_array(self, width: int = 1) -> None:
        """Go past such a list."""
        self._take(8 * width * self.count())


def read_joint_state(reader: MessageReader) -> list[JointSample]:
    """Read a sensor_msgs/JointState.

    Raises:
        WireFormatError: If it is no whole message; likewise the others here.
    """
    stamp, _ = reader.header()
    return [JointSample(stamp, reader.names(), reader.array(), reader.array())]


def read_transforms(reader: MessageReader) -> list[Edge]:
    """Read a tf2_msgs/TFMessage."""
    return [reader.edge() for _ in reader.parts()]


def read_odometry(reader: MessageReader) -> list[Edge]:
    """Read a nav_msgs/Odometry; covariances and twist are ignored."""
    return [reader.edge()]


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
    width = len(found.names)
    for number in reader.parts(POINT_PARTS):
        found.positions.append(reader.array())
        found.velocities.append(reader.array())
        reader.skip_array()  # accelerations
        reader.skip_array()  # efforts
        found.times.append(reader.duration())
        _check_width(number, found, width)
    return found


def _base_points(reader: MessageReader) -> Points:
    """Read the points of the base, the one joint with several degrees of freedom."""
    _, frame = reader.header()
    found = Points(reader.names(), frame, [], [], [])
    for number in reader.parts(POINT_PARTS):
        found.positions.append(reader.array(_POSE))
        reader.skip_array(_TWIST)  # velocities
        reader.skip_array(_TWIST)  # accelerations
        found.times.append(reader.duration())
        _check_width(number, found, _POSE)
    return found


def _check_width(number: int, found: Points, width: int) -> None:
    """Refuse a last point that has other numbers of positions, or of velocities."""
    rates = len(found.velocities[-1]) if found.velocities else 0
    for size in (len(found.positions[-1]), rates or width):
        if size != width:
            raise WireFormatError(f"Point {number} has {size} numbers, not {width}.")


READERS = {
    "3066dcd76a6cfaef579bd0f34173e9fd": ("JointState", read_joint_state),
    "94810edda583a504dfda3829e70d7eec": ("TFMessage", read_transforms),
    "cd5e73d190d741a2f92e81eda573aca7": ("Odometry", read_odometry),
    "65b4f94a94d1ed67169da35a02f33d3f": ("JointTrajectory", read_joint_trajectory),
    "dfa9556423d709a3729bcef664bddf67": ("RobotTrajectory", read_robot_trajectory),
}
"""Kinds of messages, and what reads them, by the md5 sums of their definitions:
moveit_msgs, tf and this package have names of their own for some."""
