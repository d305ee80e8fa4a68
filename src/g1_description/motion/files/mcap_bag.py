"""MCAP, the container of ROS 2's bags, read and written without ROS."""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import IO, TYPE_CHECKING, Any

from g1_description.errors import MotionError
from g1_description.motion.files.bag import MD5_SUMS
from g1_description.motion.files.format import Format, Writer
from g1_description.motion.files.mcap_writer import write_mcap
from g1_description.motion.files.recorded_motion import reader
from g1_description.motion.files.recordings import Channel, Recording, unpacked
from g1_description.motion.files.source import MotionSource
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description

if TYPE_CHECKING:
    from mcap.records import Chunk

MAGIC = b"\x89MCAP0\r\n"

TYPES = {
    "sensor_msgs/JointState": "JointState",
    "tf2_msgs/TFMessage": "TFMessage",
    "nav_msgs/Odometry": "Odometry",
    "trajectory_msgs/JointTrajectory": "JointTrajectory",
    "moveit_msgs/RobotTrajectory": "RobotTrajectory",
}
"""Kinds of messages by the names of their types."""


def recognise(source: MotionSource) -> bool:
    """Return whether a file is MCAP."""
    return source.head.startswith(MAGIC)


@contextmanager
def _opened(source: MotionSource) -> Iterator[Recording]:
    """Open a file, of ROS 1 or 2."""
    from mcap.records import Message

    with source.path.open("rb") as file:
        summary = _summary(file)
        schemas = {0: "no type", **{s.id: s.name for s in summary.schemas.values()}}
        counts = summary.statistics.channel_message_counts
        channels = {
            number: _channel(one, schemas[one.schema_id], counts.get(number, 0))
            for number, one in summary.channels.items()
        }

        def messages(
            chosen: Collection[Channel],
        ) -> Iterator[tuple[Channel, int, bytes]]:
            wanted = {*chosen}
            for record in _records(file):
                if isinstance(record, Message):
                    channel = channels[record.channel_id]
                    if channel in wanted:
                        yield channel, record.log_time, record.data

        yield Recording([*channels.values()], messages)


def _channel(channel: Any, type_name: str, count: int) -> Channel:
    """Describe a channel."""
    encoding, metadata = channel.message_encoding, channel.metadata
    kind = TYPES.get(type_name.replace("/msg/", "/"), "")
    if encoding == "ros1":
        kind = MD5_SUMS.get(metadata.get("md5sum", ""), kind)
    elif encoding != "cdr":
        kind = ""
    sender = metadata.get("callerid")
    return Channel(channel.topic, type_name, kind, encoding, count, sender)


def _summary(file: IO[bytes]) -> Any:
    """Read the channels, schemas and statistics at the end of a file."""
    from mcap.reader import SeekingReader

    size = file.seek(0, os.SEEK_END)
    file.seek(max(size - len(MAGIC), 0))
    if file.read() != MAGIC:
        raise MotionError("The bag ends too early; try 'mcap recover'.")
    file.seek(0)
    summary = SeekingReader(file, record_size_limit=size).get_summary()
    if (
        summary is None
        or summary.statistics is None
        or len(summary.channels) < summary.statistics.channel_count
    ):
        raise MotionError("The bag has no summary; try 'mcap recover'.")
    return summary


def _records(file: IO[bytes]) -> Iterator[Any]:
    """Yield the records of a file from its begin on, also those in chunks."""
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader, breakup_chunk

    size = file.seek(0, os.SEEK_END)
    file.seek(0)
    reading = StreamReader(file, emit_chunks=True, record_size_limit=size)
    for record in reading.records:
        if isinstance(record, Chunk):
            whole = replace(record, compression="", data=_data(record))
            yield from breakup_chunk(whole, validate_crc=True)
        else:
            yield record


def _data(chunk: Chunk) -> bytes:
    """Decompress a chunk, up to a limit."""
    import lz4.frame
    import zstandard

    def of_zstd(data: bytes, size: int) -> bytes:
        with zstandard.ZstdDecompressor().stream_reader(data) as stream:
            return bytes(stream.read(size))

    decompressors: dict[str, Callable[[bytes, int], bytes]] = {
        "": lambda data, _: data,
        "lz4": lz4.frame.LZ4FrameDecompressor().decompress,
        "zstd": of_zstd,
    }
    if chunk.compression not in decompressors:
        raise MotionError(
            f"The bag is compressed with {chunk.compression}; lz4 and zstd are read."
        )
    return unpacked(decompressors[chunk.compression], chunk.data)


def _write(
    motion: Motion, robot: Description, _: float | None
) -> tuple[bytes, Sequence[str]]:
    """Write a file as a format is written."""
    stream = io.BytesIO()
    write_mcap(stream, motion, robot)
    return stream.getvalue(), ()


FORMAT = Format(
    "mcap",
    recognise,
    reader(_opened),
    (".mcap",),
    is_recorded=True,
    writers={"mcap": Writer(".mcap", _write)},
)
