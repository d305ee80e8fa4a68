"""The folder of motions that are saved on the page."""

from __future__ import annotations

import re
from pathlib import Path

from g1_description.errors import InvalidValueError
from g1_description.motion.files.formats import write_motion
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description
from g1_description.robot.poses import user_file

NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,99}(\.(csv|npz|bag|mcap))?")


def folder() -> Path:
    """Return the folder."""
    return user_file().parent / "motions"


def check_file_name(name: str) -> None:
    """Check the name of a file.

    Raises:
        InvalidValueError: If it is invalid.
    """
    if not NAME.fullmatch(name):
        raise InvalidValueError(
            f"Invalid file name: {name!r}. It must begin with a letter, have at most "
            "100 letters, digits, _ and -, and may end in .csv, .npz, .bag or .mcap."
        )


def save_motion(name: str, motion: Motion, robot: Description, begin: int = 1) -> Path:
    """Save a motion in the folder.

    Args:
        name: Of the file; without an extension it is a CSV.
        motion: The motion.
        robot: Whose motion it is.
        begin: Stamp of a recording's first sample, in [ns].

    Raises:
        G1DescriptionError: If there is one of that name, or it cannot be written.
    """
    check_file_name(name)
    file = folder() / (name if "." in name else f"{name}.csv")
    if file.exists():
        raise InvalidValueError(f"{file} already exists: choose another name.")
    file.parent.mkdir(parents=True, exist_ok=True)
    if file.suffix in (".bag", ".mcap"):  # with stamps
        from g1_description.bridge.recorded_file import write_motion_file

        write_motion_file(file, motion, robot, begin=begin)
    else:
        write_motion(file, motion, robot)
    return file
