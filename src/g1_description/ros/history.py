"""The history of a robot in messages, and asking its bridge for it."""

from __future__ import annotations

import posixpath
from collections.abc import Iterable

import numpy as np
import rospy

from g1_description.motion.history import CommandStream
from g1_description.motion.history_chunks import Stretch, joined
from g1_description.msg import ModelTrajectory, ReceivedCommands
from g1_description.ros.conversions import stamp_from_ns
from g1_description.ros.master import SERVICE_ERRORS
from g1_description.ros.waiting import NoAnswerError, RefusedError
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
    return [
        ReceivedCommands(
            stamp_from_ns(stream.first),
            stamp_from_ns(stream.last),
            stream.count,
            *stream.command,
        )
        for stream in streams
    ]


def fetch_history(seconds: float, namespace: str = "") -> tuple[Stretch, str]:
    """Ask a robot's bridge for its last states.

    Args:
        seconds: Their simulated time, in [s].
        namespace: Namespace of the robot's topics.

    Returns:
        The states, and a note on what is missing; may be empty.

    Raises:
        NoAnswerError: If there is no bridge.
        RefusedError: If it keeps no history, or has no state.
    """
    name = posixpath.join("/", namespace.strip("/"), "get_history")
    service = rospy.ServiceProxy(name, GetHistory, persistent=True)
    parts: list[Stretch] = []
    try:
        answer = _checked(service(last=seconds))
        parts.append(stretch_from_answer(answer))
        first, end, note = answer.first, answer.last, answer.status_message
        while not answer.is_complete:
            begin = stamp_from_ns(int(parts[-1].stamps[-1]) + 1)
            answer = _checked(service(begin=begin, end=end, run=answer.run))
            parts.append(stretch_from_answer(answer))
    except SERVICE_ERRORS as error:
        raise NoAnswerError(
            f"{name} does not answer; is a bridge running, and is the namespace right? "
            f"{error}"
        ) from error
    finally:
        service.close()
    kept = (end - first).to_sec()
    if seconds > kept:
        note = f"the history of the bridge has only {kept:.3f} s. {note}".strip()
    return joined(parts), note


def _checked(answer: GetHistoryResponse) -> GetHistoryResponse:
    """Return an answer that is a success.

    Raises:
        RefusedError: If it is not.
    """
    if not answer.success:
        raise RefusedError(answer.status_message)
    return answer


def _flat(array: np.ndarray | None) -> list[float]:
    """Return the rows of an array one after the other."""
    return [] if array is None else array.ravel().tolist()
