"""The last minutes of a robot: its states and the commands to it, in bounded memory.

Times, positions and poses are kept to the last bit; velocities, twists and efforts as
float32.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from g1_description.motion.history_chunks import Chunk, Command, Stretch, joined
from g1_description.robot.state import RobotState

MAX_BYTES = 60_000_000
"""Most memory of a history."""

MAX_ARRIVALS = 10_000
"""Most wall times that are kept: of three minutes."""

MAX_GAP = 1_000_000_000
"""Commands further apart, in [ns], are not one stream."""

MISSING = 10
"""Usual steps from a state to the next one from which states are missing."""

STILL = 1000
"""States closer than this, in [ns], are of one instant: time is paused."""

MAX_SHOWN = 3
"""Most gaps that are named."""


@dataclass
class CommandStream:
    """Equal commands that followed each other, or a single one."""

    first: int
    """Stamp of the state before the first of them, in [ns]."""

    last: int
    count: int
    command: Command
    stamps: np.ndarray | None = None
    """Stamps of each, in [ns], shape (count,); as below, None unless requested."""

    positions: np.ndarray | None = None
    """Positions of ``command.names`` in [rad] or [m], before limits, of a motion its
    last ones, shape (count, n_names)."""


@dataclass(frozen=True, eq=False)
class HistoryPart:
    """States of a run, with the commands meanwhile."""

    stretch: Stretch
    commands: Sequence[CommandStream]
    """Empty unless they were requested."""

    first_run: int
    """Number of the oldest run that is kept."""

    last_run: int
    """Number of the newest run."""

    first: int
    """Stamp of the first state of the run that is kept, in [ns]."""

    last: int
    """Stamp of its last one, in [ns]."""

    note: str = ""
    """Names the states that are missing."""


def gaps_text(gaps: Sequence[tuple[int, int]]) -> str:
    """Describe where states are missing; empty if there is no gap."""
    longest = sorted(gaps, key=lambda gap: gap[0] - gap[1])[:MAX_SHOWN]
    spans = [f"{1e-9 * a:.3f} s to {1e-9 * b:.3f} s" for a, b in sorted(longest)]
    more = len(gaps) - len(spans)
    rest = f" and in {more} shorter gaps" if more else ""
    return f"No states from {', '.join(spans)}{rest}." if gaps else ""


class History:
    """Keeps the states of one robot, and the commands that it received.

    Several threads may add and read. Whole chunks are forgotten, the oldest first, when
    their simulated time, of all runs, or their memory exceeds the limits.
    """

    def __init__(self, seconds: float, max_bytes: int = MAX_BYTES) -> None:
        """Begin without states.

        Args:
            seconds: Simulated time that is kept, in [s].
            max_bytes: Memory that is used.
        """
        self._limit, self._max_bytes = round(1e9 * seconds), max_bytes
        self._lock = threading.Lock()
        self._chunks: deque[Chunk] = deque()
        self._unpacked: deque[Chunk] = deque()
        self._bytes = self._duration = 0  # of packed chunks
        self._last = -1
        self._arrivals: deque[tuple[int, int, int]] = deque(maxlen=MAX_ARRIVALS)
        """Wall times in [ns], with run and stamp of the last state."""
        self.run = 1
        """Number of the newest run."""

    def add(self, state: RobotState) -> None:
        """Add a state, unless it has the time of the last one.

        An earlier time begins a new run; the runs before it stay.
        """
        with self._lock:
            if state.stamp == self._last:
                return
            if state.stamp < self._last:
                self.run += 1
            chunk = self._chunks[-1] if self._chunks else None
            if chunk is None or not chunk.has_room_for(state, self.run):
                is_same = chunk is not None and chunk.run == self.run
                chunk = Chunk(
                    self.run,
                    state.names,
                    tuple(state.commanded),
                    self._last if is_same else state.stamp,
                )
                self._chunks.append(chunk)
                self._unpacked.append(chunk)
            chunk.add(state)
            self._last = state.stamp

    def add_command(self, command: Command, positions: Sequence[float] = ()) -> None:
        """Add a command at the time of the last state; ignored before the first.

        Args:
            command: The command.
            positions: Positions of its joints, in [rad] or [m].
        """
        with self._lock:
            if self._chunks:
                self._chunks[-1].add_command(command, positions)

    def pack(self) -> None:
        """Compress full chunks, and forget the oldest; to be called by one thread."""
        with self._lock:
            newest = self.run, self._last
            if self._chunks and (
                not self._arrivals or self._arrivals[-1][1:] != newest
            ):
                self._arrivals.append((time.time_ns(), *newest))
        while len(self._unpacked) > 1:
            chunk = self._unpacked[0]
            chunk.pack()
            with self._lock:
                self._unpacked.popleft()
                self._bytes += chunk.n_bytes
                self._duration += chunk.duration
                while (
                    self._bytes > self._max_bytes
                    or self._duration - self._chunks[0].duration > self._limit
                ):
                    oldest = self._chunks.popleft()
                    self._bytes -= oldest.n_bytes
                    self._duration -= oldest.duration

    @property
    def n_bytes(self) -> int:
        """Memory of the compressed chunks."""
        return self._bytes

    def newest(self, moment: int) -> tuple[int, int] | None:
        """Return run and stamp of the newest state at a wall time in [ns].

        It is as exact as ``pack`` is called often; None: there was none, or it is not
        known any more.
        """
        with self._lock:
            known = [(run, at) for when, run, at in self._arrivals if when <= moment]
        return known[-1] if known else None

    def runs(self) -> dict[int, tuple[int, int]]:
        """Return the first and last stamp in [ns] of each run by its number."""
        found: dict[int, tuple[int, int]] = {}
        for chunk in self._all_chunks():
            first, _ = found.get(chunk.run, (chunk.first, 0))
            found[chunk.run] = first, chunk.last
        return found

    def stretch(
        self,
        begin: int,
        end: int,
        max_states: int = 0,
        limit: int = 0,
        run: int = 0,
    ) -> Stretch | None:
        """Return the states from a time to another one.

        Args:
            begin: In [ns]; equal to ``end``: only the last state that is not later.
            end: In [ns].
            max_states: Of more, this many are taken, evenly; 0: all.
            limit: Of more, only the first are taken; 0: all.
            run: Number of the run; 0: the newest.

        Returns:
            The states; None if there are none.
        """
        if begin == end:  # it may be long before
            chunks = self._chunks_of(run, 0, end)[-1:]
        else:
            chunks = self._chunks_of(run, begin, end)
        each = [chunk.stamps() for chunk in chunks]
        stamps = np.concatenate([np.empty(0, np.int64), *each])
        last = int(np.searchsorted(stamps, end, "right"))
        first = last - 1 if begin == end else int(np.searchsorted(stamps, begin))
        if not 0 <= first < last:
            return None
        rows = np.arange(first, last)
        if 0 < max_states < len(rows):
            rows = rows[np.linspace(0, len(rows) - 1, max_states).round().astype(int)]
        rows = rows[: limit or None]
        ends = np.cumsum([len(one) for one in each])
        which = np.searchsorted(ends, rows, "right")
        begins = ends - [len(one) for one in each]
        return joined(
            [
                chunks[number].stretch(rows[which == number] - begins[number])
                for number in np.unique(which).tolist()
            ]
        )

    def gaps(self, begin: int, end: int, run: int = 0) -> list[tuple[int, int]]:
        """Find where states are missing, as when the machine is overloaded.

        Args:
            begin: In [ns].
            end: In [ns].
            run: Number of the run; 0: the newest.

        Returns:
            Stamps of the states before and after each gap, in [ns]; the first state may
            be before ``begin``.
        """
        chunks = self._chunks_of(run, 0, end)
        before = sum(chunk.last < begin for chunk in chunks)
        each = [chunk.stamps() for chunk in chunks[max(before - 1, 0) :]]
        stamps = np.concatenate([np.empty(0, np.int64), *each])
        steps = np.diff(stamps)
        if not (steps > STILL).any():
            return []
        is_long = steps > MISSING * np.median(steps[steps > STILL])
        rows = np.flatnonzero(is_long & (stamps[1:] > begin) & (stamps[1:] <= end))
        return [*zip(stamps[rows].tolist(), stamps[rows + 1].tolist())]

    def commands(
        self, begin: int, end: int, run: int = 0, with_positions: bool = False
    ) -> list[CommandStream]:
        """Return the commands from a time to another one, in [ns], by their first."""
        each: dict[Command, list[tuple[np.ndarray, np.ndarray]]] = {}
        for chunk in self._chunks_of(run, begin, end):
            for command, own, rows in chunk.commands(begin, end, with_positions):
                each.setdefault(command, []).append((own, rows))
        found = []
        for command, parts in each.items():
            stamps, positions = map(np.concatenate, zip(*parts))
            cuts = np.flatnonzero(np.diff(stamps) > MAX_GAP) + 1
            for own, rows in zip(np.split(stamps, cuts), np.split(positions, cuts)):
                stream = CommandStream(int(own[0]), int(own[-1]), len(own), command)
                if with_positions:
                    stream.stamps, stream.positions = own, rows
                found.append(stream)
        return sorted(found, key=lambda stream: stream.first)

    def _chunks_of(self, run: int, begin: int, end: int) -> list[Chunk]:
        """Return the chunks of a run that have a time of a range; 0: the newest run."""
        run = run or self.run
        return [
            chunk
            for chunk in self._all_chunks()
            if chunk.run == run and chunk.first <= end and begin <= chunk.last
        ]

    def _all_chunks(self) -> list[Chunk]:
        with self._lock:
            return list(self._chunks)
