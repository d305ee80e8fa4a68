"""The history of each robot of the bridge: commands, and its services."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rospy
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, MultiDOFJointTrajectory

from g1_description.bridge.parameters import RobotParameters, topic_of
from g1_description.bridge.recorded_bag import write_bag
from g1_description.bridge.recorded_file import BAG, ENDINGS, write_motion_file
from g1_description.bridge.status import RobotStatus
from g1_description.errors import G1DescriptionError, InvalidValueError
from g1_description.files.atomic import whole_file
from g1_description.motion.files.history_bag import RECEIVED
from g1_description.motion.files.recordings import most_samples
from g1_description.motion.history import gaps_text
from g1_description.motion.history_chunks import Stretch
from g1_description.robot.poses import user_file
from g1_description.ros.conversions import stamp_from_ns
from g1_description.ros.history import answer_from_stretch, commands_to_messages
from g1_description.srv import (
    GetHistory,
    GetHistoryRequest,
    GetHistoryResponse,
    SaveHistory,
    SaveHistoryRequest,
    SaveHistoryResponse,
)
from g1_description.text import listed

MAX_STATES = 5000
"""Most states in an answer: 5 MB of the G1."""

MAX_NAMES = 3
"""Most joints that are named in a command; of more, their number is."""

KEPT = 3
"""Bags of ended bridges that are kept."""


class HistoryServices:
    """Answers requests for the history of one robot.

    Services: get_history (g1_description/GetHistory), save_history
        (g1_description/SaveHistory)
    """

    def __init__(self, robot: RobotParameters, status: RobotStatus) -> None:
        self._status = status
        for name, kind, handler in (
            ("get_history", GetHistory, self._get),
            ("save_history", SaveHistory, self._save),
        ):
            rospy.Service(topic_of(robot, name), kind, handler)

    def _get(self, request: GetHistoryRequest) -> GetHistoryResponse:
        """Answer with states and commands."""
        try:
            where = self._range(request, request.as_of.to_nsec())
            stretch = self._stretch(*where, request.max_samples, MAX_STATES)
        except G1DescriptionError as error:
            return GetHistoryResponse(success=False, status_message=str(error))
        run, begin, end = where
        history, newest = self._status.history, int(stretch.stamps[-1])
        runs = history.runs()
        first, last = runs.get(run, (begin, end))
        answer = answer_from_stretch(stretch, self._status.name)
        answer.success, answer.status_message = True, self._note(stretch, where)
        answer.first_run, answer.last_run = min(runs), max(runs)
        answer.first, answer.last = stamp_from_ns(first), stamp_from_ns(last)
        is_full = len(stretch.stamps) + stretch.others == MAX_STATES
        answer.is_complete = not is_full or newest >= min(end, last)
        if not answer.is_complete:
            end = newest
        if not request.without_commands:
            span = begin, end, run, request.command_positions
            answer.commands = commands_to_messages(history.commands(*span))
        return answer

    def _save(self, request: SaveHistoryRequest) -> SaveHistoryResponse:
        """Write states to a file."""
        path = Path(request.file)
        try:
            if not path.is_absolute() or path.suffix.lower() not in ENDINGS:
                raise InvalidValueError(
                    "file must be an absolute path that ends in "
                    f"{' or '.join(ENDINGS)} (got '{request.file}')."
                )
            if path.exists() and not request.overwrite:
                raise InvalidValueError(
                    f"The file {path} already exists; set overwrite to replace it."
                )
            where = self._range(request)
            stretch = self._stretch(*where, 0, 0)
            motion = stretch.motion()
            notes = write_motion_file(
                path,
                motion,
                self._status.description,
                begin=int(stretch.stamps[0]),
            )
        except G1DescriptionError as error:
            return SaveHistoryResponse(success=False, status_message=str(error))
        message = " ".join(filter(None, (*notes, self._note(stretch, where))))
        return SaveHistoryResponse(True, message, len(motion.times), motion.duration)

    def _range(self, request: Any, as_of: int = 0) -> tuple[int, int, int]:
        """Return the requested run, and begin and end in [ns]."""
        history, name = self._status.history, self._status.name
        if history is None:
            raise InvalidValueError(
                "The bridge keeps no history: its parameter ~history is 0."
            )
        if not history.runs():
            raise InvalidValueError(f"The bridge has had no state of {name} yet.")
        newest = history.newest(as_of) if as_of else (request.run or history.run, 0)
        if newest is None:
            ago = 1e-9 * (time.time_ns() - as_of)
            raise InvalidValueError(
                f"No state of {name} from {ago:.1f} s ago is known."
            )
        run = newest[0]
        first, last = self._span(run)
        last = newest[1] or last
        if not 0.0 <= request.last < np.inf:
            raise InvalidValueError(f"last must be at least 0 s (got {request.last}).")
        begin, end = request.begin.to_nsec() or first, request.end.to_nsec() or last
        if request.last:
            begin, end = max(first, last - round(1e9 * request.last)), last
        if begin > end:
            raise InvalidValueError(
                f"begin must not be later than end (got {1e-9 * begin:.3f} s and "
                f"{1e-9 * end:.3f} s)."
            )
        return run, begin, end

    def _span(self, run: int) -> tuple[int, int]:
        """Return the first and last stamp of a run in [ns]."""
        runs = self._status.history.runs()
        if run not in runs:
            raise InvalidValueError(
                f"run must be from {min(runs)} to {max(runs)}, or 0 (got {run}); "
                "a bridge that was restarted begins with 1 again."
            )
        return runs[run]

    def _stretch(
        self, run: int, begin: int, end: int, most: int, limit: int
    ) -> Stretch:
        """Return states of a range, as ``History.stretch`` does."""
        found = self._status.history.stretch(begin, end, most, limit, run)
        if found is None:
            first, last = (1e-9 * stamp for stamp in self._span(run))
            raise InvalidValueError(
                f"There is no state from {1e-9 * begin:.3f} s to {1e-9 * end:.3f} s; "
                f"those of run {run} are from {first:.3f} s to {last:.3f} s."
            )
        return found

    def _note(self, stretch: Stretch, where: tuple[int, int, int]) -> str:
        """Describe what an answer lacks; ``where`` is the run, and its range."""
        run, begin, end = where
        missing = gaps_text(self._status.history.gaps(begin, end, run))
        if not stretch.others:
            return missing
        ignored = (
            f"Ignored {stretch.others} states with other joints than the last one."
        )
        return f"{missing} {ignored}".strip()


def last_bag(namespace: str) -> Path:
    """Return the bag with the history of a robot whose bridge has ended."""
    parts = ["last", *filter(None, namespace.split("/"))]
    return user_file().with_name("_".join(parts) + BAG)


def written(path: Path) -> str:
    """Return when a file was written, in local time."""
    return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(path.stat().st_mtime))


def announce_last_bag(robot: RobotParameters) -> None:
    """Log where the history of the bridge before is, if it has left one."""
    path = last_bag(robot.namespace)
    if path.is_file():
        rospy.loginfo(
            "The history of the bridge that ended at %s is in %s.", written(path), path
        )


def keep_last_bag(robot: RobotParameters, status: RobotStatus) -> None:
    """Write the newest run of a robot's history to a bag; the bags before are renamed.

    Raises:
        G1DescriptionError: If it cannot be written.
    """
    history = status.history
    runs = {} if history is None else history.runs()
    if history is None or not runs:
        return
    run = max(runs)
    first, last = runs[run]
    stretch = history.stretch(first, last + 1, run=run)
    assert stretch is not None, "there is a run"
    stretch = stretch.rows(slice(-most_samples(stretch.names, True), None))
    first = int(stretch.stamps[0])
    streams = history.commands(first, last, run, with_positions=True)
    commands = [
        (f"/{RECEIVED}", one.first.to_nsec(), one)
        for one in commands_to_messages(streams)
    ]
    path = last_bag(robot.namespace)
    with whole_file(path) as part:
        motion = stretch.motion()
        write_bag(part, motion, status.description, first, stretch, commands)
        names = [path, *(path.with_suffix(f".{n}{BAG}") for n in range(1, KEPT))]
        for older, newer in zip(names[:0:-1], names[-2::-1]):
            if newer.exists():
                newer.replace(older)


def joints_text(names: Sequence[str]) -> str:
    """Describe the joints of a command."""
    return listed(names) if len(names) <= MAX_NAMES else f"{len(names)} joints"


def motion_text(
    joints: JointTrajectory, base: MultiDOFJointTrajectory | None = None
) -> str:
    """Describe a motion."""
    moved = [joints_text(joints.joint_names)] if joints.points else []
    if base is not None and base.points:
        moved.append("base")
    if not moved:
        return "stop"
    points = joints.points or base.points
    return f"{' and '.join(moved)}, {points[-1].time_from_start.to_sec():.2f} s"


def last_positions(joints: JointTrajectory) -> dict[str, float]:
    """Return where a motion ends, in [rad] or [m] by joint."""
    if not joints.points:
        return {}
    return dict(zip(joints.joint_names, joints.points[-1].positions))


def record_joint_command(
    status: RobotStatus,
    message: JointState,
    accepted: Mapping[str, float],
    ignored: str,
) -> None:
    """Keep a command of joints; ``ignored`` says which part of it was, and why."""
    content = joints_text(message.name)
    if ignored:
        content = f"{content}; ignored: {ignored}"
    status.record(message, "joint_commands", content, accepted)
