"""Chunks of a history, without loss except of arrays kept as float32.

Of each column the second differences of the bit patterns are compressed, first bytes of
all of them first. While the robot moves that is two thirds of the size, at rest next to
nothing.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from g1_description.motion.motion import Motion
from g1_description.robot.state import RobotState

SIZE = 256
"""Most states in a chunk: 1.3 s at 200 Hz."""

MAX_COMMANDS = 10_000
"""Most commands in a chunk; more are not kept: a pause may be long."""

OVERHEAD = 2500
"""Bytes of a packed chunk next to its arrays."""

OF_COMMAND = 500
"""Bytes of one kind of command in a packed chunk next to its arrays."""

_FIELDS = {
    "positions": np.float64,
    "velocities": np.float32,
    "base_poses": np.float64,
    "base_twists": np.float32,
    "efforts": np.float32,
    "commanded": np.float64,
    "commanded_bases": np.float64,
}
"""Arrays of a stretch, and how they are kept."""


class Command(NamedTuple):
    """The common part of all commands of a stream."""

    sender: str
    """Name of the node."""

    topic: str
    """Topic, service or action."""

    content: str
    """A phrase, such as the joints."""

    names: tuple[str, ...] = ()
    """The joints whose positions are kept."""


@dataclass(frozen=True, eq=False)
class Stretch:
    """States with the same joints, at increasing times.

    An array is None if no state has it. Rows of NaN are of states that do not.
    """

    run: int
    """Number of the run: a new one begins when time goes back."""

    stamps: np.ndarray
    """In [ns], shape (n,)."""

    names: tuple[str, ...]
    """Names of the joints."""

    commanded_names: tuple[str, ...]
    """Names of the commanded joints."""

    positions: np.ndarray
    """In [rad] or [m], shape (n, n_joints)."""

    velocities: np.ndarray | None = None
    """In [rad/s] or [m/s], shape (n, n_joints)."""

    base_poses: np.ndarray | None = None
    """In the map, shape (n, 7), like ``RobotState.base_pose``."""

    base_twists: np.ndarray | None = None
    """Shape (n, 6), like ``RobotState.base_twist``."""

    efforts: np.ndarray | None = None
    """In [N m] or [N], shape (n, n_joints)."""

    commanded: np.ndarray | None = None
    """In [rad] or [m], shape (n, n_commanded)."""

    commanded_bases: np.ndarray | None = None
    """Shape (n, 7), like ``RobotState.commanded_base``."""

    others: int = 0
    """States of that time with other joints, which are ignored."""

    def rows(self, which: slice | np.ndarray) -> Stretch:
        """Return some of the states."""
        arrays = {name: getattr(self, name) for name in ("stamps", *_FIELDS)}
        kept = {name: a[which] for name, a in arrays.items() if a is not None}
        return replace(self, **kept)

    def states(self) -> list[RobotState]:
        """Return the single states."""
        return [
            RobotState(
                stamp,
                self.names,
                self.positions[row],
                _known(self.velocities, row),
                _known(self.base_poses, row),
                _known(self.base_twists, row),
                self._commanded(row),
                _known(self.commanded_bases, row),
                _known(self.efforts, row),
            )
            for row, stamp in enumerate(self.stamps.tolist())
        ]

    def _commanded(self, row: int) -> Mapping[str, float]:
        """Return the commanded positions of a state."""
        if self.commanded is None:
            return {}
        pairs = zip(self.commanded_names, self.commanded[row].tolist())
        return {name: value for name, value in pairs if not math.isnan(value)}

    def motion(self) -> Motion:
        """Return the states as a motion from time zero.

        Velocities and base are left out unless they are known in all states.
        """
        velocities, bases = (
            None if array is None or np.isnan(array).any() else array
            for array in (self.velocities, self.base_poses)
        )
        times = (self.stamps - self.stamps[0]) / 1e9
        return Motion(times, self.names, self.positions, velocities, bases)


def joined(parts: Sequence[Stretch]) -> Stretch:
    """Join parts of a run that follow each other, those with the joints of the last."""
    newest = parts[-1]
    alike = [part for part in parts if part.names == newest.names]
    names = tuple(dict.fromkeys(n for part in alike for n in part.commanded_names))
    ignored = sum(len(part.stamps) for part in parts if part.names != newest.names)
    alike = [_commanding(part, names) for part in alike]
    arrays = {}
    for name in _FIELDS:
        found = [getattr(part, name) for part in alike]
        width = next((one.shape[1] for one in found if one is not None), None)
        if width is not None:
            arrays[name] = np.concatenate(
                [
                    np.full((len(part.stamps), width), np.nan) if one is None else one
                    for part, one in zip(alike, found)
                ]
            )
    return replace(
        alike[-1],
        stamps=np.concatenate([part.stamps for part in alike]),
        others=ignored + sum(part.others for part in parts),
        **arrays,
    )


def _commanding(part: Stretch, names: tuple[str, ...]) -> Stretch:
    """Give a stretch other commanded joints, with NaN for those that it lacks."""
    own = part.commanded_names
    if part.commanded is None or own == names:
        return replace(part, commanded_names=names)
    wider = np.pad(part.commanded, ((0, 0), (0, 1)), "constant", constant_values=np.nan)
    order = [own.index(name) if name in own else -1 for name in names]
    return replace(part, commanded_names=names, commanded=wider[:, order])


class Chunk:
    """Consecutive states of one run with the same names, and commands meanwhile."""

    def __init__(
        self,
        run: int,
        names: tuple[str, ...],
        commanded_names: tuple[str, ...],
        begin: int,
    ) -> None:
        self.run, self.names, self.commanded_names = run, names, commanded_names
        self.states: list[RobotState] = []
        self.first = self.last = begin
        """First and last stamp, once there is a state."""
        self.n_bytes = 0
        self._begin = begin
        """Last stamp of the chunk before it."""
        self._commands: dict[Command, list[tuple[int, np.ndarray]]] = {}
        """Stamps and positions of each."""
        self._n_commands = 0
        self._packed: _Packed | None = None

    def has_room_for(self, state: RobotState, run: int) -> bool:
        """Whether a state may be the next one."""
        return (
            run == self.run
            and len(self.states) < SIZE
            and (state.names is self.names or state.names == self.names)
            and tuple(state.commanded) == self.commanded_names
        )

    def add(self, state: RobotState) -> None:
        """Add the next state."""
        self.first = self.first if self.states else state.stamp
        self.states.append(state)
        self.last = state.stamp

    def add_command(self, command: Command, positions: Sequence[float]) -> None:
        """Add a command at the time of the last state, unless there are too many."""
        if self._n_commands < MAX_COMMANDS:
            self._n_commands += 1
            found = self.last, np.array(positions, np.float32)
            if command in self._commands:
                self._commands[command].append(found)
            else:  # a reader without the lock must not meet an empty list
                self._commands[command] = [found]

    @property
    def duration(self) -> int:
        """Time since the chunk before it, in [ns]."""
        return self.last - self._begin

    def stamps(self) -> np.ndarray:
        """Return the stamps."""
        states, packed = self.states, self._packed  # in this order: pack() may run
        if packed is not None:
            return packed.stamps
        return np.array([state.stamp for state in states[:]], np.int64)

    def stretch(self, rows: np.ndarray) -> Stretch:
        """Return some of the states by their numbers, shape (n,)."""
        states, packed = self.states, self._packed
        if packed is None:
            arrays = dict(_stacked([states[row] for row in rows.tolist()]))
        else:
            n = len(packed.stamps)
            arrays = {
                name: _decoded(data, n, _FIELDS[name])[rows]
                for name, data in packed.arrays.items()
            }
        found: dict[str, Any] = {
            name: array.astype(np.float64) for name, array in arrays.items()
        }
        return Stretch(
            self.run, self.stamps()[rows], self.names, self.commanded_names, **found
        )

    def commands(
        self, begin: int, end: int, with_positions: bool
    ) -> Iterator[tuple[Command, np.ndarray, np.ndarray]]:
        """Iterate over commands from a time to another one.

        With each come stamps and positions, shapes (n,) and (n, n_names); without
        positions (n, 0).
        """
        commands, packed = self._commands, self._packed
        kinds = commands if packed is None else packed.commands
        for command in list(kinds):
            if packed is None:
                stamps, positions = _received(commands[command][:])
            else:
                stamps, data = packed.commands[command]
            first = int(np.searchsorted(stamps, begin))
            last = int(np.searchsorted(stamps, end, "right"))
            if first == last:
                continue
            if not with_positions:
                positions = np.empty((len(stamps), 0))
            elif packed is not None:
                positions = _decoded(data, len(stamps), np.float32)
            yield command, stamps[first:last], positions[first:last]

    def pack(self) -> None:
        """Replace the states by compressed arrays."""
        packed = _Packed(
            self.stamps(),
            {name: _encoded(array) for name, array in _stacked(self.states)},
            {
                command: (stamps, _encoded(positions))
                for command, found in self._commands.items()
                for stamps, positions in [_received(found)]
            },
        )
        self.n_bytes = (
            OVERHEAD
            + sum(map(len, packed.arrays.values()))
            + packed.stamps.nbytes
            + sum(
                OF_COMMAND + stamps.nbytes + len(data) + 8 * sum(map(len, command))
                for command, (stamps, data) in packed.commands.items()
            )
        )
        self._packed = packed
        self.states, self._commands = [], {}


class _Packed(NamedTuple):
    """The content of a chunk, compressed."""

    stamps: np.ndarray
    arrays: dict[str, bytes]
    commands: dict[Command, tuple[np.ndarray, bytes]]
    """Stamps and positions of each."""


def _received(
    found: Sequence[tuple[int, np.ndarray]],
) -> tuple[np.ndarray, np.ndarray]:
    """Return stamps and positions of commands as arrays."""
    stamps, positions = zip(*found)
    return np.array(stamps, np.int64), np.array(positions)


def _stacked(states: Sequence[RobotState]) -> Iterator[tuple[str, np.ndarray]]:
    """Iterate over the arrays of states, with NaN where a state has none."""
    columns: dict[str, list[Any]] = {
        "positions": [state.positions for state in states],
        "velocities": [state.velocities for state in states],
        "base_poses": [state.base_pose for state in states],
        "base_twists": [state.base_twist for state in states],
        "efforts": [state.efforts for state in states],
        "commanded": [[*state.commanded.values()] or None for state in states],
        "commanded_bases": [state.commanded_base for state in states],
    }
    for name, rows in columns.items():
        width = next((len(row) for row in rows if row is not None), None)
        if width is not None:
            unknown = np.full(width, np.nan)
            rows = [unknown if row is None else row for row in rows]
            yield name, np.array(rows, _FIELDS[name])


def _encoded(array: np.ndarray) -> bytes:
    """Compress an array, shape (n, width)."""
    bits = array.view(f"u{array.itemsize}")
    for _ in range(2):
        bits = np.concatenate([bits[:1], bits[1:] - bits[:-1]])
    planes = bits.view(np.uint8).reshape(*array.shape, array.itemsize)
    return zlib.compress(planes.transpose(2, 1, 0).tobytes(), 1)


def _decoded(data: bytes, n: int, kind: type) -> np.ndarray:
    """Return an array, shape (n, width)."""
    size = np.dtype(kind).itemsize
    planes = np.array(bytearray(zlib.decompress(data)), np.uint8).reshape(size, -1, n)
    bits = planes.transpose(2, 1, 0).copy().view(f"u{size}")[..., 0]
    for _ in range(2):
        bits = np.cumsum(bits, axis=0, dtype=bits.dtype)
    return bits.view(kind)


def _known(array: np.ndarray | None, row: int) -> np.ndarray | None:
    """Return a row, or None if it is unknown."""
    if array is None or np.isnan(array[row]).all():
        return None
    return array[row]
