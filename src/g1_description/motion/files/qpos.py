"""MuJoCo's configurations in an npz: ``qpos``, or holosoma's ``joint_pos``.

A row is x y z, quaternion w x y z and joints, perhaps followed by objects (x y z,
quaternion), which are ignored. Who writes what, and the traps:

- OmniRetarget has the quaternion before the place, under the same name; so the columns
  whose squares add up to 1 decide.
- holosoma's files for tracking call it ``joint_pos``; the 29 ``joint_names`` are fewer
  than its columns, and body 0 is the world.
- holosoma's converter takes ``fps`` for a period: below 1 a message says so.
- any4hdmi has names and rate of a whole folder in ``manifest.json`` above it.
- LocoMuJoCo and OpenTrack begin ``joint_names`` with the free joint, call the rate
  ``frequency``, and may have several motions, which begin at ``split_points``.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from g1_description.errors import MotionError
from g1_description.motion.files.arrays import Arrays
from g1_description.motion.files.bodies import bodies_in, find_base
from g1_description.motion.files.conventions import (
    base_of,
    layouts,
    names_of_columns,
)
from g1_description.motion.files.format import Format, Writer, even_writer, npz, number
from g1_description.motion.files.source import MotionSource, parsed
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description

QPOS, JOINT_NAMES, FREQUENCY = "qpos", "joint_names", "frequency"
TRACKED = ("joint_pos", JOINT_NAMES, "body_names")
"""Arrays of holosoma's files for tracking."""

SPLITS = "split_points"

MANIFEST = "manifest.json"

FREE = 7
"""Numbers of a free body: place and quaternion."""

MAX_OBJECTS = 10
"""Most objects behind unnamed joints."""

MAX_MOTIONS = 100_000
"""Most motions of a file."""

UNIT = 0.01
"""Tolerance of the length of a quaternion."""


def recognise(source: MotionSource) -> bool:
    """Return whether a file has such an array."""
    names = {*source.arrays}
    if QPOS in names:
        return QPOS not in source.arrays.holding()  # a motion may be called so
    return {*TRACKED} <= names and (
        source.arrays.numbers(TRACKED[0]).shape[1:]
        >= (len(source.arrays.names(JOINT_NAMES)) + FREE,)
    )


def names(source: MotionSource) -> tuple[str, ...]:
    """Number the motions of a file that has several.

    Raises:
        MotionError: If there are very many.
    """
    if SPLITS not in source.arrays:
        return ()
    count = len(source.arrays.numbers(SPLITS, None)) - 1
    if count > MAX_MOTIONS:
        raise MotionError(f"{SPLITS} has {count} motions; the limit is {MAX_MOTIONS}.")
    return tuple(map(str, range(count))) if count > 1 else ()


def read(source: MotionSource, robot: Description) -> Motion:
    """Read a motion.

    Raises:
        MotionError: If an array has a wrong shape or content.
    """
    arrays = source.arrays
    rows = arrays.numbers(QPOS if QPOS in arrays else TRACKED[0], None, None)
    speeds = _speeds(arrays, len(rows))
    several = names(source)
    if several or source.name is not None:
        part = _part(arrays, int(source.chosen(several)), len(rows))
        rows, speeds = rows[part], None if speeds is None else speeds[part]
    path = manifest_of(source)
    manifest = None if path is None else parsed(MotionSource(path).text, MANIFEST)
    base, rest, notes = _split(rows)
    joints, of_joints = _joints(source, manifest, rest, robot)
    n_joints = len(joints)
    n_objects = rest.shape[1] - n_joints
    if n_objects:
        of_joints += (
            f"Columns behind the joints, as of objects, are ignored: {n_objects}.",
        )
    positions = rest[:, :n_joints]
    velocities = None
    if speeds is not None and speeds.shape[1] >= FREE - 1 + n_joints:
        velocities = speeds[:, FREE - 1 : FREE - 1 + n_joints]
    notes = (*notes, *of_joints)
    poses = base_of(*base, source.options.order)
    bodies = bodies_in(arrays, len(rows))
    if bodies is not None:
        found = find_base(source, robot, bodies, positions, [joints], "wxyz", base)
        poses, notes = found.poses, (*notes, *found.notes)
    times = np.arange(float(len(rows)))
    motion = Motion(times, joints, positions, velocities, poses, notes)
    rate = FREQUENCY if FREQUENCY in arrays else "fps"
    if rate in arrays or manifest is None or "timestep" not in manifest:
        return arrays.timed(motion, rate)
    period = manifest.numbers("timestep").ravel()
    if period.size != 1 or not period[0] > 0.0:
        raise MotionError(f"The timestep of {MANIFEST} must be greater than 0.")
    return replace(motion, times=times * period[0])


def _speeds(arrays: Arrays, n_samples: int) -> np.ndarray | None:
    """Return the velocities: 6 of the base, then of the joints."""
    name = "qvel" if QPOS in arrays else "joint_vel"
    if name not in arrays or arrays.numbers(name).ndim != 2:
        return None
    return arrays.numbers(name, n_samples, None)


def _part(arrays: Arrays, which: int, n_samples: int) -> slice:
    """Return the rows of one of several motions."""
    begin, end = arrays.numbers(SPLITS, None)[which : which + 2].astype(int)
    if not 0 <= begin < end <= n_samples:
        raise MotionError(
            f"{SPLITS} has {begin} and {end}; they must increase up to {n_samples}."
        )
    return slice(begin, end)


def manifest_of(source: MotionSource) -> Path | None:
    """Find the manifest of a folder of any4hdmi, if there is one above the file."""
    if [*source.arrays] != [QPOS]:
        return None
    above = [*source.path.absolute().parents][:3]
    paths = [Path(folder, MANIFEST) for folder in above]
    return next((path for path in paths if path.is_file()), None)


def _split(
    rows: np.ndarray,
) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray, tuple[str, ...]]:
    """Split rows into places and turns of the base, and the rest; report doubts."""
    if rows.shape[1] < FREE:
        raise MotionError(
            f"A row has {rows.shape[1]} numbers; expected x y z, quaternion w x y z "
            "and joints."
        )
    base, rest = rows[:, :FREE], rows[:, FREE:]
    is_turn_last, is_turn_first = _is_turn(base[:, 3:]), _is_turn(base[:, :4])
    if is_turn_last:
        doubt = "qpos is read as place, then quaternion; both orders fit."
        notes = (doubt,) if is_turn_first else ()
        return (base[:, :3], base[:, 3:]), rest, notes
    if is_turn_first:
        return (base[:, 4:], base[:, :4]), rest, ()
    raise MotionError(
        "Neither columns 1 to 4 nor columns 4 to 7 are a quaternion of length 1: the "
        "base has no place and quaternion w x y z."
    )


def _is_turn(columns: np.ndarray) -> bool:
    """Return whether columns are quaternions."""
    lengths = np.sqrt((columns**2).sum(axis=1))
    return bool((np.abs(lengths - 1.0) < UNIT).all())


def _joints(
    source: MotionSource,
    manifest: Arrays | None,
    rest: np.ndarray,
    robot: Description,
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Name the joints, the first columns after the base."""
    arrays = source.arrays
    width = rest.shape[1]
    if JOINT_NAMES in arrays:
        named = arrays.names(JOINT_NAMES)
        if FREQUENCY in arrays or len(named) > width:
            named = named[1:]  # the first one is the free joint
    elif manifest is not None and "qpos_names" in manifest:
        named = manifest.names("qpos_names")[FREE:]
    else:
        n_joints = _count(rest, robot)
        return names_of_columns(source, rest[:, :n_joints], robot)
    if len(named) > width:
        raise MotionError(f"There are {len(named)} names of joints for {width}.")
    return named, ()


def _count(rest: np.ndarray, robot: Description) -> int:
    """Count the unnamed joints: others than those of a robot are objects."""
    width = rest.shape[1]
    for n_objects in range(min(width // FREE, MAX_OBJECTS) + 1):
        n_joints = width - FREE * n_objects
        try:
            layouts(n_joints, robot)
        except MotionError:
            continue
        objects = rest[:, n_joints:].reshape(len(rest), n_objects, FREE)
        if all(
            _is_turn(objects[:, number, 3:]) or _is_turn(objects[:, number, :4])
            for number in range(n_objects)
        ):
            return n_joints
    return width


def _content(motion: Motion, base: np.ndarray, robot: Description, fps: float) -> bytes:
    """Write ``qpos`` in MuJoCo's order, with ``fps`` and ``joint_names``."""
    order = [0, 1, 2, 6, 3, 4, 5]
    arrays = {
        QPOS: np.concatenate([base[:, order], motion.positions], axis=1),
        "fps": np.array(number(fps)),
        JOINT_NAMES: np.array(motion.joint_names, dtype=str),
    }
    return npz(arrays)


FORMAT = Format(
    "qpos",
    recognise,
    read,
    (".npz",),
    order="wxyz",
    assumed_rate=30.0,
    rate_of="the rate of OmniRetarget and any4hdmi",
    names=names,
    writers={"qpos": Writer(".npz", even_writer(_content))},
)
