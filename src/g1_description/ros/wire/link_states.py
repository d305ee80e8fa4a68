"""LinkStates on the wire: bytes to arrays and back, without message objects.

At 1 kHz the numbers are read straight out of the bytes. LinkStates and
ModelStates are, little-endian (ROS serialisation of gazebo_msgs/LinkStates):
uint32 n, n strings of uint32 length and bytes; uint32 n, n poses of seven
float64; uint32 n, n twists of six float64. WorldState has a header before that
(uint32 seq, secs, nsecs; a string) and behind it uint32 m, m wrenches of six float64.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from g1_description.core.errors import WireFormatError

_COUNT = struct.Struct("<I")
_SEQ_AND_STAMP = struct.Struct("<III")
_FLOAT = np.dtype("<f8")


class LinkStatesArrays(NamedTuple):
    """The content of one message."""

    names: tuple[str, ...]
    """Scoped names, ``model::link``."""

    poses: np.ndarray
    """Poses in the world, read-only, shape (n, 7)."""

    twists: np.ndarray
    """Twists along the world's axes, linear then angular, read-only, shape (n, 6)."""


class LinkStatesEncoder:
    """Write messages; the names are only written when they change."""

    def __init__(self) -> None:
        """Begin without names."""
        self._names: list[str] | None = None
        self._head = b""

    def encode(
        self, names: Sequence[str], poses: np.ndarray, twists: np.ndarray
    ) -> bytes:
        """Write one message.

        Args:
            names: Scoped names.
            poses: Poses in the world, shape (n, 7).
            twists: Twists along the world's axes, shape (n, 6).

        Returns:
            The message's bytes.
        """
        if names != self._names:
            encoded = [name.encode("utf-8") for name in names]
            strings = [_COUNT.pack(len(name)) + name for name in encoded]
            self._head = _COUNT.pack(len(names)) + b"".join(strings)
            self._names = list(names)
        count = _COUNT.pack(len(names))
        numbers = (np.asarray(part, dtype=_FLOAT).tobytes() for part in (poses, twists))
        return self._head + b"".join(count + part for part in numbers)


class LinkStatesDecoder:
    """Read messages; the names are only read when they change."""

    def __init__(self) -> None:
        """Begin without names."""
        self._names: tuple[str, ...] = ()
        self._head = _COUNT.pack(0)

    def decode(self, data: bytes) -> LinkStatesArrays:
        """Read one LinkStates.

        Args:
            data: The message's bytes.

        Returns:
            Its names and numbers; the numbers are views into ``data``.

        Raises:
            WireFormatError: If the bytes are not one whole message.
        """
        states, offset = self._read(data, 0)
        if offset != len(data):
            raise WireFormatError(f"{len(data) - offset} bytes follow the last twist.")
        return states

    def decode_stamped(self, data: bytes) -> tuple[int, LinkStatesArrays]:
        """Read one WorldState; its wrenches are not wanted.

        Args:
            data: The message's bytes.

        Returns:
            Its stamp in [ns], and its names and numbers as ``decode`` gives them.

        Raises:
            WireFormatError: If the bytes are not one whole message.
        """
        if len(data) < _SEQ_AND_STAMP.size:
            raise WireFormatError(f"The message ends after {len(data)} bytes.")
        _, seconds, rest = _SEQ_AND_STAMP.unpack_from(data)
        _, offset = _read_string(data, _SEQ_AND_STAMP.size)
        states, offset = self._read(data, offset)
        count, offset = _read_count(data, offset)
        _, offset = _read_numbers(data, offset - _COUNT.size, count, 6)
        if offset != len(data):
            raise WireFormatError(f"{len(data) - offset} bytes follow the message.")
        return seconds * 1_000_000_000 + rest, states

    def _read(self, data: bytes, offset: int) -> tuple[LinkStatesArrays, int]:
        """Read names, poses and twists; give them and where they end."""
        if not data.startswith(self._head, offset):
            self._names, end = _read_names(data, offset)
            self._head = data[offset:end]
        n = len(self._names)
        poses, offset = _read_numbers(data, offset + len(self._head), n, 7)
        twists, offset = _read_numbers(data, offset, n, 6)
        return LinkStatesArrays(self._names, poses, twists), offset


def _read_count(data: bytes, offset: int) -> tuple[int, int]:
    """Read a uint32; give it and where it ends."""
    if offset + _COUNT.size > len(data):
        raise WireFormatError(f"The message ends after {len(data)} bytes, in a count.")
    return _COUNT.unpack_from(data, offset)[0], offset + _COUNT.size


def _read_string(data: bytes, offset: int) -> tuple[str, int]:
    """Read a string; give it and where it ends."""
    length, offset = _read_count(data, offset)
    if offset + length > len(data):
        raise WireFormatError(
            f"A name of {length} bytes starts {len(data) - offset} bytes before "
            "the message's end."
        )
    text = data[offset : offset + length].decode("utf-8", "replace")
    return text, offset + length


def _read_names(data: bytes, offset: int) -> tuple[tuple[str, ...], int]:
    """Read the names; give them and where they end."""
    count, offset = _read_count(data, offset)
    names = []
    for _ in range(count):
        name, offset = _read_string(data, offset)
        names.append(name)
    return tuple(names), offset


def _read_numbers(
    data: bytes, offset: int, n: int, width: int
) -> tuple[np.ndarray, int]:
    """Read n rows of numbers; give them and where they end."""
    count, offset = _read_count(data, offset)
    if count != n:
        raise WireFormatError(f"{n} names come with {count} rows of numbers.")
    end = offset + n * width * _FLOAT.itemsize
    if end > len(data):
        raise WireFormatError(
            f"{n} rows of {width} numbers start {len(data) - offset} bytes before the "
            "message's end."
        )
    flat = np.frombuffer(data, _FLOAT, n * width, offset)
    return flat.reshape(n, width), end
