"""A numeric npy with the columns of a table without a header: AMASS for the G1.

Place, quaternion x y z w and joints, as in the LAFAN1 retargeting set. Traps: it has
neither names nor a rate, which is at most in the file's name (``_120_jpos.npy``).
"""

from __future__ import annotations

import numpy as np

from g1_description.errors import MotionError
from g1_description.motion.files import table
from g1_description.motion.files.arrays import NPY
from g1_description.motion.files.source import MotionSource
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description

ENDINGS = (".npy",)

USUAL_RATE = 120.0
"""Rate in [Hz] that the names of most files of the set have."""


def recognise(source: MotionSource) -> bool:
    """Return whether a file is a numeric npy with rows."""
    values = source.arrays[NPY] if [*source.arrays] == [NPY] else None
    return isinstance(values, np.ndarray) and values.ndim == 2


def read(source: MotionSource, robot: Description) -> Motion:
    """Read a motion.

    Raises:
        MotionError: If the array has a wrong shape, or the order of the quaternion
            cannot be told.
    """
    values = source.arrays.numbers(NPY, None, None)
    if values.shape[1] <= len(table.BASE):
        raise MotionError(
            f"The array has {values.shape[1]} columns; expected x y z, quaternion x y "
            "z w and joints."
        )
    return table.unnamed(
        source, values, robot, USUAL_RATE, "the usual rate of AMASS for the G1"
    )
