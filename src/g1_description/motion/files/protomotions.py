"""ProtoMotions' files of torch.save: ``.motion`` of one motion, ``.pt`` of many.

Traps:

- Quaternions are x y z w, and body 0 is the root.
- A ``.pt`` has the samples of all motions in a row, from ``length_starts`` on, the
  period ``motion_dt`` instead of a rate, and names in ``motion_files``. A cached one
  has one motion with ``control_dt``.
- Its converters lift the body sample by sample, so a motion may differ in height from
  the file that it was made of.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from g1_description.errors import MotionError
from g1_description.motion.files.array_formats import Keys, read_arrays
from g1_description.motion.files.arrays import Arrays
from g1_description.motion.files.format import OPEN, Format
from g1_description.motion.files.source import MotionSource
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description

MOTION = ("dof_pos", "rigid_body_pos", "rigid_body_rot", "dof_vel")
CACHED = ("dof_pos", "body_pos", "body_rot", "dof_vel")
LIBRARY = ("dps", "gts", "grs", "dvs")
"""Names of joints, places and quaternions of bodies, and velocities, which may be
missing."""

STARTS, LENGTHS, PERIODS = "length_starts", "motion_num_frames", "motion_dt"


def recognise(source: MotionSource) -> bool:
    """Return whether a file has the arrays of one or many motions."""
    found = {*source.arrays}
    one = {"fps", *MOTION[:3]} <= found or {"control_dt", *CACHED[:3]} <= found
    return one or {*LIBRARY[:3], STARTS, LENGTHS, PERIODS} <= found


def names(source: MotionSource) -> Sequence[str]:
    """List the names of the motions in a library; a single one has none."""
    arrays = source.arrays
    if STARTS not in arrays:
        return ()
    count = len(arrays.numbers(STARTS, None))
    found = arrays.names("motion_files") if "motion_files" in arrays else ()
    return found if len(found) == count else [str(number) for number in range(count)]


def read(source: MotionSource, robot: Description) -> Motion:
    """Read the motion that is chosen, or the only one.

    Raises:
        MotionError: If none is chosen, or an array has a wrong shape or content.
    """
    arrays = source.arrays
    if STARTS in arrays:
        listed = names(source)
        arrays = _part(arrays, listed.index(source.chosen(listed)))
        keys = LIBRARY
    else:
        keys = MOTION if MOTION[1] in arrays else CACHED
    if "control_dt" in arrays:
        arrays = Arrays({**arrays, "fps": _rate(arrays.numbers("control_dt"))})
    return read_arrays(source, arrays, robot, Keys(*keys, has_bodies=True), OPEN)


def _part(arrays: Arrays, index: int) -> Arrays:
    """Cut one motion out of a library."""
    count = len(arrays.numbers(STARTS, None))
    start, length, period = (
        arrays.numbers(name, count)[index] for name in (STARTS, LENGTHS, PERIODS)
    )
    found = {"fps": _rate(period)}
    for key in LIBRARY:
        if key not in arrays:
            continue
        whole = arrays[key]
        if not isinstance(whole, np.ndarray) or not whole.ndim:
            raise MotionError(f"{key} must be an array.")
        if not 0 <= start <= start + length <= len(whole):
            raise MotionError(f"{key} has {len(whole)} samples; the motion needs more.")
        found[key] = whole[int(start) : int(start + length)]
    return Arrays(found)


def _rate(period: np.ndarray) -> np.ndarray:
    """Convert a period in [s] to a rate; of float32, six digits are certain."""
    seconds = np.asarray(period, dtype=float)
    if not np.all(seconds > 0.0):
        raise MotionError("The period of samples must be greater than 0.")
    return np.array([float(f"{1.0 / second:.6g}") for second in seconds.ravel()])


FORMAT = Format(
    "protomotions",
    recognise,
    read,
    (".motion", ".pt"),
    order=OPEN,
    names=names,
)
