"""Arrays of GMR, in a pickle or an npz: ``fps, root_pos, root_rot, dof_pos``.

Quaternions are x y z w, which is checked. TWIST2 and GMT use the same arrays.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from g1_description.motion.files.conventions import names_of_columns, w_last
from g1_description.motion.files.source import MotionSource
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description

ENDINGS = (".pkl", ".pickle", ".npz")

ARRAYS = ("fps", "root_pos", "root_rot", "dof_pos")


def recognise(source: MotionSource) -> bool:
    """Return whether a file has these arrays."""
    return {*ARRAYS} <= {*source.arrays}


def read(source: MotionSource, robot: Description) -> Motion:
    """Read a motion.

    Raises:
        MotionError: If an array has a wrong shape or content.
    """
    positions = source.arrays.numbers("dof_pos", None, None)
    n_samples = len(positions)
    places = source.arrays.numbers("root_pos", n_samples, 3)
    turns = source.arrays.numbers("root_rot", n_samples, 4)
    times, notes = source.arrays.times(n_samples)
    base = np.concatenate([places, turns], axis=1)
    names, of_names = names_of_columns(positions, robot)
    motion = Motion(times, names, positions, base_poses=base, notes=of_names)
    motion = w_last(motion, robot, source.order, is_told=True)
    return replace(motion, notes=(*motion.notes, *notes))
