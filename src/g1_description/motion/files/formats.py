"""Motions from files and to files: one table of formats.

A format is a module with ``recognise(source)``, which says by a file's content whether
it is of that format, ``read(source, robot)`` and ``ENDINGS``, which its files in
folders have. One that is written, too, has ``write(trajectory, robot, rate)`` and
``most_samples``, and the first of its ``ENDINGS`` tells it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import ModuleType

from g1_description.errors import MotionError
from g1_description.files.atomic import write_whole
from g1_description.motion.files import bag, beyond_mimic, gmr, table, trajectory_yaml
from g1_description.motion.files.source import MAX_FILE_SIZE, ZIP, MotionSource
from g1_description.motion.files.unnamed import check_radians
from g1_description.motion.motion import Motion, fitted
from g1_description.motion.trajectory import Trajectory
from g1_description.robot.description import Description
from g1_description.text import listed

FORMATS: Sequence[ModuleType] = (bag, beyond_mimic, gmr, trajectory_yaml, table)
"""The first one that recognises a file reads it; a table is any other text."""

ENDINGS = tuple(sorted({ending for module in FORMATS for ending in module.ENDINGS}))
"""What names of motions in folders end in; files that are named may have any name."""

WRITTEN: Mapping[str, ModuleType] = {
    module.ENDINGS[0]: module for module in (table, beyond_mimic)
}
"""Formats that are written, by the ending of the file's name."""

_COMPRESSED = (
    "A compressed file; if joblib wrote it, save the motion with pickle.dump or "
    "numpy.savez."
)
BINARY = {
    b"\x93NUMPY": "An npy file has no names: save all arrays of the motion with "
    "numpy.savez.",
    **dict.fromkeys((b"x\x01", b"x^", b"x\x9c", b"x\xda"), _COMPRESSED),
    **dict.fromkeys((b"\x1f\x8b", b"BZh", b"\xfd7zXZ"), _COMPRESSED),
}
"""Sentences on files that begin so: those of numpy, zlib, gzip, bz2 and xz."""


def read_motion(
    path: Path,
    robot: Description,
    rate: float | None = None,
    topic: str | None = None,
) -> Motion:
    """Read a motion of a robot from a file, whose format its content tells.

    Args:
        path: CSV, npz, pickle, YAML of a JointTrajectory, or rosbag.
        robot: The robot; joints that it does not have are left out, with a note.
        rate: Samples per second of a file without times.
        topic: Topic of a bag with the joints; None: the usual one.

    Raises:
        MotionError: If there is no such file, or no motion in it that fits.
    """
    source = MotionSource(path, rate, topic)
    try:
        module = _format(source)
        motion = module.read(source, robot)
        if rate is not None and motion.has_times:
            ignored = f"{rate:g} samples per second are ignored"
            notes = (*motion.notes, f"The file has its own times: {ignored}.")
            motion = replace(motion, notes=notes)
        motion = fitted(motion, robot)
        if module is not bag:  # ROS has radians
            check_radians(motion, robot)
    except MotionError as error:
        raise type(error)(f"{path.name}: {error}") from error
    return motion


def _format(source: MotionSource) -> ModuleType:
    """Find the module that reads a file.

    Raises:
        MotionError: If there is none.
    """
    if source.topic is not None and not bag.recognise(source):
        raise MotionError(f"Not a bag: it has no topic {source.topic}.")
    for module in FORMATS:
        if module.recognise(source):
            return module
    raise MotionError(_problem(source))


def _problem(source: MotionSource) -> str:
    """Say what a file may be that no format recognises."""
    names = list(map(str, source.arrays))
    if source.head.startswith(ZIP) and b".npy" not in source.data:
        if any(name.endswith("/data.pkl") for name in names):
            return "A PyTorch file; convert it to npz or CSV."
        return "A zip file without arrays: not an npz."
    if names:
        found = listed(names)
        for arrays in (beyond_mimic.ARRAYS, gmr.ARRAYS):
            missing = [name for name in arrays if name not in names]
            if len(missing) == 1:
                return f"{missing[0]} is missing; the file has {found}."
        known = f"{listed(beyond_mimic.ARRAYS)}, or {listed(gmr.ARRAYS)}"
        return f"The file has {found}; a motion has {known}."
    for begin, words in BINARY.items():
        if source.head.startswith(begin):
            return words
    return f"Unknown format: not an npz, pickle, rosbag or UTF-8 text{_line(source)}."


def _line(source: MotionSource) -> str:
    """Name the line where a file is not text, but for the first one."""
    try:
        source.data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = source.data.count(b"\n", 0, error.start) + 1
        return f" (see line {line})" if line > 1 else ""
    return ""


def write_motion(
    path: Path,
    trajectory: Trajectory,
    robot: Description,
    rate: float | None = None,
) -> tuple[str, ...]:
    """Write a motion; ``read_motion`` reads the same numbers.

    Args:
        path: The file, whose ending tells the format; one that is there is replaced.
        trajectory: The motion.
        robot: Whose motion it is.
        rate: Samples per second of an npz, in [Hz]; None: those of the motion.

    Returns:
        Messages on what is not as in the motion: an npz has samples at even times.

    Raises:
        MotionError: If the format cannot hold it, or no reader would take it.
        InvalidValueError: If the file cannot be written.
    """
    module = WRITTEN.get(path.suffix.lower())
    if module is None:
        raise MotionError(
            f"{path.name} ends in none of {', '.join(WRITTEN)}: its format is unknown."
        )
    content, notes = module.write(trajectory, robot, rate)
    if len(content) > MAX_FILE_SIZE:
        raise MotionError(
            f"{path.name} would have {len(content) / 1e6:.0f} MB; a motion has at most "
            f"{MAX_FILE_SIZE / 1e6:.0f} MB."
        )
    write_whole(path, content)
    return notes


def most_samples(ending: str, joints: Sequence[str], has_base: bool) -> int:
    """Return how many samples of a motion a file can have and be read again.

    Args:
        ending: One of ``WRITTEN``; samples of an npz are those at even times.
        joints: Names of the motion's joints.
        has_base: Whether it has a base.

    Raises:
        MotionError: If the format can hold none.
    """
    count: int = WRITTEN[ending].most_samples(joints, has_base, MAX_FILE_SIZE)
    if count < 1:
        raise MotionError(f"A {ending} can hold no motion of {len(joints)} joints.")
    return count
