"""Motions to files, whose format is found by the name's ending."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from g1_description.errors import MotionError
from g1_description.files.atomic import write_whole
from g1_description.motion.files.npz import most_even_samples, npz_bytes
from g1_description.motion.files.read import MAX_FILE_SIZE
from g1_description.motion.files.table import most_rows, table_text
from g1_description.motion.trajectory import Trajectory
from g1_description.robot.description import Description

ENDINGS = (".csv", ".npz")


def write_motion(
    path: Path,
    trajectory: Trajectory,
    robot: Description,
    rate: float | None = None,
) -> tuple[str, ...]:
    """Write a motion; ``read_motion`` reads the same numbers.

    Args:
        path: The file; one that is there is replaced.
        trajectory: The motion.
        robot: Whose motion it is.
        rate: Samples per second of an npz, in [Hz]; None: those of the motion.

    Returns:
        Messages on what is not as in the motion: an npz has samples at even times.

    Raises:
        MotionError: If the format cannot hold it, or no reader would take it.
        InvalidValueError: If the file cannot be written.
    """
    notes: tuple[str, ...] = ()
    if path.suffix.lower() == ".npz":
        content, notes = npz_bytes(trajectory, robot, rate)
    elif path.suffix.lower() == ".csv":
        content = table_text(trajectory).encode()
    else:
        raise MotionError(
            f"{path.name} ends in none of {', '.join(ENDINGS)}: its format is unknown."
        )
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
        ending: One of ``ENDINGS``; samples of an npz are those at even times.
        joints: Names of the motion's joints.
        has_base: Whether it has a base.

    Raises:
        MotionError: If the format can hold none.
    """
    most = most_even_samples if ending == ".npz" else most_rows
    count = most(joints, has_base, MAX_FILE_SIZE)
    if count < 1:
        raise MotionError(f"A {ending} can hold no motion of {len(joints)} joints.")
    return count
