"""The history of a robot in messages, and asking its bridge for it."""

from __future__ import annotations

import posixpath
import threading
from collections.abc import Iterable, Sequence
from contextlib import closing, suppress
from dataclasses import replace
from typing import Any

import numpy as np
import rospy

from g1_description.motion.files.history_bag import stream_from
from g1_description.motion.history import CommandStream, HistoryPart
from g1_description.motion.history_chunks import Stretch, joined
from g1_description.msg import ModelTrajectory, ReceivedCommands
from g1_description.ros.conversions import stamp_from_ns
from g1_description.ros.waiting import SERVICE_ERRORS, NoAnswerError, RefusedError
from g1_description.srv import GetHistory, GetHistoryResponse


def answer_from_stretch(stretch: Stretch, model: str) -> GetHistoryResponse:
    """Write states as the answer of get_history; the other fields are not set."""
    start = int(stretch.stamps[0])
    states = ModelTrajectory(
        model,
        stamp_from_ns(start),
        list(stretch.names),
        ((stretch.stamps - start) / 1e9).tolist(),
        _flat(stretch.positions),
        _flat(stretch.velocities),
        _flat(stretch.base_poses),
    )
    return GetHistoryResponse(
        run=stretch.run,
        states=states,
        base_twists=_flat(stretch.base_twists),
        efforts=_flat(stretch.efforts),
        commanded_names=list(stretch.commanded_names),
        commanded_positions=_flat(stretch.commanded),
        commanded_base_poses=_flat(stretch.commanded_bases),
    )


def stretch_from_answer(answer: GetHistoryResponse) -> Stretch:
    """Read the states of a successful answer of get_history."""
    states = answer.states
    times, names = np.array(states.times), tuple(states.joint_names)

    def rows(numbers: Iterable[float], width: int) -> np.ndarray | None:
        found = np.array(numbers, dtype=float)
        return found.reshape(len(times), width) if len(found) else None

    positions = np.array(states.positions, dtype=float)
    return Stretch(
        answer.run,
        states.start.to_nsec() + np.round(1e9 * times).astype(np.int64),
        names,
        tuple(answer.commanded_names),
        positions.reshape(len(times), len(names)),
        rows(states.velocities, len(names)),
        rows(states.base_poses, 7),
        rows(answer.base_twists, 6),
        rows(answer.efforts, len(names)),
        rows(answer.commanded_positions, len(answer.commanded_names)),
        rows(answer.commanded_base_poses, 7),
    )


def commands_to_messages(streams: Iterable[CommandStream]) -> list[ReceivedCommands]:
    """Convert commands."""
    found = []
    for stream in streams:
        sender, topic, content, names = stream.command
        first, last = stamp_from_ns(stream.first), stamp_from_ns(stream.last)
        message = ReceivedCommands(
            first, last, stream.count, sender, topic, content, [], [], []
        )
        if stream.stamps is not None:
            message.times = _flat(1e-9 * (stream.stamps - stream.first))
            message.joint_names = list(names)
            message.positions = _flat(stream.positions)
        found.append(message)
    return found


def _stream(message: ReceivedCommands) -> CommandStream:
    """Convert commands back."""
    return stream_from(message, message.first.to_nsec(), message.last.to_nsec())


SHORTLY = 60_000_000
"""Longest time in [ns] from the state before the requested one."""


class HistoryClient:
    """Asks a robot's bridge for its history; several threads do so in turn."""

    def __init__(self, service: str) -> None:
        """Create a client; nothing is requested yet.

        Args:
            service: Name of get_history.
        """
        self._name = rospy.resolve_name(service)
        self._service: rospy.ServiceProxy | None = None
        self._lock = threading.Lock()

    def part(
        self,
        begin: int = 0,
        end: int = 0,
        run: int = 0,
        max_states: int = 0,
        last: float = 0.0,
        as_of: int = 0,
        with_commands: bool = False,
        with_positions: bool = False,
    ) -> HistoryPart:
        """Ask for the states of a range, 5000 at most.

        Args:
            begin: In [ns]; 0: from the first on. Equal to ``end``: only the last state
                that is not later.
            end: In [ns]; 0: to the newest.
            run: Number of the run; 0: the newest.
            max_states: Of more, this many are taken, evenly; 0: all.
            last: Length of the range up to the newest state, in [s]; 0: another one.
            as_of: Wall time in [ns] at which the newest state is meant; 0: now.
            with_commands: Whether to request the commands meanwhile, too.
            with_positions: Whether to request the positions of each.

        Raises:
            NoAnswerError: If there is no bridge.
            RefusedError: If it keeps no history, or has no such state.
        """
        answer = self._request(
            last=last,
            as_of=stamp_from_ns(as_of),
            begin=stamp_from_ns(begin),
            end=stamp_from_ns(end),
            max_samples=max_states,
            run=run,
            without_commands=not with_commands,
            command_positions=with_positions,
        )
        return _part(answer)

    def at(self, stamp: int, run: int = 0) -> HistoryPart:
        """Ask for the last state that is not later than a time, or for the first one.

        A state shortly before it comes first, if there is one.

        Args:
            stamp: In [ns].
            run: As of ``part``.

        Raises:
            NoAnswerError: If there is no bridge.
            RefusedError: If it keeps no history, or has no such run.
        """
        at = max(stamp, 1)  # zero would be the whole run
        for begin in (max(at - SHORTLY, 1), at):
            with suppress(RefusedError):
                return self.part(begin, at, run, max_states=2)
        return self.part(run=run, max_states=1)

    def after(self, stamp: int, end: int, run: int = 0) -> HistoryPart:
        """Ask for the first state between two times, as ``at`` does.

        Raises:
            NoAnswerError: If there is no bridge.
            RefusedError: If there is none.
        """
        found = self.part(stamp + 1, end, run, max_states=1)
        return self.at(int(found.stretch.stamps[0]), found.stretch.run)

    def commands(self, begin: int, end: int, run: int = 0) -> Sequence[CommandStream]:
        """Ask for the commands of a range with their positions.

        Arguments and errors are those of ``part``.
        """
        given = begin, end, run, 1
        return self.part(*given, with_commands=True, with_positions=True).commands

    def whole(
        self, begin: int = 0, end: int = 0, run: int = 0, last: float = 0.0
    ) -> HistoryPart:
        """Ask for all states of a range, in as many answers as it takes.

        Commands are left out.

        Args:
            begin: As of ``part``.
            end: As of ``part``.
            run: As of ``part``.
            last: As of ``part``.

        Raises:
            NoAnswerError: If there is no bridge.
            RefusedError: If it keeps no history, or has no such state.
        """
        answer = self._request(
            last=last,
            begin=stamp_from_ns(begin),
            end=stamp_from_ns(end),
            run=run,
            without_commands=True,
        )
        until = stamp_from_ns(end) if end else answer.last
        parts = [_part(answer)]
        while not answer.is_complete:
            newest = int(parts[-1].stretch.stamps[-1])
            answer = self._request(
                begin=stamp_from_ns(newest + 1),
                end=until,
                run=answer.run,
                without_commands=True,
            )
            parts.append(_part(answer))
        return replace(parts[0], stretch=joined([part.stretch for part in parts]))

    def _request(self, **request: Any) -> GetHistoryResponse:
        """Call the service; again, if the connection was of a bridge that has ended."""
        with self._lock:
            is_new = self._service is None
            while True:
                if self._service is None:
                    self._service = rospy.ServiceProxy(
                        self._name, GetHistory, persistent=True
                    )
                try:
                    answer = self._service(**request)
                except SERVICE_ERRORS as error:
                    self.close()
                    if is_new:
                        raise NoAnswerError(
                            f"{self._name} does not answer; is a bridge running, and "
                            f"is the namespace right? {error}"
                        ) from error
                    is_new = True
                else:
                    if not answer.success:
                        raise RefusedError(answer.status_message)
                    return answer

    def close(self) -> None:
        """Close the connection; the next question makes a new one."""
        if self._service is not None:
            self._service.close()
            self._service = None


def fetch_history(
    seconds: float, namespace: str = "", as_of: int = 0
) -> tuple[Stretch, str]:
    """Ask a robot's bridge for its last states.

    Args:
        seconds: Their simulated time, in [s].
        namespace: Namespace of the robot's topics.
        as_of: Wall time in [ns] at which the last of them was the newest; 0: now.

    Returns:
        The states, and a note on missing ones, or an empty one.

    Raises:
        NoAnswerError: If there is no bridge.
        RefusedError: If it keeps no history, or has no state.
    """
    with closing(_client(namespace)) as client:
        newest = client.part(last=1e-9, as_of=as_of).stretch
        end = int(newest.stamps[-1])
        found = client.whole(max(end - round(1e9 * seconds), 1), end, newest.run)
    kept, note = 1e-9 * (end - found.first), found.note
    if seconds > kept:
        note = f"the history of the bridge has only {kept:.3f} s. {note}".strip()
    return found.stretch, note


def fetch_commands(seconds: float, namespace: str = "") -> Sequence[CommandStream]:
    """Ask a robot's bridge for the last commands, with their positions.

    Arguments and errors are those of ``fetch_history``.
    """
    with closing(_client(namespace)) as client:
        return client.part(
            last=seconds, max_states=1, with_commands=True, with_positions=True
        ).commands


def _client(namespace: str) -> HistoryClient:
    """Return a client of a robot's bridge."""
    return HistoryClient(posixpath.join("/", namespace.strip("/"), "get_history"))


def _part(answer: GetHistoryResponse) -> HistoryPart:
    """Read a successful answer of get_history."""
    return HistoryPart(
        stretch_from_answer(answer),
        [*map(_stream, answer.commands)],
        answer.first_run,
        answer.last_run,
        answer.first.to_nsec(),
        answer.last.to_nsec(),
        answer.status_message,
    )


def _flat(array: np.ndarray | None) -> list[float]:
    """Return the rows of an array one after the other."""
    return [] if array is None else array.ravel().tolist()
