"""States on the wire: bytes to arrays and back, without message objects.

At 1 kHz the numbers are read straight out of the bytes. LinkStates and
ModelStates are, little-endian (ROS serialisation of gazebo_msgs/LinkStates):
uint32 n, n strings of uint32 length and bytes; uint32 n, n poses of seven
float64; uint32 n, n twists of six float64. SimulatorState has a header before that
(uint32 seq, secs, nsecs; a string) and behind it uint32 m, m MotorStates.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import BinaryIO, NamedTuple

import numpy as np

from g1_description.errors import WireFormatError
from g1_description.msg import MotorCommands
from g1_description.robot.state import RobotState
from g1_description.ros.conversions import COMMAND_FIELDS, robot_state_to_message

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


class MotorArrays(NamedTuple):
    """The joints of one model; all arrays have the shape (n_joints,)."""

    model: str
    names: tuple[str, ...]

    positions: np.ndarray
    """In [rad] or [m]."""

    velocities: np.ndarray
    """In [rad/s] or [m/s]."""

    efforts: np.ndarray | None
    """Efforts of motors, in [N m] or [N]; None in ``kinematic``."""

    commanded: np.ndarray
    """Last commands or samples of motions, in [rad] or [m]; NaN: none."""

    commanded_base: np.ndarray | None = None
    """Commanded pose of the root link in the world, shape (7,); None if there is none.
    """

    is_sample: bool = False
    """Whether a sample of a motion was reached since the state before."""

    def of(self, names: tuple[str, ...], numbers: np.ndarray) -> np.ndarray:
        """Return the numbers of other joints, NaN of those that are unknown."""
        if names == self.names:
            return numbers
        known = dict(zip(self.names, numbers.tolist()))
        return np.array([known.get(name, np.nan) for name in names])


_NUMBERS = 4
"""Arrays in ``MotorArrays`` with a number per joint."""

_COMMANDED_BASE = struct.Struct("<?7d?")
"""Whether there is one, the pose, and ``is_sample``."""


class LinkStatesEncoder:
    """Encodes messages; names are encoded again only if they are another object."""

    def __init__(self) -> None:
        self._names: tuple[str, ...] | None = None
        self._head = b""

    def encode(
        self, names: tuple[str, ...], poses: np.ndarray, twists: np.ndarray
    ) -> bytes:
        """Encode one message.

        Args:
            names: Scoped names.
            poses: Poses in the world, shape (n, 7).
            twists: Twists along the world's axes, shape (n, 6).
        """
        if names is not self._names:
            self._head = _written_names(names)
            self._names = names
        count = _COUNT.pack(len(names))
        numbers = (np.asarray(part, dtype=_FLOAT).tobytes() for part in (poses, twists))
        return self._head + b"".join(count + part for part in numbers)


def encode_motors(time_ns: int, motors: MotorArrays) -> bytes:
    """Encode one MotorStates with a time in [ns]."""
    header = _SEQ_AND_STAMP.pack(0, *divmod(time_ns, 1_000_000_000))
    parts = [header, _motor_head(motors.model, motors.names)]
    for numbers in motors[2 : 2 + _NUMBERS]:
        count = 0 if numbers is None else len(numbers)
        parts.append(_COUNT.pack(count))
        if count:
            parts.append(np.asarray(numbers, dtype=_FLOAT).tobytes())
    base = motors.commanded_base
    pose = np.zeros(7) if base is None else base
    parts.append(_COMMANDED_BASE.pack(base is not None, *pose, motors.is_sample))
    return b"".join(parts)


@lru_cache(maxsize=100)
def _motor_head(model: str, names: tuple[str, ...]) -> bytes:
    """Encode an empty frame_id, and names."""
    return _written("") + _written(model) + _written_names(names)


class MotorCommandsArrays(MotorCommands):
    """MotorCommands with arrays; names are decoded again only if they change."""

    _known: tuple[bytes, str, list[str]] = (b"", "", [])

    def deserialize(self, data: bytes) -> MotorCommandsArrays:
        """Decode one message; its numbers are views into ``data``."""
        head, model, names = self._known
        if not head or not data.startswith(head):
            super().deserialize(data)
            model, names = self.model_name, self.joint_names
            head = _written(model) + _written_names(names)
            type(self)._known = head, model, names
        self.model_name, self.joint_names = model, names
        offset = len(head)
        for field in COMMAND_FIELDS:
            count, begin = _read_count(data, offset)
            setattr(self, field, np.frombuffer(data, _FLOAT, count, begin))
            offset = begin + count * _FLOAT.itemsize
        return self


def _written(text: str) -> bytes:
    """Encode a string."""
    data = text.encode("utf-8")
    return _COUNT.pack(len(data)) + data


def _written_names(names: Sequence[str]) -> bytes:
    """Encode names."""
    return _COUNT.pack(len(names)) + b"".join(map(_written, names))


class LinkStatesDecoder:
    """Decodes messages; names are decoded again only if they change."""

    def __init__(self) -> None:
        self._known: dict[bool, tuple[bytes, tuple[str, ...]]] = {}
        """By whether there is a frame_id: its bytes and those of the names, and the
        names."""
        self._motors: list[tuple[bytes, str, tuple[str, ...]]] = []
        """Bytes from the frame_id to the names, and the names, of each model."""

    def decode(self, data: bytes) -> LinkStatesArrays:
        """Decode one LinkStates; its numbers are views into ``data``.

        Raises:
            WireFormatError: If the bytes are not one whole message.
        """
        states, offset = self._read(data, 0)
        if offset != len(data):
            raise WireFormatError(f"{len(data) - offset} bytes follow the last twist.")
        return states

    def decode_stamped(
        self, data: bytes
    ) -> tuple[int, LinkStatesArrays, dict[str, MotorArrays]]:
        """Decode one SimulatorState; its numbers are views into ``data``.

        Returns:
            The stamp in [ns], the links, and the joints by model.

        Raises:
            WireFormatError: If the bytes are not one whole message.
        """
        if len(data) < _SEQ_AND_STAMP.size:
            raise WireFormatError(f"The message ends after {len(data)} bytes.")
        _, seconds, rest = _SEQ_AND_STAMP.unpack_from(data)
        states, offset = self._read(data, _SEQ_AND_STAMP.size, True)
        count, offset = _read_count(data, offset)
        motors = {}
        for number in range(count):
            one, offset = self._read_motors(data, offset, number)
            motors[one.model] = one
        if offset != len(data):
            raise WireFormatError(f"{len(data) - offset} bytes follow the message.")
        return seconds * 1_000_000_000 + rest, states, motors

    def _read_motors(
        self, data: bytes, offset: int, number: int
    ) -> tuple[MotorArrays, int]:
        """Read the joints of a model; return them and where they end."""
        start = offset + _SEQ_AND_STAMP.size
        known = self._motors[number] if number < len(self._motors) else None
        if known is None or not data.startswith(known[0], start):
            model, end = _read_string(data, _read_string(data, start)[1])
            names, end = _read_names(data, end)
            known = data[start:end], model, names
            self._motors[number:] = [known]
        head, model, names = known
        n, begin = len(names), start + len(head)
        third = begin + 2 * (_COUNT.size + n * _FLOAT.itemsize)
        has_efforts = data[third : third + _COUNT.size] != _COUNT.pack(0)
        layout, starts = _motor_layout(n, has_efforts)
        end = begin + layout.size
        if end > len(data):
            raise WireFormatError(f"The message ends after {len(data)} bytes.")
        found = layout.unpack_from(data, begin)
        if found[:4] != (n, n, n * has_efforts, n):
            raise WireFormatError(f"{model} has {n} joints, but {found[:4]} numbers.")
        arrays: list[np.ndarray | None] = [
            np.frombuffer(data, _FLOAT, n, begin + one) for one in starts
        ]
        if not has_efforts:
            arrays.insert(2, None)
        base = np.array(found[5:12]) if found[4] else None
        return MotorArrays(model, names, *arrays, base, found[12]), end

    def _read(
        self, data: bytes, offset: int, has_frame_id: bool = False
    ) -> tuple[LinkStatesArrays, int]:
        """Read names, poses and twists; return them and where they end."""
        head, names = self._known.get(has_frame_id, (b"", ()))
        if not head or not data.startswith(head, offset):
            start = _read_string(data, offset)[1] if has_frame_id else offset
            names, end = _read_names(data, start)
            head = data[offset:end]
            self._known[has_frame_id] = head, names
        n, start = len(names), offset + len(head)
        middle = _end_of_numbers(data, start, 7, n)
        end = _end_of_numbers(data, middle, 6, n)
        poses = np.frombuffer(data, _FLOAT, 7 * n, start + _COUNT.size)
        twists = np.frombuffer(data, _FLOAT, 6 * n, middle + _COUNT.size)
        return LinkStatesArrays(names, poses.reshape(n, 7), twists.reshape(n, 6)), end


def _read_count(data: bytes, offset: int) -> tuple[int, int]:
    """Read a uint32; return it and its end."""
    if offset + _COUNT.size > len(data):
        raise WireFormatError(f"The message ends after {len(data)} bytes, in a count.")
    return _COUNT.unpack_from(data, offset)[0], offset + _COUNT.size


def _read_string(data: bytes, offset: int) -> tuple[str, int]:
    """Read a string; return it and its end."""
    length, offset = _read_count(data, offset)
    if offset + length > len(data):
        raise WireFormatError(
            f"A name of {length} bytes starts {len(data) - offset} bytes before "
            "the message's end."
        )
    text = data[offset : offset + length].decode("utf-8", "replace")
    return text, offset + length


def _read_names(data: bytes, offset: int) -> tuple[tuple[str, ...], int]:
    """Read the names; return them and their end."""
    count, offset = _read_count(data, offset)
    names = []
    for _ in range(count):
        name, offset = _read_string(data, offset)
        names.append(name)
    return tuple(names), offset


def _end_of_numbers(data: bytes, offset: int, width: int, n: int | None = None) -> int:
    """Return the end of an array of rows of ``width`` float64.

    Raises:
        WireFormatError: If it is incomplete, or does not have ``n`` rows.
    """
    if offset + _COUNT.size > len(data):
        raise WireFormatError(f"The message ends after {len(data)} bytes, in a count.")
    count = _COUNT.unpack_from(data, offset)[0]
    if n is not None and count != n:
        raise WireFormatError(
            f"The message has {n} names, but {count} rows of numbers."
        )
    start = offset + _COUNT.size
    end = start + count * width * _FLOAT.itemsize
    if end > len(data):
        raise WireFormatError(
            f"{count} rows of {width} numbers start {len(data) - start} bytes before "
            "the message's end."
        )
    return end


@lru_cache(maxsize=100)
def _motor_layout(n: int, has_efforts: bool) -> tuple[struct.Struct, tuple[int, ...]]:
    """Return the layout after the names of n joints, and the starts of its arrays.

    These are four counts, whether there is a commanded base, its pose, and
    ``is_sample``.
    """
    sizes = [n, n, n * has_efforts, n]
    arrays = "".join(f"I{size * _FLOAT.itemsize}x" for size in sizes)
    ends = np.cumsum([_COUNT.size + size * _FLOAT.itemsize for size in sizes])
    starts = (ends - np.array(sizes) * _FLOAT.itemsize).tolist()
    if not has_efforts:
        del starts[2]
    return struct.Struct(f"<{arrays}?7d?"), tuple(starts)


class Prepared:
    """A message with its own serialization, for ``DirectPublisher``."""

    _has_header = False  # rospy would put its own count and time into it

    def __init__(self, write: Callable[[BinaryIO], object]) -> None:
        self.serialize = write


def ready(data: bytes) -> Prepared:
    """Make a message from its bytes."""
    return Prepared(lambda buff: buff.write(data))


def write_robot_state(state: RobotState, frame: str, buff: BinaryIO) -> None:
    """Serialize a robot's state with poses in a frame."""
    robot_state_to_message(state, frame).serialize(buff)


class JointStateEncoder:
    """Encodes JointState messages; names are encoded again only if they change.

    Effort is empty, as it is unknown.
    """

    def __init__(self) -> None:
        self._names: Sequence[str] | None = None
        self._seq = 0

    def encode(self, state: RobotState) -> Prepared:
        """Encode the joints of a state, which has velocities."""
        names = state.names
        if names is not self._names:
            self._count = _COUNT.pack(len(names))
            # Between stamp and names stands the empty frame_id.
            self._head = _written("") + _written_names(names) + self._count
            self._names = names
        self._seq += 1
        return ready(
            b"".join(
                (
                    _SEQ_AND_STAMP.pack(self._seq, *divmod(state.stamp, 1_000_000_000)),
                    self._head,
                    np.asarray(state.positions, dtype=_FLOAT).tobytes(),
                    self._count,
                    np.asarray(state.velocities, dtype=_FLOAT).tobytes(),
                    _COUNT.pack(0),
                )
            )
        )
