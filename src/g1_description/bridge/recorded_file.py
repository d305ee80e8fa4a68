"""Writing motions to files of any format, rosbags included."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from g1_description.errors import MotionError
from g1_description.files.atomic import whole_file, write_whole
from g1_description.motion.files import formats
from g1_description.motion.files.mcap_writer import write_mcap
from g1_description.motion.files.recordings import MIN_STAMP, most_samples
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description

BAG = ".bag"
STAMPED = (BAG, ".mcap")
"""Recordings, whose samples have stamps."""

ENDINGS = (*formats.WRITTEN, *STAMPED)


class Room(NamedTuple):
    """The capacity of a file."""

    samples: int
    is_even: bool
    """Whether samples are counted at evenly spaced times."""


def _bag(
    motion: Motion, robot: Description, _: float | None
) -> tuple[bytes, Sequence[str]]:
    """Write a bag as a format is written."""
    from g1_description.bridge.recorded_bag import write_bag  # needs ROS

    with TemporaryDirectory(prefix="g1_bag_") as folder:
        path = Path(folder, "motion.bag")
        write_bag(path, motion, robot, MIN_STAMP)
        return path.read_bytes(), ()


WRITERS: Mapping[str, formats.Writer] = {
    **formats.WRITERS,
    "bag": formats.Writer(BAG, _bag),
}
"""Formats that can be written, by name, with rosbags."""


def room_of(path: Path, joints: Sequence[str], has_base: bool) -> Room:
    """Find the capacity of a file that can be read again.

    Args:
        path: The file, in the format of its extension.
        joints: Names of the motion's joints.
        has_base: Whether it has a base.

    Raises:
        MotionError: If the format does not support the motion.
    """
    ending = path.suffix.lower()
    if ending in STAMPED:
        return Room(most_samples(joints, has_base or ending != BAG), False)
    return Room(formats.most_samples(ending, joints, has_base), ending == ".npz")


def write_motion_file(
    path: Path,
    motion: Motion,
    robot: Description,
    rate: float | None = None,
    begin: int = MIN_STAMP,
) -> tuple[str, ...]:
    """Write a motion, so that ``read_motion`` reads the same numbers.

    Args:
        path: The file, in the format of its extension; an existing one is replaced.
        motion: The motion.
        robot: The robot that moves.
        rate: Samples per second of an npz, in [Hz]; None: those of the motion.
        begin: Stamp of the first sample, in [ns], which recordings have; in a csv it
            is a comment.

    Returns:
        Messages on differences from the motion.

    Raises:
        MotionError: If the format does not support it.
        InvalidValueError: If the file cannot be written.
    """
    if path.suffix.lower() not in ENDINGS:
        raise MotionError(
            f"Unknown format of {path.name}: it must end in {' or '.join(ENDINGS)}."
        )
    if path.suffix.lower() not in STAMPED:
        files, notes = formats.contents(path, motion, robot, rate)
        for file, part in files.items():
            if path.suffix.lower() == ".csv" and begin != MIN_STAMP:
                part = f"# time 0 is {1e-9 * begin:.9f} s\n".encode() + part
            write_whole(file, part)
        return notes
    with whole_file(path) as part:
        if path.suffix.lower() == BAG:
            from g1_description.bridge.recorded_bag import write_bag  # needs ROS

            write_bag(part, motion, robot, begin)
        else:
            with part.open("wb") as stream:
                write_mcap(stream, motion, robot, begin)
    return ()
