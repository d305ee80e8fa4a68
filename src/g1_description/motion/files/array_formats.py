"""Formats of arrays by name that differ in little more than the names.

A row of ``FORMATS`` says which arrays are the joints, the places and the quaternions:
of the base, or of bodies of which one is the base. Where a file is arranged in another
way, a function makes such arrays of it. Other formats read theirs by ``read_arrays``,
or have frames, rows of numbers without names.
"""

from __future__ import annotations

import json
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Callable, Mapping

import numpy as np

from g1_description.errors import MotionError, cause
from g1_description.motion.files.arrays import MAX_SIZE, Arrays
from g1_description.motion.files.bodies import (
    WORLD,
    Bodies,
    bodies_in,
    find_base,
    links_of,
)
from g1_description.motion.files.conventions import (
    ISAAC_JOINTS,
    base_of,
    isaac_joints,
    names_of_columns,
    w_last,
)
from g1_description.motion.files.format import OPEN, Format
from g1_description.motion.files.source import MotionSource, parsed
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description
from g1_description.robot.rotation import (
    from_axis_angle,
    from_rotation_vector,
    multiply,
)
from g1_description.text import listed


@dataclass(frozen=True)
class Keys:
    """Names of the arrays of a motion."""

    joints: str
    """Positions, shape (n_samples, n_joints)."""

    places: str
    """In [m], shape (n_samples, 3), or (n_samples, n_bodies, 3)."""

    turns: str
    """Quaternions, shape (n_samples, 4), or (n_samples, n_bodies, 4)."""

    velocities: str = ""
    """Velocities of the joints, where a file has them."""

    has_bodies: bool = False

    names: tuple[str, ...] = ("joint_names", "dof_names")
    """Names of the joints, the first of these that a file has."""

    links: str = ""
    """Names of the bodies; empty: the first one is the base."""

    rate: str = "fps"

    @property
    def needed(self) -> tuple[str, ...]:
        """The arrays that each file has."""
        return self.joints, self.places, self.turns

    @property
    def own(self) -> set[str]:
        """All arrays of numbers by sample."""
        return {*self.needed, self.velocities}


def read_arrays(
    source: MotionSource, arrays: Arrays, robot: Description, keys: Keys, order: str
) -> Motion:
    """Read a motion from arrays that differ only in their names.

    Args:
        source: The file.
        arrays: Arrays of the motion, with or without its rate.
        robot: The robot.
        keys: Their names.
        order: Order of the format's quaternions, xyzw or wxyz, or ``OPEN``.

    Raises:
        MotionError: If an array has a wrong shape or content, or no body is the base.
    """
    positions = arrays.numbers(keys.joints, None, None)
    n_samples, n_joints = positions.shape
    links = arrays.names(keys.links) if keys.links else None
    bodies = () if not keys.has_bodies else (None if links is None else len(links),)
    places = arrays.numbers(keys.places, n_samples, *bodies, 3)
    turns = arrays.numbers(keys.turns, *places.shape[:-1], 4)
    velocities = None
    if keys.velocities in arrays:
        velocities = arrays.numbers(keys.velocities, *positions.shape)
    named = [arrays.names(key) for key in keys.names if key in arrays]
    notes: tuple[str, ...] = ()
    if not named:
        joints, notes = names_of_columns(source, positions, robot)
    elif len(named[0]) == n_joints:
        joints = named[0]
    else:
        raise MotionError(f"There are {len(named[0])} names for {n_joints} joints.")
    if links is not None:
        if robot.root not in links:
            lacking = f"The bodies lack the base, {robot.root}: "
            raise MotionError(f"{lacking}{listed(links)}.")
        objects = [link for link in links if link not in (*robot.link_names, "")]
        ignored = f"Bodies that {robot.name} does not have are ignored: "
        notes += (f"{ignored}{listed(objects)}.",) if objects else ()
    if not places.shape[1]:
        raise MotionError(f"{keys.places} must have at least one body, the base.")
    usual = "xyzw" if order == OPEN else order
    base = None if keys.has_bodies else (places, turns)
    found = (
        Bodies(places, turns, links) if base is None else bodies_in(arrays, n_samples)
    )
    if found is not None and not source.is_settled:
        fitting = find_base(source, robot, found, positions, [joints], usual, base)
        poses, notes = fitting.poses, (*notes, *fitting.notes)
    else:
        poses = base_of(places, turns, source.options.order or usual)
    if not poses[:, :3].any() and WORLD not in notes:
        zeros = f"{keys.places} has only zeros for the root"
        notes += (f"{zeros}: the place of the base is unknown, and shown as 0.",)
    times = np.arange(float(n_samples))
    motion = Motion(times, joints, positions, velocities, poses, notes)
    motion = arrays.timed(motion, keys.rate)
    is_open = order == OPEN and not source.options.order and not source.is_settled
    return w_last(motion, robot, is_w_last=True) if is_open else motion


def array_format(
    name: str,
    keys: Keys,
    order: str,
    needed: Sequence[str] = (),
    arranged: Callable[[MotionSource, Arrays, Description], Mapping[str, Any]]
    | None = None,
    has_several: bool = False,
    **others: Any,
) -> Format:
    """Make the record of a format of arrays.

    Args:
        name: Its name.
        keys: Names of its arrays.
        order: Order of its quaternions, xyzw or wxyz, or ``OPEN``.
        needed: Arrays by which its files are recognised; none: those of the keys.
        arranged: Makes arrays of these names of those of a file.
        has_several: Whether there are files of several motions by name.
        others: More of the record.
    """
    own = tuple(needed) or keys.needed

    def is_one(source: MotionSource) -> bool:
        return {*own} <= {*source.arrays}

    def names(source: MotionSource) -> Sequence[str]:
        return source.arrays.holding(*own) if has_several else ()

    def recognise(source: MotionSource) -> bool:
        return is_one(source) or bool(names(source))

    def read(source: MotionSource, robot: Description) -> Motion:
        arrays = source.arrays
        if has_several and not is_one(source):
            arrays = arrays.inside(source.chosen(names(source)))
        if arranged is not None:
            arrays = Arrays(arranged(source, arrays, robot))
        return read_arrays(source, arrays, robot, keys, order)

    record = {"recognise": recognise, "read": read, "names": names, **others}
    return Format(name, order=order, arrays=own, **record)


TRACKED = Keys(
    *("joint_pos", "body_pos_w", "body_quat_w", "joint_vel"),
    has_bodies=True,
    links="body_names",
)
"""Arrays of BeyondMimic, which other formats have with names from elsewhere."""

NPZ, META = "motion.npz", "meta.json"
"""Files of a folder of HDMI."""


def is_hdmi(source: MotionSource) -> bool:
    """Return whether a file is a folder of HDMI, or the npz in it."""
    folder = source.path if source.is_folder else source.path.absolute().parent
    if not (folder / META).is_file():
        return False
    if source.is_folder:
        return (folder / NPZ).is_file()
    return {*TRACKED.needed} <= {*source.arrays} and "fps" not in source.arrays


def _hdmi(source: MotionSource, _: Arrays, __: Description) -> Mapping[str, Any]:
    """Join the arrays with names and rate, which are in another file."""
    path = source.path / NPZ if source.is_folder else source.path.absolute()
    meta = parsed(MotionSource(Path(path.parent, META)).text, META)
    meta.names("joint_names")
    arrays = MotionSource(path).arrays
    return {**{name: arrays[name] for name in TRACKED.own & {*arrays}}, **meta}


def _deployed(
    source: MotionSource, arrays: Arrays, robot: Description
) -> Mapping[str, Any]:
    """Name the joints, and the bodies by their numbers, of which 0 is the root."""
    n_bodies = np.shape(arrays[TRACKED.places])[1:2]
    numbers = np.zeros(1)
    if "_body_indexes" in arrays:
        numbers = arrays.numbers("_body_indexes", *n_bodies)
    known = dict(enumerate(links_of(robot, ISAAC_JOINTS)))
    links = [known.get(int(number), "") for number in numbers]
    links += [""] * (sum(n_bodies) - len(links))
    return {**arrays, "joint_names": isaac_joints(source), "body_names": links}


AMI = Keys(
    *("joint_positions", "root_position", "root_quaternion"), names=("joints_list",)
)

FORMATS = (
    # HDMI: a folder. Joints are in MuJoCo's order in published files and in Isaac
    # Lab's from the recorder, so names count; bodies are some links and objects.
    array_format("hdmi", TRACKED, "wxyz", arranged=_hdmi, recognise=is_hdmi),
    # Isaac Lab's AMP motions (humanoid_amp, AMASS for the G1): joints and bodies are
    # any in any order, so names count.
    array_format(
        "isaac_amp",
        Keys(
            *("dof_positions", "body_positions", "body_rotations", "dof_velocities"),
            has_bodies=True,
            links="body_names",
        ),
        "wxyz",
        ("dof_names", "body_names", "dof_positions", "body_positions"),
        endings=(".npz",),
    ),
    # pyroki's retargeting, as ProtoMotions reads it: joints are in the order of the
    # URDF; the rate may be missing.
    array_format(
        "pyroki",
        Keys("joint_angles", "base_frame_pos", "base_frame_wxyz"),
        "wxyz",
        endings=(".npz",),
        assumed_rate=30.0,
        rate_of="the usual rate of retargeted motions",
    ),
    # SONIC's pickle for deployment, motions by name, from which its folders are made:
    # joints are in Isaac Lab's order; there are 14 of the bodies.
    array_format(
        "sonic_deploy",
        TRACKED,
        "wxyz",
        arranged=_deployed,
        has_several=True,
        recognise=lambda source: bool(source.arrays.holding(*TRACKED.needed)),
        endings=(".pkl", ".pickle"),
        assumed_rate=50.0,
        rate_of="the rate of SONIC's files",
    ),
    # PHUMA: the npy holds a pickled dictionary. Clips are chunks of 4 s that overlap by
    # 0.5 s.
    array_format(
        "phuma",
        Keys("dof_pos", "root_trans", "root_ori"),
        OPEN,
        endings=(".npy",),
        assumed_rate=30.0,
        rate_of="the rate of most such files",
    ),
    # ami-iit's AMP data set: the npy holds a pickled dictionary, of lists.
    array_format(
        "amp_dataset",
        AMI,
        OPEN,
        (*AMI.needed, "joints_list"),
        lambda _, arrays, __: {
            **arrays,
            **{name: rows_of(arrays[name], name) for name in AMI.needed},
        },
        endings=(".npy",),
        assumed_rate=30.0,
        rate_of="the rate of most such files",
    ),
)
"""The rows, with the traps of each format."""

MAX_TEXT = 15_000_000
"""Longest text, in characters: six minutes at 30 Hz."""

BEGIN = 1000
"""Characters in which the first keys must be."""

N_BASE = 6
"""Columns of the base, and of its velocities."""


def _read_mimickit(source: MotionSource, robot: Description) -> Motion:
    """Read MimicKit's pickle."""
    frames = rows_of(source.arrays["frames"], "frames")
    if frames.shape[1] < N_BASE:
        raise MotionError(f"A frame must have at least {N_BASE} numbers.")
    names, notes = names_of_columns(source, frames[:, N_BASE:], robot)
    base = np.concatenate([frames[:, :3], from_rotation_vector(frames[:, 3:6])], axis=1)
    times = np.arange(float(len(frames)))
    motion = Motion(times, names, frames[:, N_BASE:], None, base, notes)
    return source.arrays.timed(motion)


def _read_amp_text(source: MotionSource, robot: Description) -> Motion:
    """Read TienKung's JSON."""
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
    frames = rows_of(found.get("Frames"), "Frames")
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


def rows_of(rows: Any, label: str) -> np.ndarray:
    """Convert a list of rows, or an array.

    Args:
        rows: Lists or arrays of numbers, as they were read.
        label: Their name, for the message.

    Returns:
        Finite numbers, shape (n_rows, n_columns).

    Raises:
        MotionError: If these are no rows of numbers of equal length.
    """
    if isinstance(rows, list):
        width = _length(rows[0]) if rows else 0
        if len(rows) * width > MAX_SIZE:
            raise MotionError(f"{label} has more than {MAX_SIZE} numbers.")
        values = array("d")
        for row in rows:
            if _length(row) != width:
                raise MotionError(f"{label} must be rows of equal length.")
            try:
                values.extend(row)
            except (TypeError, OverflowError):
                raise MotionError(f"{label} must contain numbers.") from None
        if not values:
            raise MotionError(f"{label} has no numbers.")
        rows = np.array(values).reshape(-1, width)
    return Arrays({label: rows}).numbers(label, None, None)


def _length(row: Any) -> int:
    """Return the length of a row; 0 if it is none."""
    is_row = isinstance(row, list) or (isinstance(row, np.ndarray) and row.ndim > 0)
    return len(row) if is_row else 0


# MimicKit's pickle of frames: x y z, a rotation vector and the joints. Each number is a
# step of the pickle, so reading takes a second for some minutes.
MIMICKIT = Format(
    "mimickit",
    lambda source: {"frames", "loop_mode", "fps"} <= {*source.arrays},
    _read_mimickit,
    endings=(".pkl", ".pickle"),
    arrays=("frames", "loop_mode", "fps"),
)

# TienKung's JSON of frames, often .txt: x y z, Euler angles about the moving axes x, y,
# z, the joints, and the velocities of all these. Others put quaternions and feet into
# Frames: such rows do not fit a robot and are refused. No endings, as most text in
# folders is no motion: such files are to be named.
AMP_TEXT = Format(
    "amp_text",
    lambda source: '"FrameDuration"' in (source.text or "")[:BEGIN],
    _read_amp_text,
    is_text=True,
)
