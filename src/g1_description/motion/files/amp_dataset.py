"""The dictionary of ami-iit's AMP data set in an npy: joints by name, fps.

``joints_list, joint_positions, root_position, root_quaternion, fps``. Rows are arrays
in lists; quaternions are x y z w.
"""

from __future__ import annotations

from g1_description.motion.files.arrays import Arrays
from g1_description.motion.files.gmr import read_arrays
from g1_description.motion.files.mimickit import table
from g1_description.motion.files.source import MotionSource
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description

ENDINGS = (".npy",)

ARRAYS = ("root_position", "root_quaternion", "joint_positions")


def recognise(source: MotionSource) -> bool:
    """Return whether a file has these arrays."""
    return {*ARRAYS, "joints_list"} <= {*source.arrays}


def read(source: MotionSource, robot: Description) -> Motion:
    """Read a motion.

    Raises:
        MotionError: If an array has a wrong shape or content.
    """
    found = dict(source.arrays)
    found.update({name: table(found[name], name) for name in ARRAYS})
    found["joint_names"] = found["joints_list"]
    return read_arrays(source, Arrays(found), robot, ARRAYS)
