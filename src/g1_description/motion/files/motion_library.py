"""Motion libraries of PHC's family (ASAP, PBHC, BFM-Zero, SONIC), by joblib.

A dictionary of motions by name; each has ``root_trans_offset``, ``root_rot``, ``dof``,
``pose_aa`` and ``fps``. Traps:

- ``root_rot`` is x y z w, though SONIC's documents say otherwise; flat feet show it.
- Joints have no names. ``pose_aa`` has axis times position of each, which tells ASAP's
  23 joints from Unitree's; behind them, ASAP and PBHC have three zeros for hands and
  head, SONIC none.
- ``fps`` may be missing: SONIC's reader assumes 30. Names may have blanks and slashes.
- Some files have one such motion without a name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from g1_description.motion.files.array_formats import Keys, read_arrays
from g1_description.motion.files.arrays import Arrays
from g1_description.motion.files.conventions import ASAP_JOINTS, layouts
from g1_description.motion.files.format import OPEN, Format, Writer, even_writer, number
from g1_description.motion.files.pickles import pickled, read_pickle
from g1_description.motion.files.source import MotionSource
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description
from g1_description.robot.rotation import from_rotation_vector, to_rotation_vector

KEYS = Keys("dof", "root_trans_offset", "root_rot")

W_FIRST = "Base quaternions are read as w x y z: only then do they agree with pose_aa."

SAME_TURN = 1.0 - 1e-4
"""Least product of two quaternions that are taken for the same turn."""

SAME_AXIS = 1e-3
"""Tolerance of axis times position, in [rad]."""

NAME = "motion"
"""Name of a motion that is written and has none."""


def recognise(source: MotionSource) -> bool:
    """Return whether a file has such motions."""
    return KEYS.places in source.arrays or bool(names(source))


def names(source: MotionSource) -> Sequence[str]:
    """List the names of the motions."""
    return source.arrays.holding(KEYS.places)


def read(source: MotionSource, robot: Description) -> Motion:
    """Read the motion that is chosen, or the only one.

    Raises:
        MotionError: If none is chosen, or an array has a wrong shape or content.
    """
    arrays = source.arrays
    if KEYS.places not in arrays:
        arrays = arrays.inside(source.chosen(names(source)))
    found = dict(arrays)
    if "dof" not in found and "dof_pos" in found:
        found["dof"] = found["dof_pos"]
    vectors = found.get("pose_aa")
    notes: tuple[str, ...] = ()
    if isinstance(vectors, np.ndarray) and vectors.ndim == 3:
        axes = arrays.numbers("pose_aa", None, None, 3)
        if "root_rot" not in found and axes.shape[1]:
            found["root_rot"] = from_rotation_vector(axes[:, 0])
        elif axes.shape[1] and _turned(source, found["root_rot"], axes[:, 0]):
            found["root_rot"] = found["root_rot"][:, [1, 2, 3, 0]]
            notes = (W_FIRST,)
        if not {*KEYS.names} & {*found}:
            positions = Arrays(found).numbers("dof", len(axes), None)
            named = _names(axes, positions, robot)
            found.update({"joint_names": named} if named else {})
    motion = read_arrays(source, Arrays(found), robot, KEYS, OPEN)
    return replace(motion, notes=(*motion.notes, *notes))


def _turned(source: MotionSource, turns: Any, vectors: np.ndarray) -> bool:
    """Return whether quaternions agree with rotation vectors only in w x y z.

    It is noted if they agree with them in one order.
    """
    is_array = isinstance(turns, np.ndarray) and turns.dtype.kind == "f"
    if (
        source.options.order is not None
        or not is_array
        or turns.shape != (len(vectors), 4)
    ):
        return False
    rotations = from_rotation_vector(vectors)
    agree = [
        np.abs((turns[:, order] * rotations).sum(axis=1)).min(initial=1.0) > SAME_TURN
        for order in ([0, 1, 2, 3], [1, 2, 3, 0])
    ]
    source.is_settled = any(agree)
    return agree == [False, True]


def _names(
    axes: np.ndarray, positions: np.ndarray, robot: Description
) -> tuple[str, ...] | None:
    """Name the joints by their axes; None if these are ambiguous.

    Args:
        axes: Rotation vectors of the root, the joints and more, shape (n, m, 3).
        positions: Positions of the joints, shape (n, n_joints).
        robot: The robot.
    """
    n_joints = positions.shape[1]
    known = {joint.name: joint.axis for joint in robot.movable_joints}
    fitting = []
    for order in layouts(n_joints, robot):
        rows = [number for number, name in enumerate(order) if name in known]
        if axes.shape[1] <= n_joints or not rows:
            continue
        turns = positions[:, rows, np.newaxis] * [known[order[row]] for row in rows]
        errors = np.abs(turns - axes[:, 1:][:, rows])
        fitting += [order] if errors.max() < SAME_AXIS else []
    return fitting[0] if len(fitting) == 1 else None


def _content(motion: Motion, base: np.ndarray, robot: Description, fps: float) -> bytes:
    """Write a library of one motion; float32, as upstream's."""
    positions = motion.positions
    n_samples, n_joints = positions.shape
    known = {joint.name: joint.axis for joint in robot.movable_joints}
    axes = np.reshape([known[name] for name in motion.joint_names], (n_joints, 3))
    n_more = 3 if motion.joint_names == ASAP_JOINTS else 0  # hands and head
    vectors = [
        to_rotation_vector(base[:, np.newaxis, 3:]),
        positions[..., np.newaxis] * axes,
        np.zeros((n_samples, n_more, 3)),
    ]
    entry = {
        "root_trans_offset": base[:, :3],
        "pose_aa": np.concatenate(vectors, axis=1),
        "dof": positions,
        "root_rot": base[:, 3:],
        "smpl_joints": np.zeros((n_samples, 24, 3)),  # required, but not used
    }
    content = {name: array.astype(np.float32) for name, array in entry.items()}
    name = motion.name or NAME
    return pickled({name: {**content, "fps": number(fps)}})


def merged(parts: Mapping[str, bytes]) -> bytes:
    """Make a library of several motions of libraries of one, by their new names."""
    entries = {
        name: next(iter(read_pickle(part).values())) for name, part in parts.items()
    }
    return pickled(entries)


FORMAT = Format(
    "motion_library",
    recognise,
    read,
    (".pkl", ".pickle", ".joblib"),
    order=OPEN,
    assumed_rate=30.0,
    rate_of="the rate of most such files",
    names=names,
    arrays=KEYS.needed,
    writers={
        "motion_library": Writer(
            ".pkl", even_writer(_content, has_velocities=False), merged=merged
        )
    },
)
