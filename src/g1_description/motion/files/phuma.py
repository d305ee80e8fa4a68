"""Arrays of PHUMA: ``root_trans, root_ori, dof_pos, fps``, in the dictionary of an npy.

The npy holds one object, so its content is a pickle. Quaternions are x y z w. Clips are
chunks of 4 s that overlap by 0.5 s.
"""

from __future__ import annotations

from g1_description.motion.files.gmr import read_arrays
from g1_description.motion.files.source import MotionSource
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description

ENDINGS = (".npy",)

ARRAYS = ("root_trans", "root_ori", "dof_pos")


def recognise(source: MotionSource) -> bool:
    """Return whether a file has these arrays."""
    return {*ARRAYS} <= {*source.arrays}


def read(source: MotionSource, robot: Description) -> Motion:
    """Read a motion.

    Raises:
        MotionError: If an array has a wrong shape or content.
    """
    return read_arrays(source, source.arrays, robot, ARRAYS)
