"""Motions for AMP in JSON, often ``.txt``: ``FrameDuration`` and ``Frames``.

A frame of TienKung's converter is x y z, Euler angles about the moving axes x, y, z,
the joints without names, and the velocities of all these. Other programs put
quaternions and feet into ``Frames``: such rows do not fit a robot and are refused.
"""

from __future__ import annotations

import json

import numpy as np

from g1_description.errors import MotionError, cause
from g1_description.motion.files.conventions import names_of_columns
from g1_description.motion.files.mimickit import table
from g1_description.motion.files.source import MotionSource
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description
from g1_description.robot.rotation import from_axis_angle, multiply

ENDINGS = ()
"""None, as most text in folders is no motion: such files are to be named."""

MAX_TEXT = 15_000_000
"""Longest text, in characters: six minutes at 30 Hz."""

BEGIN = 1000
"""Characters in which the first keys must be."""

N_BASE = 6
"""Columns of the base, and of its velocities."""


def recognise(source: MotionSource) -> bool:
    """Return whether a file has such keys."""
    text = source.text
    return text is not None and '"FrameDuration"' in text[:BEGIN]


def read(source: MotionSource, robot: Description) -> Motion:
    """Read a motion.

    Raises:
        MotionError: If it is damaged, or its frames do not fit the robot.
    """
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
    frames = table(found.get("Frames"), "Frames")
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
