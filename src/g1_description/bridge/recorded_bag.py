"""Writing motions to rosbags: many messages at once, as they differ in numbers only.

Source: wiki.ros.org/Bags/Format/2.0.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import IO, Any, Callable, Tuple

import genpy
import numpy as np
from geometry_msgs.msg import PoseStamped
from lz4.frame import compress
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

from g1_description.bridge.parameters import BridgeParameters, base_child, static_edges
from g1_description.motion.files.history_bag import COMMANDED_BASE, COMMANDED_JOINTS
from g1_description.motion.files.recordings import stamps_of
from g1_description.motion.history_chunks import Stretch
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description
from g1_description.robot.transform import IDENTITY
from g1_description.ros.conversions import pose_from_array, stamp_from_ns, transform

MAX_STAMP = (1 << 32) * 1_000_000_000 - 1

ROWS = 500
"""Samples in a chunk of a file."""

LZ4 = {"block_linked": False, "content_checksum": True, "store_size": False}
"""What ROS can read."""

MAGIC = b"#ROSBAG V2.0\n"

MESSAGE, BAG, INDEX, CHUNK, INFO, CONNECTION = 2, 3, 4, 5, 6, 7
"""Kinds of records."""

_MARKS = (
    (genpy.Time(), 0.0),
    (
        genpy.Time(0x01010101, 0x01010101),
        float(np.frombuffer(b"\1" * 8)[0]),
    ),
)
"""Two stamps and two numbers that differ in each byte."""

Make = Callable[[genpy.Time, float], genpy.Message]
"""Makes a message whose stamps and numbers all have one value."""

_Topic = Tuple[str, Make, np.ndarray]
"""A topic: its name, its messages, and the numbers of each, shape (n, n_numbers)."""

Entries = Tuple[np.ndarray, np.ndarray]
"""Stamps in [ns] and offsets of messages in a chunk, shape (n,)."""


class _Bag:
    """A bag that is written chunk by chunk."""

    def __init__(self, stream: IO[bytes]) -> None:
        self._stream = stream
        self._connections: list[bytes] = []
        self._infos: list[bytes] = []
        stream.write(MAGIC)
        self._begin(0)

    def _begin(self, index: int) -> None:
        """Write the first record; ``index``: where those after the chunks begin."""
        counts = {"conn_count": len(self._connections), "chunk_count": len(self._infos)}
        header = _header(BAG, index_pos=struct.pack("<Q", index), **counts)
        self._stream.write(_record(header, b" " * (4096 - len(header) - 8)))

    def connect(self, topic: str, kind: type[genpy.Message], **more: str) -> int:
        """Add a topic, with more fields of its header; return its number."""
        number, name = len(self._connections), topic.encode()
        header = _header(CONNECTION, conn=number, topic=name)
        described = {
            "topic": topic,
            "type": kind._type,
            "md5sum": kind._md5sum,
            "message_definition": kind._full_text,
            **more,
        }
        fields = (_field(key, value.encode()) for key, value in described.items())
        self._connections.append(_record(header, b"".join(fields)))
        return number

    def add(self, data: bytes, entries: Mapping[int, Entries]) -> None:
        """Write a chunk.

        Args:
            data: Records of messages.
            entries: Messages of each topic by its number.
        """
        place = self._stream.tell()
        named = b"".join(self._connections[number] for number in entries)
        data = named + data
        header = _header(CHUNK, compression=b"lz4", size=len(data))
        packed = compress(data, **LZ4)
        self._stream.write(_record(header, packed))
        for number, (stamps, offsets) in entries.items():
            rows = np.empty(len(stamps), [("t", "<u4", (2,)), ("at", "<u4")])
            rows["t"] = np.stack(np.divmod(stamps, 1_000_000_000), axis=1)
            rows["at"] = offsets + len(named)
            header = _header(INDEX, ver=1, conn=number, count=len(rows))
            self._stream.write(_record(header, rows.tobytes()))
        every = np.concatenate([stamps for stamps, _ in entries.values()])
        first, last = (_time(int(stamp)) for stamp in (every.min(), every.max()))
        header = _header(
            INFO,
            ver=1,
            chunk_pos=struct.pack("<Q", place),
            start_time=first,
            end_time=last,
            count=len(entries),
        )
        counts = [struct.pack("<II", n, len(of[0])) for n, of in entries.items()]
        self._infos.append(_record(header, b"".join(counts)))

    def close(self) -> None:
        """Write what comes after the chunks."""
        index = self._stream.tell()
        self._stream.write(b"".join([*self._connections, *self._infos]))
        self._stream.seek(len(MAGIC))
        self._begin(index)


class _TopicRecords:
    """A topic whose messages differ only in stamps and numbers."""

    def __init__(self, bag: _Bag, topic: str, make: Make, **more: str) -> None:
        """Add the topic to a bag; ``more`` fields are those of its header."""
        kind = type(make(*_MARKS[0]))
        self.number = bag.connect(topic, kind, **more)
        blank, marked = (
            np.frombuffer(self.record(make(*mark), mark[0].to_nsec()), np.uint8)
            for mark in _MARKS
        )
        self._blank, self._open = blank, blank != marked

    def record(self, message: genpy.Message, stamp: int) -> bytes:
        """Write a message as a record."""
        content = BytesIO()
        message.serialize(content)
        header = _header(MESSAGE, conn=self.number, time=_time(stamp))
        return _record(header, content.getvalue())

    def rows(self, stamps: np.ndarray, numbers: np.ndarray) -> np.ndarray:
        """Return records of messages with one stamp each, shape (n, size).

        Args:
            stamps: In [ns], shape (n,).
            numbers: Those of each message, shape (n, n_numbers).
        """
        times = np.stack(np.divmod(stamps, 1_000_000_000), axis=1).astype("<u4")
        parts = [times, times, numbers.astype("<f8")]  # of the record, of the message
        found = np.tile(self._blank, (len(stamps), 1))
        found[:, self._open] = np.concatenate(
            [np.ascontiguousarray(part).view(np.uint8) for part in parts], axis=1
        )
        return found


def write_bag(
    path: Path,
    motion: Motion,
    robot: Description,
    begin: int,
    states: Stretch | None = None,
    others: Sequence[tuple[str, int, genpy.Message]] = (),
) -> None:
    """Write joint_states, and the base on TF with the same stamps.

    Args:
        path: The file.
        motion: The motion.
        robot: The robot that moves.
        begin: Stamp of the first sample, in [ns].
        states: The states that the motion is made of, whose efforts and commanded
            joints and base are written, too.
        others: Further messages with their topics and stamps in [ns].

    Raises:
        MotionError: If a stamp is too large.
    """
    frames, base = BridgeParameters(), base_child(BridgeParameters(), robot)
    stamps = np.array(stamps_of(motion, begin, MAX_STAMP), dtype=np.int64)

    def edge(stamp: genpy.Time, number: float) -> TFMessage:
        return TFMessage([transform(stamp, frames.map_frame, base, 7 * [number])])

    def pose(stamp: genpy.Time, number: float) -> PoseStamped:
        message = PoseStamped(pose=pose_from_array(np.full(7, number)))
        message.header.stamp, message.header.frame_id = stamp, frames.map_frame
        return message

    names, efforts = motion.joint_names, None if states is None else states.efforts
    arrays = [motion.positions, motion.velocities, efforts]
    given = [_joint_topic("/joint_states", names, arrays)]
    if motion.base_poses is not None and base is not None:
        given.append(("/tf", edge, motion.base_poses))
    if states is not None and states.commanded is not None:
        wanted = states.commanded_names, [states.commanded]
        given.append(_joint_topic(f"/{COMMANDED_JOINTS}", *wanted))
    if states is not None and states.commanded_bases is not None:
        given.append((f"/{COMMANDED_BASE}", pose, states.commanded_bases))
    with path.open("wb") as stream:
        bag = _Bag(stream)
        first = stamp_from_ns(begin)
        edges = static_edges(frames, robot)
        still = TFMessage([transform(first, *edge, IDENTITY) for edge in edges])
        _add_each(bag, [("/tf_static", begin, still), *others])
        _add_rows(bag, stamps, given)
        bag.close()


def _joint_topic(
    topic: str, names: Sequence[str], arrays: Sequence[np.ndarray | None]
) -> _Topic:
    """Describe a topic with positions, velocities and efforts; None: left out."""
    counts = [0 if array is None else len(names) for array in arrays]
    fields = "position", "velocity", "effort"

    def joint_state(stamp: genpy.Time, number: float) -> JointState:
        filled = zip(fields, ([number] * count for count in counts))
        message = JointState(name=list(names), **dict(filled))
        message.header.stamp = stamp
        return message

    numbers = np.hstack([array for array in arrays if array is not None])
    return topic, joint_state, numbers


def _add_rows(bag: _Bag, stamps: np.ndarray, given: Sequence[_Topic]) -> None:
    """Write a message of each topic per stamp in [ns], shape (n,)."""
    topics = [(_TopicRecords(bag, topic, make), rows) for topic, make, rows in given]
    for at in range(0, len(stamps), ROWS):
        some = slice(at, at + ROWS)
        parts = [topic.rows(stamps[some], numbers[some]) for topic, numbers in topics]
        rows = np.hstack(parts)
        begins = np.cumsum([0, *(part.shape[1] for part in parts)])
        offsets = np.arange(len(rows)) * rows.shape[1]
        entries = {
            topic.number: (stamps[some], offsets + place)
            for (topic, _), place in zip(topics, begins)
        }
        bag.add(rows.tobytes(), entries)


def _add_each(bag: _Bag, messages: Sequence[tuple[str, int, Any]]) -> None:
    """Write messages of any kinds; those of /tf_static are latched."""
    topics: dict[str, _TopicRecords] = {}
    for topic, stamp, message in messages:
        if topic not in topics:
            latched = {"latching": "1"} if topic == "/tf_static" else {}
            topics[topic] = _TopicRecords(
                bag, topic, lambda *_, one=message: one, **latched
            )
        own = topics[topic]
        entries = {own.number: (np.array([stamp]), np.array([0]))}
        bag.add(own.record(message, stamp), entries)


def _field(name: str, value: bytes) -> bytes:
    """Write a field of a header."""
    content = name.encode() + b"=" + value
    return struct.pack("<I", len(content)) + content


def _header(kind: int, **fields: int | bytes) -> bytes:
    """Write a header; numbers have four bytes."""
    each = {
        name: struct.pack("<I", v) if isinstance(v, int) else v
        for name, v in fields.items()
    }
    parts = [_field("op", bytes([kind])), *(_field(*pair) for pair in each.items())]
    return b"".join(parts)


def _record(header: bytes, data: bytes) -> bytes:
    """Write a record."""
    sizes = (struct.pack("<I", len(part)) for part in (header, data))
    return next(sizes) + header + next(sizes) + data


def _time(stamp: int) -> bytes:
    """Write a time in [ns]."""
    return struct.pack("<II", *divmod(stamp, 1_000_000_000))
