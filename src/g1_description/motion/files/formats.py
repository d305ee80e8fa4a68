"""The table of motion formats, and reading and writing by it.

A format is a module with ``recognise(source)``, which examines a file's content,
``read(source, robot)``, and ``ENDINGS``, the extensions of its files in folders. To be
written, it also has ``write(trajectory, robot, rate)`` and ``most_samples``; its files
have the first of these extensions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import ModuleType

from g1_description.errors import MotionError
from g1_description.files.atomic import write_whole
from g1_description.motion.files import bag, beyond_mimic, gmr, table, trajectory_yaml
from g1_description.motion.files.conventions import check_radians
from g1_description.motion.files.source import MAX_FILE_SIZE, ZIP, MotionSource
from g1_description.motion.motion import Motion, fitted
from g1_description.robot.description import Description
from g1_description.text import listed

FORMATS: Sequence[ModuleType] = (bag, beyond_mimic, gmr, trajectory_yaml, table)
"""The first one that recognises a file reads it; a table is any other text."""

ENDINGS = tuple(sorted({ending for module in FORMATS for ending in module.ENDINGS}))
"""Extensions of motions in folders; files that are given may have any name."""

WRITTEN: Mapping[str, ModuleType] = {
    module.ENDINGS[0]: module for module in (table, beyond_mimic)
}
"""Formats that can be written, by file extension."""

_COMPRESSED = (
    "Compressed files are not supported; if joblib wrote it, save the motion with "
    "pickle.dump or numpy.savez."
)
BINARY = {
    b"\x93NUMPY": "npy files are not supported; save all arrays of the motion with "
    "numpy.savez.",
    **dict.fromkeys((b"x\x01", b"x^", b"x\x9c", b"x\xda"), _COMPRESSED),
    **dict.fromkeys((b"\x1f\x8b", b"BZh", b"\xfd7zXZ"), _COMPRESSED),
}
"""Messages by first bytes: of numpy, zlib, gzip, bz2 and xz."""


def read_motion(
    path: Path,
    robot: Description,
    rate: float | None = None,
    topic: str | None = None,
) -> Motion:
    """Read a motion of a robot from a file; its format is detected by content.

    Args:
        path: CSV, npz, pickle, YAML of a JointTrajectory, or rosbag.
        robot: The robot; joints that it does not have are ignored, with a note.
        rate: Samples per second of a file without times.
        topic: Topic of the joints in a bag; None: the usual one.

    Raises:
        MotionError: If the file cannot be read, or its motion does not fit the robot.
    """
    source = MotionSource(path, rate, topic)
    try:
        module = _format(source)
        motion = module.read(source, robot)
        if rate is not None and motion.has_times:
            ignored = f"the rate of {rate:g} Hz is ignored"
            notes = (*motion.notes, f"The file has its own times: {ignored}.")
            motion = replace(motion, notes=notes)
        motion = fitted(motion, robot)
        if module is not bag:  # ROS uses radians
            check_radians(motion, robot)
    except MotionError as error:
        raise type(error)(f"{path.name}: {error}") from error
    return motion


def _format(source: MotionSource) -> ModuleType:
    """Find the format of a file.

    Raises:
        MotionError: If there is none.
    """
    if source.topic is not None and not bag.recognise(source):
        raise MotionError(f"Not a rosbag; the topic {source.topic} needs one.")
    for module in FORMATS:
        if module.recognise(source):
            return module
    raise MotionError(_problem(source))


def _problem(source: MotionSource) -> str:
    """Explain why no format recognises a file."""
    names = list(map(str, source.arrays))
    if source.head.startswith(ZIP) and b".npy" not in source.data:
        if any(name.endswith("/data.pkl") for name in names):
            return "PyTorch files are not supported; convert it to npz or CSV."
        return "Not an npz: a zip file without arrays."
    if names:
        found = listed(names)
        for arrays in (beyond_mimic.ARRAYS, gmr.ARRAYS):
            missing = [name for name in arrays if name not in names]
            if len(missing) == 1:
                return f"The array {missing[0]} is missing; the file has {found}."
        known = f"{listed(beyond_mimic.ARRAYS)}; or {listed(gmr.ARRAYS)}"
        return f"The file has {found}; expected {known}."
    for begin, words in BINARY.items():
        if source.head.startswith(begin):
            return words
    return f"Unknown format: not an npz, pickle, rosbag or UTF-8 text{_line(source)}."


def _line(source: MotionSource) -> str:
    """Name the first line that is not text, unless it is line 1."""
    try:
        source.data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = source.data.count(b"\n", 0, error.start) + 1
        return f" (see line {line})" if line > 1 else ""
    return ""


def write_motion(
    path: Path,
    trajectory: Motion,
    robot: Description,
    rate: float | None = None,
) -> tuple[str, ...]:
    """Write a motion, so that ``read_motion`` reads the same numbers.

    Args:
        path: The file, in the format of its extension; an existing one is replaced.
        trajectory: The motion.
        robot: Whose motion it is.
        rate: Samples per second of an npz, in [Hz]; None: those of the motion.

    Returns:
        Messages on differences from the motion: an npz has evenly spaced times.

    Raises:
        MotionError: If the format does not support it, or it is too large.
        InvalidValueError: If the file cannot be written.
    """
    module = WRITTEN.get(path.suffix.lower())
    if module is None:
        raise MotionError(
            f"Unknown format of {path.name}: it must end in {' or '.join(WRITTEN)}."
        )
    content, notes = module.write(trajectory, robot, rate)
    if len(content) > MAX_FILE_SIZE:
        raise MotionError(
            f"{path.name} would have {len(content) / 1e6:.0f} MB; the limit is "
            f"{MAX_FILE_SIZE / 1e6:.0f} MB."
        )
    write_whole(path, content)
    return notes


def most_samples(ending: str, joints: Sequence[str], has_base: bool) -> int:
    """Return the largest number of samples of a file that can be read again.

    Args:
        ending: One of ``WRITTEN``; an npz counts evenly spaced samples.
        joints: Names of the motion's joints.
        has_base: Whether it has a base.

    Raises:
        MotionError: If the format does not support such a motion.
    """
    count: int = WRITTEN[ending].most_samples(joints, has_base, MAX_FILE_SIZE)
    if count < 1:
        raise MotionError(f"{ending} files cannot hold {len(joints)} joints.")
    return count
