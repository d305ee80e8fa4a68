"""Rosbags of version 2.0, read without trust in what they say of themselves.

ROS' own reader compiles the definitions of messages that a bag brings and runs them,
and unpacks chunks of any size; so it is not used to read.
"""

from __future__ import annotations

import bz2
import os
import struct
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from g1_description.errors import MotionError, WireFormatError, cause
from g1_description.motion.files.bag_messages import READERS, MessageReader

MAGIC = b"#ROSBAG V2.0\n"

MAX_HEADER = 1_000_000
"""Longest header of a record, in bytes: it may hold the definition of a message."""

MAX_RECORDS = 100_000
"""Most chunks, and most connections."""

MAX_MESSAGES = 250_000
"""Most records in the chunks that are read: messages of all topics, and what says what
the topics are."""

MAX_INDEX = 20_000_000
"""Most bytes of the index."""

MAX_FIELDS = 20
"""Most values in the header of a record; mostly there are three."""

MAX_CHUNK = 100_000_000
"""Most bytes of one chunk, unpacked."""

MAX_UNPACKED = 200_000_000
"""Most bytes of all compressed chunks that are read, unpacked: some seconds' work."""

MAX_READ = 1_000_000_000
"""Most bytes of all other chunks that are read."""

PIECE = 4096
"""Bytes of a compressed chunk that are unpacked at once: at most a thousandfold."""

_MESSAGE, _FILE, _CHUNK, _CHUNK_INFO, _CONNECTION = 2, 3, 5, 6, 7
"""Kinds of records."""

_COUNT = struct.Struct("<I")
_PLACE = struct.Struct("<Q")
_PAIR = struct.Struct("<II")


class Topic(NamedTuple):
    """What a bag has under a name."""

    name: str
    kind: str
    """Type of its messages, ``package/Type``."""

    md5: str


class Message(NamedTuple):
    """A message in a bag."""

    topic: Topic
    time: int
    """When it was recorded, in [ns]."""

    data: bytes


@dataclass(frozen=True)
class Bag:
    """A bag that is open, and its index."""

    file: BinaryIO
    size: int
    connections: Mapping[int, Topic]
    chunks: Mapping[int, Mapping[int, int]]
    """By the place of the chunk: number of messages by connection."""

    def counts(self) -> dict[Topic, int]:
        """Count the messages of each topic that has some."""
        found: dict[Topic, int] = {}
        for counts in self.chunks.values():
            for number, count in counts.items():
                topic = self.connections.get(number)
                if topic and count:
                    found[topic] = found.get(topic, 0) + count
        return found

    def messages(self, topics: Collection[Topic]) -> Iterator[Message]:
        """Read the messages of some topics in the order of the file.

        Raises:
            MotionError: If the bag is damaged or too large.
        """
        numbers = {n for n, topic in self.connections.items() if topic in topics}
        room = {"none": MAX_READ}
        n_records, kind = 0, bytes([_MESSAGE])
        for place, counts in sorted(self.chunks.items()):
            if not any(counts.get(number) for number in numbers):
                continue
            for fields, data in _records(self._chunk(place, room)):
                n_records += 1
                if n_records > MAX_MESSAGES:
                    raise _too_large(f"more than {MAX_MESSAGES} messages")
                number = _number(fields, b"conn")
                if number in numbers and fields.get(b"op") == kind:
                    seconds, rest = _PAIR.unpack(fields.get(b"time", b""))
                    time = seconds * 1_000_000_000 + rest
                    yield Message(self.connections[number], time, bytes(data))

    def _chunk(self, place: int, room: dict[str, int]) -> memoryview:
        """Read a chunk."""
        self.file.seek(place)
        fields = _header(self.file, self.size, _CHUNK)
        packing = fields.get(b"compression", b"").decode("latin-1")
        size, packed = _number(fields, b"size"), _read_count(self.file)
        left, most = room.setdefault(packing, MAX_UNPACKED), max(size, packed)
        if most > MAX_CHUNK or most > left:
            raise _too_large(f"more than {min(MAX_CHUNK, left) // 1_000_000} MB")
        room[packing] = left - most
        data = _read(self.file, self.size, packed)
        if packing == "none":
            return memoryview(data)
        return memoryview(_unpacked(data, packing, size))


def open_bag(path: Path, file: BinaryIO) -> Bag:
    """Read the index of a bag.

    Args:
        path: Its name, for messages.
        file: The bag.

    Raises:
        MotionError: If it has none, or is damaged.
    """
    size = file.seek(0, os.SEEK_END)
    file.seek(0)
    magic = file.read(len(MAGIC))
    if magic != MAGIC:
        version = magic[8:].decode("latin-1").strip()
        raise MotionError(f"The bag is of version {version}; 2.0 is read.")
    fields = _header(file, size, _FILE)
    if fields.get(b"encryptor"):
        raise MotionError("The bag is encrypted.")
    index = _PLACE.unpack(fields.get(b"index_pos", b""))[0]
    if not 0 < index <= size:
        raise MotionError(
            "The bag has no index, as its recording was cut short: "
            f"'rosbag reindex {path.name}' makes one."
        )
    counts = [_number(fields, name) for name in (b"conn_count", b"chunk_count")]
    if max(counts) > MAX_RECORDS:
        raise _too_large(f"{max(counts)} chunks or connections")
    if size - index > MAX_INDEX:
        raise _too_large(f"an index of {(size - index) // 1_000_000} MB")
    file.seek(index)
    connections = dict(_connection(file, size) for _ in range(counts[0]))
    chunks = dict(_chunk_info(file, size) for _ in range(counts[1]))
    return Bag(file, size, connections, chunks)


def damage(error: Exception) -> MotionError:
    """Say what is wrong with a bag whose reading raised something."""
    return MotionError(f"The bag is damaged: {cause(error)}.")


def _too_large(what: str) -> MotionError:
    """Say that there is too much, and what helps."""
    return MotionError(
        f"The bag has {what} where the motion may be: 'rosbag filter' makes a bag of "
        "the motion's topics alone."
    )


def _connection(file: BinaryIO, size: int) -> tuple[int, Topic]:
    """Read a connection: its number and its topic."""
    fields = _header(file, size, _CONNECTION)
    content = _fields(_read(file, size, _read_count(file)))
    texts = (content.get(name, b"") for name in (b"type", b"md5sum"))
    name = fields.get(b"topic", b"").decode("utf-8", "replace")
    return _number(fields, b"conn"), Topic(name, *(t.decode("latin-1") for t in texts))


def _chunk_info(file: BinaryIO, size: int) -> tuple[int, dict[int, int]]:
    """Read what the index says of a chunk: its place, and what it has."""
    fields = _header(file, size, _CHUNK_INFO)
    data = _read(file, size, _read_count(file))
    place = _PLACE.unpack(fields.get(b"chunk_pos", b""))[0]
    return place, dict(_PAIR.iter_unpack(data))


def _read_count(file: BinaryIO) -> int:
    """Read a uint32."""
    return _COUNT.unpack(file.read(_COUNT.size))[0]


def _read(file: BinaryIO, size: int, count: int) -> bytes:
    """Read as many bytes as there are said to be."""
    if count > size - file.tell():
        raise MotionError(f"The bag is cut short: it has {size} bytes.")
    return file.read(count)


def _header(file: BinaryIO, size: int, kind: int) -> dict[bytes, bytes]:
    """Read the header of a record of some kind."""
    count = _read_count(file)
    if count > MAX_HEADER:
        raise MotionError(f"The bag is damaged: a record begins with {count} bytes.")
    fields = _fields(_read(file, size, count))
    if fields.get(b"op") != bytes([kind]):
        raise MotionError("The bag is damaged: its index leads to other records.")
    return fields


def _fields(data: bytes) -> dict[bytes, bytes]:
    """Split the header of a record."""
    found, offset, size = {}, 0, len(data)
    for _ in range(MAX_FIELDS):
        if offset >= size:
            return found
        begin = offset + 4
        offset = begin + _COUNT.unpack_from(data, offset)[0]
        name, equals, value = data[begin:offset].partition(b"=")
        if offset > size or not equals:
            raise MotionError("The bag is damaged: a record has no name for a value.")
        found[name] = value
    raise MotionError(f"The bag is damaged: a record has {MAX_FIELDS} values.")


def _number(fields: Mapping[bytes, bytes], name: bytes) -> int:
    """Read a uint32 of a header."""
    return _COUNT.unpack(fields.get(name, b""))[0]


def _records(chunk: memoryview) -> Iterator[tuple[dict[bytes, bytes], memoryview]]:
    """Go through the records of a chunk: header and content."""
    offset, end = 0, len(chunk)
    while offset < end:
        (length,) = _COUNT.unpack_from(chunk, offset)
        begin = offset + 4 + length
        (size,) = _COUNT.unpack_from(chunk, begin)
        fields = _fields(bytes(chunk[offset + 4 : begin]))
        offset = begin + 4 + size
        if offset > end:
            raise MotionError("The bag is damaged: a chunk is cut short.")
        yield fields, chunk[begin + 4 : offset]


def _unpacked(data: bytes, packing: str, size: int) -> bytes:
    """Unpack a chunk, piece by piece: it may hold more than it says.

    Args:
        data: The chunk as it is in the file.
        packing: How it is compressed.
        size: Its size by its header.

    Raises:
        MotionError: If it has another size.
    """
    unpack = _unpacker(packing)
    pieces, found = [], 0
    for begin in range(0, len(data), PIECE):
        pieces.append(unpack(data[begin : begin + PIECE], size - found + 1))
        found += len(pieces[-1])
        if found > size:
            break
    if found != size:
        raise MotionError(
            f"The bag is damaged: a chunk should have {size} bytes and has "
            f"{'more' if found > size else found}."
        )
    return b"".join(pieces)


def _unpacker(packing: str) -> Callable[[bytes, int], bytes]:
    """Return what unpacks a piece of a chunk to a number of bytes at most."""
    if packing == "bz2":
        return bz2.BZ2Decompressor().decompress
    if packing == "lz4":
        import roslz4

        decompressor = roslz4.LZ4Decompressor()  # makes at most 255 bytes of one
        return lambda data, most: decompressor.decompress(data)
    raise MotionError(f"A chunk of the bag is compressed as {packing[:20]!r}.")


def kind_of(topic: Topic) -> str:
    """Return the kind of a topic's messages; empty if no motion is made of them."""
    return READERS[topic.md5][0] if topic.md5 in READERS else ""


def read_messages(
    bag: Bag, topics: Collection[Topic]
) -> Iterator[tuple[Message, list[Any]]]:
    """Read the messages of some topics; what each says is a list.

    Raises:
        MotionError: If one is no whole message.
    """
    reader = MessageReader()
    for message in bag.messages(topics):
        try:
            reader.start(message.data)
            yield message, READERS[message.topic.md5][1](reader)
        except WireFormatError as error:
            raise MotionError(f"On {message.topic.name}: {error}") from error


def rising(stamps: np.ndarray) -> tuple[np.ndarray, bool]:
    """Choose the samples whose stamps rise, until they go back.

    Args:
        stamps: In [ns], shape (n,).

    Returns:
        Their numbers, of equal stamps the last one; and whether time goes back.
    """
    back = np.flatnonzero(np.diff(stamps) < 0)
    whole = stamps[: back[0] + 1] if back.size else stamps
    return np.flatnonzero(np.append(np.diff(whole) > 0, True)), bool(back.size)
