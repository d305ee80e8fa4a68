"""Tables of BONES-SEED and the SOMA retargeter: named columns, cm and degrees.

``Frame, root_translateX .. Z, root_rotateX .. Z, NAME_dof``; turns are about the fixed
axes x, y, z, in this order. Traps:

- The header does not give units: with metres and radians the base would be on the
  floor, and no joint would turn.
- Files of the AgiBot X2 look alike, with other joints in another order: names count.
- The rate is not in the file: 120 Hz in BONES-SEED, that of the source from SOMA.
"""

from __future__ import annotations

import numpy as np

from g1_description.errors import MotionError
from g1_description.motion.files import table
from g1_description.motion.files.format import Format, Writer, even_writer
from g1_description.motion.files.source import MotionSource
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description
from g1_description.robot.rotation import axes_to_rpy, from_rpy, to_axes
from g1_description.text import listed

FRAME = "Frame"
PLACE = tuple(f"root_translate{axis}" for axis in "XYZ")
TURN = tuple(f"root_rotate{axis}" for axis in "XYZ")
JOINT = "_dof"
"""Suffix of the columns of joints."""

USUAL_RATE = 120.0
"""Rate of BONES-SEED in [Hz]."""

CM = 0.01

LOWEST = 3.0
"""A base whose centre is never higher, in [cm], is not that of a robot."""

STILL = 3.2
"""Joints that turn by no more, in [deg], may be in radians."""


def recognise(source: MotionSource) -> bool:
    """Return whether a file is text with such a header."""
    names = table.header(source)
    return PLACE[0] in names and any(name.endswith(JOINT) for name in names)


def read(source: MotionSource, robot: Description) -> Motion:
    """Read a motion.

    Raises:
        MotionError: If columns are missing, or it is not in cm and degrees.
    """
    header, values = table.headed(source)
    table.check_once(1, header)
    columns = dict(zip(header, values.T))
    missing = [name for name in (*PLACE, *TURN) if name not in columns]
    if missing:
        raise MotionError(f"The header lacks {listed(missing)}.")
    joints = [name for name in columns if name.endswith(JOINT)]
    place = np.stack([columns[name] for name in PLACE], axis=1)
    turn = np.stack([columns[name] for name in TURN], axis=1)
    degrees = np.stack([columns[name] for name in joints], axis=1)
    notes = _check_units(place, degrees)
    base = np.concatenate([CM * place, from_rpy(np.radians(turn))], axis=1)
    names = tuple(name[: -len(JOINT)] for name in joints)
    times = np.arange(len(base), dtype=float)
    angles = np.radians(degrees)
    return Motion(times, names, angles, None, base, notes, has_times=False)


def _check_units(place: np.ndarray, degrees: np.ndarray) -> tuple[str, ...]:
    """Check that numbers can be cm and degrees; report angles that could be radians."""
    highest, widest = place[:, 2].max(), np.abs(degrees).max()
    if abs(highest) < LOWEST:
        raise MotionError(
            f"The base is at most {highest:.2f} cm high: this looks like metres. "
            "Columns of this format are in cm and degrees."
        )
    if 0.0 < widest < STILL:
        return (
            f"No joint turns by more than {widest:.2f} degrees: if the columns are in "
            "radians, convert them to degrees.",
        )
    return ()


def _content(motion: Motion, base: np.ndarray, robot: Description, fps: float) -> bytes:
    """Write a motion of all joints of the robot."""
    turns = axes_to_rpy(to_axes(base[:, 3:]))
    values = [base[:, :3] / CM, np.degrees(turns), np.degrees(motion.positions)]
    names = [*PLACE, *TURN, *(name + JOINT for name in motion.joint_names)]
    header, *rows = table.rows_text(np.concatenate(values, axis=1), names).split("\n")
    lines = [f"{FRAME},{header}", *(f"{n},{row}" for n, row in enumerate(rows[:-1]))]
    return "\r\n".join([*lines, ""]).encode()


FORMAT = Format(
    "bones_seed",
    recognise,
    read,
    (".csv",),
    assumed_rate=USUAL_RATE,
    rate_of="the rate of BONES-SEED",
    is_text=True,
    writers={"bones_seed": Writer(".csv", even_writer(_content), USUAL_RATE)},
)
