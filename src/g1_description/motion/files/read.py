"""A motion from a file, whose format is found by its content.

Of text the ending counts, too: ``.yaml`` is no table, and ``.npz`` is not whole.
"""

from __future__ import annotations

import re
import stat
from dataclasses import replace
from pathlib import Path

from g1_description.errors import MotionError
from g1_description.motion.files.arrays import READ, motion_of_arrays
from g1_description.motion.files.gmr_pickle import read_gmr_pickle
from g1_description.motion.files.npz import read_npz
from g1_description.motion.files.table import read_table
from g1_description.motion.files.trajectory_yaml import read_trajectory_yaml
from g1_description.motion.files.unnamed import check_radians
from g1_description.motion.motion import Motion, fitted
from g1_description.robot.description import Description

MAX_FILE_SIZE = 100_000_000
"""No motion has more, in bytes: an hour at 60 Hz, written as text, has less."""

BAG = b"#ROSBAG V"
NPY = b"\x93NUMPY"
GIT_LFS = b"version https://git-lfs."
COMPRESSED = (b"x\x01", b"x^", b"x\x9c", b"x\xda", b"\x1f\x8b", b"BZh", b"\xfd7zXZ")
"""Files of zlib, gzip, bz2 and xz begin so."""

YAML_ENDINGS = (".yaml", ".yml")

NO_TEXT = {".npz": "npz file", ".pkl": "pickle", ".pickle": "pickle", ".bag": "rosbag"}
"""What files with these endings are, whose text is never a table."""


def read_motion(path: Path, robot: Description, rate: float | None = None) -> Motion:
    """Read a motion of a robot from a file.

    Args:
        path: CSV, npz, pickle, or YAML of a JointTrajectory.
        robot: The robot; joints that it does not have are left out, with a note.
        rate: Samples per second of a file without times.

    Raises:
        MotionError: If there is no such file, or no motion in it that fits.
    """
    data = _data(path)
    try:
        motion = fitted(
            without_rate(_read(data, path.suffix.lower(), robot, rate), rate), robot
        )
        check_radians(motion, robot)
    except MotionError as error:
        raise type(error)(f"{path.name}: {error}") from error
    return motion


def without_rate(motion: Motion, rate: float | None) -> Motion:
    """Note that a given rate is of no use to a file with times."""
    if rate is None or not motion.has_times:
        return motion
    note = f"The file has its own times: {rate:g} samples per second are ignored."
    return replace(motion, notes=(*motion.notes, note))


def beginning(path: Path, size: int) -> bytes:
    """Read the first bytes of a file.

    Raises:
        MotionError: If there is no such file.
    """
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise MotionError(f"{path} is no file.")
        with path.open("rb") as file:
            return file.read(size)
    except (OSError, ValueError) as error:
        problem = getattr(error, "strerror", None) or error
        raise MotionError(f"{path} cannot be read: {problem}.") from error


def _data(path: Path) -> bytes:
    """Read a file of a size that a motion can have."""
    data = beginning(path, MAX_FILE_SIZE + 1)
    if len(data) > MAX_FILE_SIZE:
        raise MotionError(
            f"{path} has {path.stat().st_size / 1e6:.0f} MB; a motion has at most "
            f"{MAX_FILE_SIZE / 1e6:.0f} MB."
        )
    return data


def _read(data: bytes, ending: str, robot: Description, rate: float | None) -> Motion:
    """Read a motion in the format that the content shows; for text, the ending, too."""
    if data.startswith(BAG):
        raise MotionError("Rosbags are read by the commands that know ROS.")
    if data.startswith(b"PK"):
        return motion_of_arrays(read_npz(data, READ), robot)
    # Every protocol of a pickle ends in a full stop; all but the oldest begin so.
    if data.startswith(b"\x80"):
        return motion_of_arrays(read_gmr_pickle(data), robot)
    if data.startswith(NPY):
        raise MotionError(
            "An npy file has no names: save all arrays of the motion with numpy.savez."
        )
    if data.startswith(GIT_LFS):
        raise MotionError("The file itself is in Git LFS: run git lfs pull.")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise MotionError(_unknown(data, error.start)) from error
    if ending in NO_TEXT:
        raise MotionError(f"Not a whole {NO_TEXT[ending]}.")
    is_yaml = ending in YAML_ENDINGS
    if is_yaml or re.search(r"^joint_names:", text[:10_000], re.MULTILINE):
        return read_trajectory_yaml(text)
    return read_table(text, robot, rate)


def _unknown(data: bytes, place: int) -> str:
    """Say what a file may be that has a byte that is not text at a place."""
    if data.startswith(COMPRESSED):
        return (
            "A compressed file; if joblib wrote it, save the motion with pickle.dump "
            "or numpy.savez."
        )
    line = data.count(b"\n", 0, place) + 1
    where = f" (see line {line})" if line > 1 else ""
    return f"Unknown format: not an npz, pickle, rosbag or UTF-8 text{where}."
