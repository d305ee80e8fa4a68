"""Motions as named arrays, as npz files and pickles have them.

Two vocabularies are known:

- BeyondMimic and mjlab: ``fps, joint_pos, joint_vel, body_pos_w, body_quat_w``; body 0
  is the root, quaternions are w x y z. Isaac Lab counts joints and bodies breadth
  first, MuJoCo in the order of the file; ``joint_names`` tells, which our own files
  have, or the bodies' places do.
- GMR: ``fps, root_pos, root_rot, dof_pos``; quaternions are x y z w, which is checked.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from g1_description.errors import MotionError
from g1_description.motion.files.unnamed import (
    layouts,
    names_of_columns,
    of_robot,
    w_last,
)
from g1_description.motion.motion import Motion
from g1_description.motion.trajectory import Trajectory
from g1_description.robot.description import Description, Joint
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.tree import below
from g1_description.text import listed

TRACKED = ("fps", "joint_pos", "body_pos_w", "body_quat_w")
"""Arrays of BeyondMimic and mjlab that are read, beside ``joint_vel``."""

RETARGETED = ("fps", "root_pos", "root_rot", "dof_pos")
"""Arrays of GMR that are read."""

READ = (*TRACKED, "joint_vel", "joint_names", *RETARGETED[1:])

ELSEWHERE = 0.002
"""Bodies farther than this from where the robot has them are told, in [m]."""

MAX_SIZE = 12_000_000
"""Most numbers of an array: half an hour of 30 bodies at 60 Hz."""

MAX_TEXT = 1_000_000
"""Most bytes of all names."""

UNKNOWN_ORDER = (
    "The order of the joints is unknown: that of the robot's file is assumed."
)

N_COMPARED = 5
"""Samples whose bodies are compared with the robot's."""


def motion_of_arrays(found: Mapping[str, Any], robot: Description) -> Motion:
    """Read a motion.

    Args:
        found: Arrays and numbers by name.
        robot: The robot that it is of.

    Raises:
        MotionError: If names, shapes or numbers are others.
    """
    if all(name in found for name in TRACKED):
        names = (*TRACKED, "joint_vel")
        arrays = {name: _numbers(found, name) for name in names}
        motion = _tracked(arrays, _names(found), robot)
    elif all(name in found for name in RETARGETED):
        arrays = {name: _numbers(found, name) for name in RETARGETED}
        motion = _retargeted(arrays, robot)
    else:
        raise MotionError(_missing(list(map(str, found))))
    period = motion.trajectory.times[1:2]
    if not period.size or period[0] <= 1.0:
        return motion
    note = (
        f"fps is {1.0 / period[0]:.6g}, i.e. one sample every {period[0]:.6g} s. If "
        f"{1.0 / period[0]:.6g} is the sample period in seconds, set fps to "
        f"{period[0]:.6g}."
    )
    return replace(motion, notes=(*motion.notes, note))


def _missing(names: list[str]) -> str:
    """Say what a file with these arrays lacks."""
    for wanted in (TRACKED, RETARGETED):
        missing = [name for name in wanted if name not in names]
        if len(missing) == 1:
            return f"{missing[0]} is missing; the file has {listed(names)}."
    return (
        f"The file has {listed(names) or 'nothing'}; a motion has {listed(TRACKED)}, "
        f"or {listed(RETARGETED)}."
    )


def _numbers(found: Mapping[str, Any], name: str) -> np.ndarray | None:
    """Read an array of numbers; None if there is none."""
    if found.get(name) is None:
        return None
    value = found[name]
    if not isinstance(value, (np.ndarray, np.generic, int, float)):
        raise MotionError(f"{name} holds no numbers.")
    array = np.asarray(value)
    if array.dtype.kind not in "fiu":
        raise MotionError(f"{name} holds no numbers.")
    if array.size > MAX_SIZE:
        raise MotionError(
            f"{name} has {array.size} numbers; a motion has at most {MAX_SIZE}."
        )
    array = array.astype(float, copy=False)
    if not np.isfinite(array).all():
        raise MotionError(f"{name} has numbers that are not finite.")
    return array


def _names(found: Mapping[str, Any]) -> tuple[str, ...] | None:
    """Read the names of the joints; None if there are none."""
    names = found.get("joint_names")
    if names is None:
        return None
    is_list = isinstance(names, np.ndarray) and names.dtype.kind == "U"
    if not is_list or names.ndim != 1 or names.nbytes > MAX_TEXT:
        raise MotionError("joint_names holds no list of names.")
    return tuple(names.tolist())


def _times(arrays: Mapping[str, Any], n_samples: int) -> np.ndarray:
    """Make the times of samples at a rate."""
    if arrays["fps"].size != 1 or not 0.0 < arrays["fps"].ravel()[0] < 1e6:
        raise MotionError(
            f"fps is {arrays['fps'].ravel()[:3].tolist()}; one rate is expected."
        )
    return np.arange(n_samples) / arrays["fps"].ravel()[0]


def _shape(arrays: Mapping[str, Any], name: str, *shape: int | None) -> np.ndarray:
    """Check an array's shape; None fits any number."""
    array = arrays[name]
    fits = array.ndim == len(shape) and all(
        wanted in (None, size) for wanted, size in zip(shape, array.shape)
    )
    if not fits:
        words = ", ".join("n" if size is None else str(size) for size in shape)
        raise MotionError(f"{name} has the shape {array.shape}, not ({words}).")
    return array


def _tracked(
    arrays: dict[str, Any], names: tuple[str, ...] | None, robot: Description
) -> Motion:
    """Read the arrays of BeyondMimic and mjlab; names are None where there are none."""
    positions = _shape(arrays, "joint_pos", None, None)
    n_samples, n_joints = positions.shape
    places = _shape(arrays, "body_pos_w", n_samples, None, 3)
    turns = _shape(arrays, "body_quat_w", n_samples, places.shape[1], 4)
    velocities = arrays["joint_vel"]
    if velocities is not None:
        _shape(arrays, "joint_vel", n_samples, n_joints)
    if not places.shape[1]:
        raise MotionError("body_pos_w has no bodies; the first one is the root.")
    if names is not None and len(names) != n_joints:
        raise MotionError(f"{len(names)} joint_names come with {n_joints} joints.")
    base = np.concatenate([places[:, 0], turns[:, 0, 1:], turns[:, 0, :1]], axis=1)
    times = _times(arrays, n_samples)
    orders = [names] if names else _orders(n_joints, robot)
    orders = [order for order in orders if _is_comparable(order, places, robot)]
    notes: tuple[str, ...] = ()
    if not orders and names is None:
        names, notes = names_of_columns(positions, robot)
        notes = (*notes, UNKNOWN_ORDER)
    if not orders:
        assert names is not None
        return Motion(Trajectory(times, names, positions, velocities, base), notes)
    motions = [
        Trajectory(times, order, positions, velocities, base) for order in orders
    ]
    errors = [_deviation(motion, base, places, robot) for motion in motions]
    best = int(np.argmin(errors))
    if names is None and orders[best] not in layouts(n_joints, robot):
        notes = ("The joints are in the order of Isaac Lab.",)
    if errors[best] > ELSEWHERE:
        notes = (
            *notes,
            f"The file's bodies are up to {errors[best]:.3f} m from where {robot.name} "
            "has them: it is of another robot, or of another version.",
        )
    return Motion(motions[best], notes)


def _orders(n_joints: int, robot: Description) -> list[tuple[str, ...]]:
    """List the orders that joints without names may have."""
    found = layouts(n_joints, robot)
    isaac = [_breadth_first(robot, names) for names in found]
    return [*found, *(order for order in isaac if len(order) == n_joints)]


def _is_comparable(
    names: tuple[str, ...], places: np.ndarray, robot: Description
) -> bool:
    """Return whether bodies may be the root and the joints' child links."""
    own = {joint.name for joint in robot.movable_joints}
    return {*names} <= own and places.shape[1] == len(names) + 1


def _breadth_first(robot: Description, names: Collection[str]) -> tuple[str, ...]:
    """List some movable joints level by level, as if all others were fixed."""
    depth = {robot.root: 0}
    found: list[Joint] = []
    for joint in below([robot.root], robot.joints):
        is_named = joint.name in names
        depth[joint.child] = depth[joint.parent] + is_named
        found += [joint] if is_named else []
    found.sort(key=lambda joint: depth[joint.child])
    return tuple(joint.name for joint in found)


def _deviation(
    motion: Trajectory, base: np.ndarray, places: np.ndarray, robot: Description
) -> float:
    """Compute how far bodies are from where the robot has them.

    Args:
        motion: Of its joints, in the order of the bodies; others are at zero.
        base: Poses of the root, shape (n, 7).
        places: Of the root and the joints' child links, shape (n, n_joints + 1, 3).
        robot: The robot.

    Returns:
        The largest distance in [m].
    """
    joints = {joint.name: joint for joint in robot.movable_joints}
    positions = of_robot(motion.joint_names, motion.positions, robot)
    rows = [robot.link_names.index(joints[n].child) for n in motion.joint_names]
    rows = [robot.link_names.index(robot.root), *rows]
    kinematics = Kinematics(robot)
    numbers = np.linspace(0, len(places) - 1, N_COMPARED).astype(int)
    farthest = 0.0
    for number in numbers:
        poses = kinematics.link_poses(base[number], positions[number])
        distance = np.linalg.norm(poses[rows, :3] - places[number], axis=1).max()
        farthest = max(farthest, float(distance))
    return farthest


def _retargeted(arrays: dict[str, Any], robot: Description) -> Motion:
    """Read the arrays of GMR."""
    positions = _shape(arrays, "dof_pos", None, None)
    n_samples = len(positions)
    places = _shape(arrays, "root_pos", n_samples, 3)
    turns = _shape(arrays, "root_rot", n_samples, 4)
    base = np.concatenate([places, turns], axis=1)
    names, notes = names_of_columns(positions, robot)
    times = _times(arrays, n_samples)
    motion, more = w_last(Trajectory(times, names, positions, base_poses=base), robot)
    return Motion(motion, (*notes, *more))
