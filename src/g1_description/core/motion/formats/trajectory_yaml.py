"""The YAML that ``rostopic echo`` prints of a trajectory_msgs/JointTrajectory."""

from __future__ import annotations

from typing import Any

import numpy as np
from ruamel.yaml import YAML

from g1_description.core.bounds import MAX_VALUE
from g1_description.core.errors import MotionError
from g1_description.core.motion.motion import Motion
from g1_description.core.motion.trajectory import Trajectory

MAX_JOINTS = 1000

MAX_TEXT = 5_000_000
"""Longest text, in characters: reading takes a second per million."""


def read_trajectory_yaml(text: str) -> Motion:
    """Read the first message of a text.

    Raises:
        MotionError: If it is no such message, with the line where it is no YAML.
    """
    if len(text) > MAX_TEXT:
        raise MotionError(
            f"The text has {len(text) / 1e6:.0f} million characters; there may be "
            f"{MAX_TEXT / 1e6:.0f}."
        )
    message = _message(text)
    if not isinstance(message, dict) or "points" not in message:
        raise MotionError("The text is no JointTrajectory: it has no points.")
    names = _list(message.get("joint_names"), "joint_names")
    if not all(type(name) is str for name in names) or len(names) > MAX_JOINTS:
        raise MotionError("The trajectory has no list of names as joint_names.")
    points = _list(message["points"], "points")
    if len(points) * len(names) > len(text):
        raise MotionError("The trajectory has more points than the text has numbers.")
    if not points or not all(isinstance(point, dict) for point in points):
        raise MotionError("The trajectory has no points.")
    return Motion(
        Trajectory(
            np.array([_time(point, number) for number, point in enumerate(points, 1)]),
            tuple(names),
            np.array(_columns(points, "positions", len(names))),
            _velocities(points, len(names)),
        )
    )


def _message(text: str) -> Any:
    """Read the first document."""
    try:
        return next(iter(YAML(typ="safe").load_all(text)), None)
    # Values that do not fit their tags raise whatever their conversion raises.
    except Exception as error:
        mark = getattr(error, "problem_mark", None)
        where = f"Line {mark.line + 1}" if mark else "The text"
        found = str(getattr(error, "problem", None) or error) or type(error).__name__
        problem = found.splitlines()[0][:200]
        raise MotionError(f"{where} cannot be read: {problem}.") from error


def _list(value: Any, what: str) -> list:
    """Check that something is a list."""
    if not isinstance(value, list):
        raise MotionError(f"The trajectory has no list of {what}.")
    return value


def _time(point: dict, number: int) -> float:
    """Read when a point is, in [s]."""
    found = point.get("time_from_start")
    found = found if isinstance(found, dict) else {}
    parts: list[Any] = [found.get(part) for part in ("secs", "nsecs")]
    if not all(type(part) is int and abs(part) <= MAX_VALUE for part in parts):
        raise MotionError(f"Point {number} has no time_from_start with secs and nsecs.")
    seconds, rest = parts
    return (seconds * 1_000_000_000 + rest) / 1e9


def _columns(points: list[dict], what: str, width: int) -> list[list[float]]:
    """Read the positions or velocities of all points."""
    found = []
    for number, point in enumerate(points, 1):
        values = _list(point.get(what), what)
        if len(values) != width:
            raise MotionError(
                f"Point {number} has {len(values)} {what}; there are {width} joints."
            )
        fits = (type(v) in (int, float) and abs(v) <= MAX_VALUE for v in values)
        if not all(fits):
            raise MotionError(f"Point {number} has {what} that are no numbers.")
        found.append(values)
    return found


def _velocities(points: list[dict], width: int) -> np.ndarray | None:
    """Read the velocities; None unless all points have some."""
    if not all(point.get("velocities") for point in points):
        return None
    return np.array(_columns(points, "velocities", width))
