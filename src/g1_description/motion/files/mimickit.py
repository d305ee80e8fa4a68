"""MimicKit's pickle: ``loop_mode``, ``fps`` and ``frames``, a list of lists of numbers.

A frame is x y z, the rotation vector of the base, and the joints without names. Each
number is a step of the pickle, so reading takes a second for some minutes.
"""

from __future__ import annotations

from array import array
from typing import Any

import numpy as np

from g1_description.errors import MotionError
from g1_description.motion.files.arrays import MAX_SIZE, Arrays
from g1_description.motion.files.conventions import names_of_columns
from g1_description.motion.files.source import MotionSource
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description
from g1_description.robot.rotation import from_rotation_vector

ENDINGS = (".pkl", ".pickle")

N_BASE = 6
"""Columns of the base."""


def recognise(source: MotionSource) -> bool:
    """Return whether a file has frames and a loop mode."""
    return {"frames", "loop_mode", "fps"} <= {*source.arrays}


def read(source: MotionSource, robot: Description) -> Motion:
    """Read a motion.

    Raises:
        MotionError: If the frames are not rows of numbers of equal length.
    """
    frames = table(source.arrays["frames"], "frames")
    if frames.shape[1] < N_BASE:
        raise MotionError(f"A frame must have at least {N_BASE} numbers.")
    names, notes = names_of_columns(source, frames[:, N_BASE:], robot)
    times, of_times = source.arrays.times(len(frames))
    base = np.concatenate([frames[:, :3], from_rotation_vector(frames[:, 3:6])], axis=1)
    positions = frames[:, N_BASE:]
    return Motion(times, names, positions, None, base, (*notes, *of_times))


def table(rows: Any, what: str) -> np.ndarray:
    """Convert a list of rows, or an array.

    Args:
        rows: Lists or arrays of numbers, as they were read.
        what: Their name, for the message.

    Returns:
        Finite numbers, shape (n_rows, n_columns).

    Raises:
        MotionError: If these are no rows of numbers of equal length.
    """
    if isinstance(rows, list):
        width = _length(rows[0]) if rows else 0
        if len(rows) * width > MAX_SIZE:
            raise MotionError(f"{what} has more than {MAX_SIZE} numbers.")
        values = array("d")
        for row in rows:
            if _length(row) != width:
                raise MotionError(f"{what} must be rows of equal length.")
            try:
                values.extend(row)
            except (TypeError, OverflowError):
                raise MotionError(f"{what} must contain numbers.") from None
        if not values:
            raise MotionError(f"{what} has no numbers.")
        rows = np.array(values).reshape(-1, width)
    return Arrays({what: rows}).numbers(what, None, None)


def _length(row: Any) -> int:
    """Return the length of a row; 0 if it is none."""
    is_row = isinstance(row, list) or (isinstance(row, np.ndarray) and row.ndim > 0)
    return len(row) if is_row else 0
