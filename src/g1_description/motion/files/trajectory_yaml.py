"""A trajectory_msgs/JointTrajectory in YAML, as printed by ``rostopic echo``."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from g1_description.bounds import MAX_VALUE
from g1_description.errors import MotionError, NoMotionError, cause
from g1_description.motion.files.format import Format
from g1_description.motion.files.source import MotionSource
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description

MAX_JOINTS = 1000

MAX_TEXT = 3_000_000
"""Longest text, in characters: reading takes half a second per million."""

MAX_DEPTH = 20
"""Deepest nesting; a JointTrajectory has five levels."""

MAX_DIGITS = 40
"""Longest number, in characters."""


def recognise(source: MotionSource) -> bool:
    """Return whether a file is YAML, by its ending or its first keys."""
    text = source.text
    return text is not None and (
        source.ending in FORMAT.endings
        or bool(re.search(r"^joint_names:", text[:10_000], re.MULTILINE))
    )


def read(source: MotionSource, robot: Description) -> Motion:
    """Read the first message of a text.

    Raises:
        MotionError: If it is not such a message, with the line if it is not YAML.
        NoMotionError: If it is other YAML, without ``joint_names``.
    """
    text = source.text
    if not text or not text.strip():
        raise MotionError("The file is empty.")
    if len(text) > MAX_TEXT:
        raise MotionError(
            f"The text has {len(text) / 1e6:.0f} million characters; the limit is "
            f"{MAX_TEXT / 1e6:.0f}."
        )
    message = _message(text)
    if isinstance(message, str):
        raise MotionError("Not YAML of a JointTrajectory: expected keys and values.")
    found = message if isinstance(message, dict) else {}
    missing = [repr(key) for key in ("joint_names", "points") if key not in found]
    if missing:
        verb = "are" if len(missing) > 1 else "is"
        raise _refusal(text)(
            f"This is YAML, but not a JointTrajectory: {' and '.join(missing)} {verb} "
            "missing."
        )
    names = _list(message.get("joint_names"), "joint_names")
    if not all(type(name) is str for name in names) or len(names) > MAX_JOINTS:
        raise MotionError("joint_names must be a list of names.")
    points = _list(message["points"], "points")
    if not points or not all(isinstance(point, dict) for point in points):
        raise MotionError("The trajectory has no points.")
    return Motion(
        np.array([_time(point, number) for number, point in enumerate(points, 1)]),
        tuple(names),
        np.array(_columns(points, "positions", len(names))),
        np.array(_columns(points, "velocities", len(names)))
        if all(point.get("velocities") for point in points)
        else None,
    )


def _refusal(text: str) -> type[MotionError]:
    """Return the error class: does the text look like a damaged motion?"""
    return MotionError if re.search(r"\bjoint_names\b", text) else NoMotionError


def _message(text: str) -> Any:
    """Read the first document; scalars stay text."""
    from ruamel.yaml import YAML  # takes a tenth of the start of a bridge

    try:
        return _built(iter(YAML(typ="safe").parse(text)))
    except MotionError as error:
        raise _refusal(text)(str(error)) from error
    # Any error of the YAML library on damaged text.
    except Exception as error:
        mark = getattr(error, "problem_mark", None)
        where = f"Line {mark.line + 1}" if mark else "The text"
        problem = getattr(error, "problem", None)
        raise MotionError(
            f"{where} is not valid YAML: {problem or cause(error)}."
        ) from error


def _built(parsed: Iterator[Any]) -> Any:
    """Build dictionaries, lists and text from the events of a document.

    Not recursive, without anchors and merges: the run time is linear in the length.

    Raises:
        MotionError: If it is nested too deeply, or uses features that messages do not.
    """
    from ruamel.yaml import events

    outer: list[list] = []
    parts: list[Any] = []
    for event in parsed:
        if isinstance(event, events.DocumentEndEvent):
            break
        line = event.start_mark.line + 1
        if isinstance(event, events.AliasEvent) or getattr(event, "anchor", None):
            raise MotionError(
                f"Line {line} has an anchor or alias, which is not allowed."
            )
        if getattr(event, "tag", None):
            raise MotionError(f"Line {line} has a tag, which is not allowed.")
        if len(outer) > MAX_DEPTH:
            raise MotionError(f"Line {line} is nested {len(outer)} levels deep.")
        if isinstance(event, events.ScalarEvent):
            parts.append(event.value)
        elif isinstance(event, (events.MappingStartEvent, events.SequenceStartEvent)):
            outer.append(parts)
            parts = []
        elif isinstance(event, (events.MappingEndEvent, events.SequenceEndEvent)):
            found: Any = parts
            if isinstance(event, events.MappingEndEvent):
                if not all(type(key) is str for key in parts[::2]):
                    problem = "has a key that is not text"
                    raise MotionError(
                        f"The mapping that ends in line {line} {problem}."
                    )
                found = dict(zip(parts[::2], parts[1::2]))
            parts = outer.pop()
            parts.append(found)
    return parts[0] if parts else None


def _list(value: Any, label: str) -> list:
    """Check that a value is a list."""
    if not isinstance(value, list):
        raise MotionError(f"{label} must be a list.")
    return value


def _time(point: dict, number: int) -> float:
    """Read the time of a point, in [s]."""
    found = point.get("time_from_start")
    found = found if isinstance(found, dict) else {}
    parts: list[Any] = [found.get(part) for part in ("secs", "nsecs")]
    if not all(type(p) is str and re.fullmatch(r"-?[0-9]{1,18}", p) for p in parts):
        raise MotionError(
            f"Point {number} must have a time_from_start with secs and nsecs."
        )
    seconds, rest = map(int, parts)
    return (seconds * 1_000_000_000 + rest) / 1e9


def _columns(points: list[dict], field: str, width: int) -> list[list[float]]:
    """Read the positions or velocities of all points."""
    found = []
    for number, point in enumerate(points, 1):
        values = _list(point.get(field), field)
        if len(values) != width:
            raise MotionError(
                f"Point {number} must have {width} {field}, one per joint (got "
                f"{len(values)})."
            )
        row = [_number(value) for value in values]
        if not all(abs(value) <= MAX_VALUE for value in row):
            raise MotionError(f"The {field} of point {number} must be finite numbers.")
        found.append(row)
    return found


def _number(value: Any) -> float:
    """Read a number; NaN if it is not one."""
    if type(value) is not str or len(value) > MAX_DIGITS or "_" in value:
        return np.nan
    try:
        return float(value)
    except ValueError:
        return np.nan


FORMAT = Format("trajectory", recognise, read, (".yaml", ".yml"), is_text=True)
