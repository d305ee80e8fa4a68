"""Arrays of HoloMotion in an npz: ``ref_dof_pos, ref_global_translation`` and more.

Joints and bodies are in the order of the URDF, body 0 is the base, quaternions are x y
z w. Traps:

- The rate is in a text in JSON, ``metadata``, as ``motion_fps``.
- The prefix names the kind: ``ref_`` the reference, ``ft_ref_`` filtered, ``robot_``
  executed; a file may have several. Old files have none, and ``dof_vels``.
- Places and turns may be those of the base alone.
"""

from __future__ import annotations

import json

import numpy as np

from g1_description.motion.files.array_formats import Keys, read_arrays
from g1_description.motion.files.arrays import Arrays
from g1_description.motion.files.format import (
    Format,
    Writer,
    bodies,
    even_writer,
    npz,
    velocities_of,
)
from g1_description.motion.files.source import MotionSource, parsed
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description

METADATA = "metadata"

PREFIXES = {"ref": "ref_", "ft_ref": "ft_ref_", "robot": "robot_", "motion": ""}
"""Prefixes of the arrays, by the names of motions."""

JOINTS, PLACES, TURNS = "dof_pos", "global_translation", "global_rotation_quat"

VERSION = "1.4.0"
"""Version of the format that is written."""


def recognise(source: MotionSource) -> bool:
    """Return whether a file has these arrays."""
    return METADATA in source.arrays and bool(names(source))


def names(source: MotionSource) -> tuple[str, ...]:
    """List the motions: the reference, and the executed one."""
    return tuple(
        name
        for name, prefix in PREFIXES.items()
        if {prefix + JOINTS, prefix + PLACES} <= {*source.arrays}
    )


def read(source: MotionSource, robot: Description) -> Motion:
    """Read a motion.

    Raises:
        MotionError: If an array has a wrong shape or content.
    """
    arrays = source.arrays
    prefix = PREFIXES[source.chosen(names(source))]
    joints, places, turns = (prefix + name for name in (JOINTS, PLACES, TURNS))
    speeds = f"{prefix}dof_vels"
    speeds = speeds if speeds in arrays else f"{prefix}dof_vel"
    metadata = parsed(str(arrays[METADATA]), METADATA)
    has_bodies = np.ndim(arrays[places]) == 3
    keys = Keys(joints, places, turns, speeds, has_bodies, rate="motion_fps")
    numbers = {name: arrays[name] for name in keys.own & {*arrays}}
    return read_arrays(source, Arrays({**numbers, **metadata}), robot, keys, "xyzw")


def _content(motion: Motion, base: np.ndarray, robot: Description, fps: float) -> bytes:
    """Write a reference as float32, with all bodies."""
    poses, twists = bodies(motion, robot)
    n_samples, n_joints = motion.positions.shape
    metadata = {
        "format_version": VERSION,
        "motion_key": motion.name or "motion",
        "raw_motion_key": motion.name or "motion",
        "motion_fps": fps,
        "num_frames": n_samples,
        "wallclock_len": (n_samples - 1) / fps,
        "num_dofs": n_joints,
        "num_bodies": n_joints + 1,
        "clip_length": n_samples,
        "valid_prefix_len": n_samples,
    }
    arrays = {
        JOINTS: motion.positions,
        "dof_vel": velocities_of(motion),
        PLACES: poses[..., :3],
        TURNS: poses[..., 3:],
        "global_velocity": twists[..., :3],
        "global_angular_velocity": twists[..., 3:],
    }
    content = {f"ref_{name}": a.astype(np.float32) for name, a in arrays.items()}
    text = np.array(json.dumps(metadata))
    return npz({METADATA: text, **content})


FORMAT = Format(
    "holomotion",
    recognise,
    read,
    (".npz",),
    order="xyzw",
    names=names,
    writers={
        "holomotion": Writer(".npz", even_writer(_content, has_joint_order=False))
    },
)
