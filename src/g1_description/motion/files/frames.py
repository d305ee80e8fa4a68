"""Motions of frames, rows of numbers without names: MimicKit's, and AMP's in JSON.

A frame is x y z, three numbers of the turn, and the joints. Who writes what:

- MimicKit's pickle has ``loop_mode``, ``fps`` and ``frames``; the turn is a rotation
  vector. Each number is a step of the pickle, so reading takes a second for some
  minutes.
- TienKung's JSON, often ``.txt``, has ``FrameDuration`` and ``Frames``; the turn is
  Euler angles about the moving axes x, y, z, and the velocities of all these follow.
  Other programs put quaternions and feet into ``Frames``: such rows do not fit a robot
  and are refused.
"""

from __future__ import annotations

import json
from array import array
from typing import Any

import numpy as np

from g1_description.errors import MotionError, cause
from g1_description.motion.files.arrays import MAX_SIZE, Arrays
from g1_description.motion.files.conventions import names_of_columns
from g1_description.motion.files.format import Format
from g1_description.motion.files.source import MotionSource
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description
from g1_description.robot.rotation import (
    from_axis_angle,
    from_rotation_vector,
    multiply,
)

MAX_TEXT = 15_000_000
"""Longest text, in characters: six minutes at 30 Hz."""

BEGIN = 1000
"""Characters in which the first keys must be."""

N_BASE = 6
"""Columns of the base, and of its velocities."""


def _read_mimickit(source: MotionSource, robot: Description) -> Motion:
    """Read MimicKit's pickle."""
    frames = rows_of(source.arrays["frames"], "frames")
    if frames.shape[1] < N_BASE:
        raise MotionError(f"A frame must have at least {N_BASE} numbers.")
    names, notes = names_of_columns(source, frames[:, N_BASE:], robot)
    base = np.concatenate([frames[:, :3], from_rotation_vector(frames[:, 3:6])], axis=1)
    times = np.arange(float(len(frames)))
    motion = Motion(times, names, frames[:, N_BASE:], None, base, notes)
    return source.arrays.timed(motion)


def _read_amp_text(source: MotionSource, robot: Description) -> Motion:
    """Read TienKung's JSON."""
    text = source.text or ""
    if len(text) > MAX_TEXT:
        raise MotionError(
            f"The text has {len(text) / 1e6:.0f} million characters; the limit is "
            f"{MAX_TEXT / 1e6:.0f}."
        )
    try:
        # Integers as floating-point numbers: long ones take hours.
        found = json.loads(text, parse_int=float)
    except (ValueError, RecursionError) as error:
        raise MotionError(f"The text is not JSON: {cause(error)}.") from error
    period = found.get("FrameDuration") if isinstance(found, dict) else None
    if type(period) is not float or not 1e-6 < period < 1e6:
        raise MotionError("FrameDuration must be a number greater than 0.")
    frames = rows_of(found.get("Frames"), "Frames")
    n_joints, rest = divmod(frames.shape[1] - 2 * N_BASE, 2)
    if n_joints < 1 or rest:
        raise MotionError(
            f"A frame has {frames.shape[1]} numbers; expected x y z, three angles, the "
            "joints, and the velocities of all these."
        )
    positions = frames[:, N_BASE : N_BASE + n_joints]
    joints, notes = names_of_columns(source, positions, robot)
    roll, pitch, yaw = (
        from_axis_angle(np.eye(3)[i], frames[:, 3 + i]) for i in range(3)
    )
    turns = multiply(roll, multiply(pitch, yaw))
    base = np.concatenate([frames[:, :3], turns], axis=1)
    times = np.arange(len(frames)) * period
    return Motion(times, joints, positions, frames[:, -n_joints:], base, notes)


def rows_of(rows: Any, label: str) -> np.ndarray:
    """Convert a list of rows, or an array.

    Args:
        rows: Lists or arrays of numbers, as they were read.
        label: Their name, for the message.

    Returns:
        Finite numbers, shape (n_rows, n_columns).

    Raises:
        MotionError: If these are no rows of numbers of equal length.
    """
    if isinstance(rows, list):
        width = _length(rows[0]) if rows else 0
        if len(rows) * width > MAX_SIZE:
            raise MotionError(f"{label} has more than {MAX_SIZE} numbers.")
        values = array("d")
        for row in rows:
            if _length(row) != width:
                raise MotionError(f"{label} must be rows of equal length.")
            try:
                values.extend(row)
            except (TypeError, OverflowError):
                raise MotionError(f"{label} must contain numbers.") from None
        if not values:
            raise MotionError(f"{label} has no numbers.")
        rows = np.array(values).reshape(-1, width)
    return Arrays({label: rows}).numbers(label, None, None)


def _length(row: Any) -> int:
    """Return the length of a row; 0 if it is none."""
    is_row = isinstance(row, list) or (isinstance(row, np.ndarray) and row.ndim > 0)
    return len(row) if is_row else 0


MIMICKIT = Format(
    "mimickit",
    lambda source: {"frames", "loop_mode", "fps"} <= {*source.arrays},
    _read_mimickit,
    endings=(".pkl", ".pickle"),
    arrays=("frames", "loop_mode", "fps"),
)

# No endings, as most text in folders is no motion: such files are to be named.
AMP_TEXT = Format(
    "amp_text",
    lambda source: '"FrameDuration"' in (source.text or "")[:BEGIN],
    _read_amp_text,
    is_text=True,
)
