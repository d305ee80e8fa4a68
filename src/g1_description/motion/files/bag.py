"""Rosbags of ROS 1, read by the library rosbags, which needs no ROS."""

from __future__ import annotations

import bz2
import os
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from g1_description.motion.files.format import Format
from g1_description.motion.files.recorded_motion import reader
from g1_description.motion.files.recordings import Channel, Recording, unpacked
from g1_description.motion.files.source import MotionSource

if TYPE_CHECKING:
    from rosbags.rosbag1 import Reader

MAGIC = b"#ROSBAG V"

MD5_SUMS = {
    "3066dcd76a6cfaef579bd0f34173e9fd": "JointState",
    "94810edda583a504dfda3829e70d7eec": "TFMessage",
    "cd5e73d190d741a2f92e81eda573aca7": "Odometry",
    "65b4f94a94d1ed67169da35a02f33d3f": "JointTrajectory",
    "dfa9556423d709a3729bcef664bddf67": "RobotTrajectory",
    "d3812c3cbc69362b77dc0b19b345f8f5": "PoseStamped",
    "c6bb498135801c29afbf69d37544f6a2": "ReceivedCommands",
}
"""Kinds of messages by md5 sum: some exist under several names, as in moveit_msgs, tf
and this package."""


def recognise(source: MotionSource) -> bool:
    """Return whether a file is a rosbag."""
    return source.head.startswith(MAGIC)


@contextmanager
def _opened(source: MotionSource) -> Iterator[Recording]:
    """Open a bag."""
    with reader_of(source.path) as bag:
        yield recording_of(bag)


def recording_of(bag: Reader) -> Recording:
    """Describe an open bag."""
    channels = {
        Channel(
            known.topic,
            known.msgtype,
            MD5_SUMS.get(known.digest, ""),
            "ros1",
            known.msgcount,
            getattr(known.ext, "callerid", None),
        ): known
        for known in bag.connections
    }
    of_id = {known.id: channel for channel, known in channels.items()}

    def messages(chosen: Collection[Channel]) -> Iterator[tuple[Channel, int, bytes]]:
        for known, time, data in bag.messages([channels[own] for own in chosen]):
            yield of_id[known.id], time, data

    return Recording([*channels], messages)


def reader_of(
    path: Path, old_chunks: Callable[[Reader], Collection[int]] = lambda _: ()
) -> Reader:
    """Make a reader of a bag with a limit on decompressed chunks.

    Args:
        path: The bag.
        old_chunks: Given the reader with ``connections`` and ``chunk_infos``, returns
            the positions of chunks whose messages are left out.
    """
    # Not at the top: it takes 0.05 s, and few programs read bags.
    import lz4.frame
    from rosbags.rosbag1 import Reader
    from rosbags.rosbag1.reader import read_uint32

    decompressors = {
        bz2.decompress: bz2.BZ2Decompressor,
        lz4.frame.decompress: lz4.frame.LZ4FrameDecompressor,
    }

    class BoundedReader(Reader):
        """Decompresses each chunk once, and at most ``MAX_CHUNK`` bytes of it."""

        @cached_property
        def old(self) -> Collection[int]:
            return old_chunks(self)

        def messages(self, connections: Any = (), *_: Any) -> Any:
            # In the order of the file: recorded times go back at a reset, and by them
            # the messages of two runs would be mixed.
            entries = [e for known in connections for e in self.indexes[known.id]]
            entries.sort(key=lambda entry: (entry.chunk_pos, entry.offset))
            self.indexes[-1] = entries
            return super().messages([next(iter(connections))._replace(id=-1)])

        def read_chunk(self) -> Any:
            chunk = super().read_chunk()
            make = decompressors.get(chunk.decompressor)
            if make is None:
                return chunk
            bounded = partial(unpacked, lambda *given: make().decompress(*given))
            return chunk._replace(decompressor=bounded)

        def read_index_data(self, pos: int, indexes: Any) -> None:
            if pos not in self.old:
                super().read_index_data(pos, indexes)
                return
            assert self.bio is not None
            for _ in ("header", "data"):  # their sizes come first
                self.bio.seek(read_uint32(self.bio), os.SEEK_CUR)

    return BoundedReader(path)


FORMAT = Format("bag", recognise, reader(_opened), (".bag",), is_recorded=True)
