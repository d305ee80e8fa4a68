"""Motions as named arrays, as npz files and pickles have them.

Two vocabularies are known:

- BeyondMimic and mjlab: ``fps, joint_pos, joint_vel, body_pos_w, body_quat_w``; body 0
  is the root, quaternions are w x y z. Isaac Lab counts joints and bodies breadth
  first, MuJoCo in the order of the file; ``joint_names`` tells, which our own files
  have, or the bodies' places do.
- GMR: ``fps, root_pos, root_rot, dof_pos``; quaternions are x y z w.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from g1_description.core.errors import MotionError
from g1_description.core.motion.motion import Motion, names_of_columns
from g1_description.core.motion.trajectory import Trajectory
from g1_description.core.robot.description import Description, Joint
from g1_description.core.robot.kinematics import Kinematics
from g1_description.core.text import listed

TRACKED = ("fps", "joint_pos", "body_pos_w", "body_quat_w")
"""Arrays of BeyondMimic and mjlab that are read, beside ``joint_vel``."""

RETARGETED = ("fps", "root_pos", "root_rot", "dof_pos")
"""Arrays of GMR that are read."""

READ = (*TRACKED, "joint_vel", "joint_names", *RETARGETED[1:])

ELSEWHERE = 0.002
"""Bodies farther than this from where the robot has them are told, in [m]."""

MAX_SIZE = 12_000_000
"""Most numbers of an array: half an hour of 30 bodies at 60 Hz."""

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
        return _tracked(arrays, _names(found), robot)
    if all(name in found for name in RETARGETED):
        return _retargeted({name: _numbers(found, name) for name in RETARGETED}, robot)
    raise MotionError(
        f"The file has {listed(map(str, found)) or 'nothing'}; a motion has "
        f"{listed(TRACKED)}, or {listed(RETARGETED)}."
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
    if not isinstance(names, np.ndarray) or names.dtype.kind != "U" or names.ndim != 1:
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
    orders = [names or names_of_columns(n_joints, robot)]
    own = {joint.name for joint in robot.movable_joints}
    is_comparable = {*orders[0]} == own and places.shape[1] == n_joints + 1
    if names is None and is_comparable:
        orders.append(tuple(joint.name for joint in _breadth_first(robot)))
    motions = [
        Trajectory(times, order, positions, velocities, base) for order in orders
    ]
    if not is_comparable:
        return Motion(motions[0], () if names else (UNKNOWN_ORDER,))
    errors = [_deviation(motion, base, places, robot) for motion in motions]
    best = int(np.argmin(errors))
    notes = ["The joints are in the order of Isaac Lab."] if best else []
    if errors[best] > ELSEWHERE:
        notes.append(
            f"The file's bodies are up to {errors[best]:.3f} m from where {robot.name} "
            "has them: it is of another robot, or of another version."
        )
    return Motion(motions[best], tuple(notes))


def _breadth_first(robot: Description) -> list[Joint]:
    """List the movable joints level by level."""
    level, found = [robot.root], []
    while level:
        below = [j for link in level for j in robot.joints if j.parent == link]
        found += [joint for joint in below if joint in robot.movable_joints]
        level = [joint.child for joint in below]
    return found


def _deviation(
    motion: Trajectory, base: np.ndarray, places: np.ndarray, robot: Description
) -> float:
    """Compute how far bodies are from where the robot has them.

    Args:
        motion: Of all its joints, in the order of the bodies.
        base: Poses of the root, shape (n, 7).
        places: Of the root and the joints' child links, shape (n, n_joints + 1, 3).
        robot: The robot.

    Returns:
        The largest distance in [m].
    """
    joints = {joint.name: joint for joint in robot.movable_joints}
    column = [motion.joint_names.index(name) for name in joints]
    rows = [robot.link_names.index(joints[n].child) for n in motion.joint_names]
    rows = [robot.link_names.index(robot.root), *rows]
    kinematics = Kinematics(robot)
    numbers = np.linspace(0, len(places) - 1, N_COMPARED).astype(int)
    farthest = 0.0
    for number in numbers:
        poses = kinematics.link_poses(base[number], motion.positions[number, column])
        distance = np.linalg.norm(poses[rows, :3] - places[number], axis=1).max()
        farthest = max(farthest, float(distance))
    return farthest


def _retargeted(arrays: dict[str, Any], robot: Description) -> Motion:
    """Read the arrays of GMR."""
    positions = _shape(arrays, "dof_pos", None, None)
    n_samples, n_joints = positions.shape
    places = _shape(arrays, "root_pos", n_samples, 3)
    turns = _shape(arrays, "root_rot", n_samples, 4)
    base = np.concatenate([places, turns], axis=1)
    names = names_of_columns(n_joints, robot)
    return Motion(
        Trajectory(_times(arrays, n_samples), names, positions, base_poses=base)
    )
