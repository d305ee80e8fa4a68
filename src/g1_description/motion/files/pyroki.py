"""Arrays of pyroki's retargeting in an npz, as ProtoMotions reads them.

``base_frame_pos, base_frame_wxyz, joint_angles``; joints are in the order of the URDF.
Trap: ``fps`` may be missing.
"""

from __future__ import annotations

import numpy as np

from g1_description.motion.files.conventions import base_of, names_of_columns
from g1_description.motion.files.source import MotionSource
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description

ENDINGS = (".npz",)

ARRAYS = ("base_frame_pos", "base_frame_wxyz", "joint_angles")

USUAL_RATE = 30.0
"""Rate in [Hz] of files without one."""


def recognise(source: MotionSource) -> bool:
    """Return whether a file has these arrays."""
    return {*ARRAYS} <= {*source.arrays}


def read(source: MotionSource, robot: Description) -> Motion:
    """Read a motion.

    Raises:
        MotionError: If an array has a wrong shape or content.
    """
    arrays = source.arrays
    positions = arrays.numbers("joint_angles", None, None)
    places = arrays.numbers("base_frame_pos", len(positions), 3)
    turns = arrays.numbers("base_frame_wxyz", len(positions), 4)
    joints, notes = names_of_columns(source, positions, robot)
    base = base_of(places, turns, source.options.order)
    if "fps" in arrays:
        times, of_times = arrays.times(len(positions))
        notes += of_times
        return Motion(times, joints, positions, base_poses=base, notes=notes)
    times = np.arange(len(positions), dtype=float)
    motion = Motion(times, joints, positions, base_poses=base, notes=notes)
    return source.timed(motion, USUAL_RATE, "the usual rate of retargeted motions")
