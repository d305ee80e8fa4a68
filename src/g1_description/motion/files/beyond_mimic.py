"""Arrays of BeyondMimic, mjlab and unitree_rl_lab in an npz; also written.

``fps, joint_pos, joint_vel, body_pos_w, body_quat_w``; body 0 is the root, unless
``body_names`` say otherwise; quaternions are w x y z. Traps:

- Isaac Lab (whole_body_tracking, unitree_rl_lab) orders joints and bodies breadth
  first, MuJoCo (mjlab) as in the file, and the file does not say which. The order
  follows from ``joint_names``, which this package writes, or from the positions of the
  bodies.
- Unitree's deployed program reads float32 whatever the type is, so all is float32 in
  files for training. They need all six arrays and ``fps`` of shape (1,).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from g1_description.errors import MotionError
from g1_description.motion.files.conventions import (
    base_of,
    layouts,
    names_of_columns,
    of_robot,
    read_velocities,
)
from g1_description.motion.files.source import MotionSource
from g1_description.motion.files.writing import (
    bodies,
    even,
    npz,
    number,
    prepared,
    usual_joints,
    velocities_of,
)
from g1_description.motion.motion import MAX_SAMPLES, Motion
from g1_description.robot.description import Description, Joint
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.tree import below
from g1_description.text import MAX_NAME

ARRAYS = ("fps", "joint_pos", "body_pos_w", "body_quat_w")

ENDINGS = (".npz",)

BODY_MISMATCH = 0.002
"""Larger distances of bodies from those of the robot are reported, in [m]."""

N_COMPARED = 5
"""Samples whose bodies are compared with the robot's."""

OVERHEAD = 20_000
"""Most bytes of an npz without numbers and names."""

NO_BASE = "An npz needs base poses, and this motion has none; write .csv."

UNKNOWN_ORDER = "The joint order is unknown; assuming that of the robot's file."

CONTROL_RATE = 50.0
"""Samples per second at which both trainers step, in [Hz]."""


def recognise(source: MotionSource) -> bool:
    """Return whether a file has these arrays; velocities and names may be missing."""
    return {*ARRAYS} <= {*source.arrays}


def read(source: MotionSource, robot: Description) -> Motion:
    """Read a motion.

    Raises:
        MotionError: If an array has a wrong shape or content.
    """
    positions = source.arrays.numbers("joint_pos", None, None)
    n_samples, n_joints = positions.shape
    places = source.arrays.numbers("body_pos_w", n_samples, None, 3)
    turns = source.arrays.numbers("body_quat_w", n_samples, places.shape[1], 4)
    velocities = read_velocities(source.arrays, "joint_vel", positions)
    if not places.shape[1]:
        raise MotionError("body_pos_w must have at least one body, the root.")
    named = None
    if "joint_names" in source.arrays:
        named = source.arrays.names("joint_names")
        if len(named) != n_joints:
            raise MotionError(
                f"joint_names has {len(named)} names for {n_joints} joints."
            )
    times, of_times = source.arrays.times(n_samples)
    root = 0
    if "body_names" in source.arrays:
        links = source.arrays.names("body_names")[: places.shape[1]]
        if robot.root in links:
            root = links.index(robot.root)
        elif links:
            lacking = f"The bodies lack the base, {robot.root}: assuming the first one"
            of_times += (f"{lacking}, {links[0][:MAX_NAME]}.",)
    base = base_of(places[:, root], turns[:, root])
    names, notes = _names(named, positions, base, places, robot)
    return Motion(times, names, positions, velocities, base, (*notes, *of_times))


def _names(
    named: tuple[str, ...] | None,
    positions: np.ndarray,
    base: np.ndarray,
    places: np.ndarray,
    robot: Description,
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Name the joints as in the file, else by the best fit of the bodies.

    Returns:
        The names, and messages on assumptions and on bodies that do not fit.
    """
    n_joints = positions.shape[1]
    own = {joint.name for joint in robot.movable_joints}
    orders = [
        order
        for order in ([named] if named else _orders(n_joints, robot))
        if {*order} <= own and places.shape[1] == n_joints + 1
    ]
    if not orders and named is not None:
        return named, ()
    if not orders:
        names, notes = names_of_columns(positions, robot)
        return names, (*notes, UNKNOWN_ORDER)
    errors = [_deviation(order, positions, base, places, robot) for order in orders]
    best = int(np.argmin(errors))
    found: list[str] = []
    if named is None and orders[best] not in layouts(n_joints, robot):
        found.append("Joint order: Isaac Lab.")
    if errors[best] > BODY_MISMATCH:
        found.append(
            f"The bodies in the file are up to {errors[best]:.3f} m off those of "
            f"{robot.name}: the motion may be for another robot or version."
        )
    return orders[best], tuple(found)


def _orders(n_joints: int, robot: Description) -> list[tuple[str, ...]]:
    """List the possible orders of unnamed joints."""
    found = layouts(n_joints, robot)
    isaac = [breadth_first(robot, names) for names in found]
    return [*found, *(order for order in isaac if len(order) == n_joints)]


def breadth_first(robot: Description, names: Collection[str]) -> tuple[str, ...]:
    """List named joints breadth first, as Isaac Lab does, as if all others were fixed.

    Args:
        robot: The robot.
        names: Of the joints; those that the robot does not have are left out.
    """
    depth = {robot.root: 0}
    found: list[Joint] = []
    for joint in below([robot.root], robot.joints):
        is_named = joint.name in names
        depth[joint.child] = depth[joint.parent] + is_named
        found += [joint] if is_named else []
    found.sort(key=lambda joint: depth[joint.child])
    return tuple(joint.name for joint in found)


def _deviation(
    names: Sequence[str],
    positions: np.ndarray,
    base: np.ndarray,
    places: np.ndarray,
    robot: Description,
) -> float:
    """Compute the largest distance of bodies from the robot's, in [m].

    ``places`` are positions of the root and the joints' child links, shape (n, n_joints
    + 1, 3). Joints that are not named are at zero.
    """
    child = {joint.name: joint.child for joint in robot.movable_joints}
    links = [robot.root, *(child[name] for name in names)]
    rows = [robot.link_names.index(link) for link in links]
    compared = np.linspace(0, len(places) - 1, N_COMPARED).astype(int)
    of_joints = of_robot(names, positions[compared], robot)
    poses = Kinematics(robot).link_poses(base[compared], of_joints)
    offsets = poses[:, rows, :3] - places[compared]
    return float(np.linalg.norm(offsets, axis=-1).max())


def most_samples(joints: Sequence[str], has_base: bool, size: int) -> int:
    """Return the largest number of samples of a file.

    Args:
        joints: Names of the joints, which have velocities.
        has_base: Whether there is a base.
        size: Largest file size in bytes.

    Raises:
        MotionError: If there is no base.
    """
    if not has_base:
        raise MotionError(NO_BASE)
    n_joints, n_bodies = len(joints), len(joints) + 1
    names = 4 * n_joints * max(map(len, joints), default=0)
    sample = 2 * 8 * n_joints + (7 * 8 + 6 * 4) * n_bodies
    return min((size - OVERHEAD - names) // sample, MAX_SAMPLES)


def write(
    trajectory: Motion, robot: Description, rate: float | None
) -> tuple[bytes, tuple[str, ...]]:
    """Write a motion with evenly spaced times from zero.

    Args:
        trajectory: With a base; joints missing in it are at zero.
        robot: The robot.
        rate: Samples per second, in [Hz]; None: those of the motion, on average.

    Returns:
        The file's content, and messages on differences from the motion.

    Raises:
        MotionError: If it has no base or too many samples.
    """
    if trajectory.base_poses is None:
        raise MotionError(NO_BASE)
    evenly, fps, notes = even(trajectory, rate)
    poses, twists = bodies(evenly, robot)
    arrays = {
        "fps": np.array([fps]),
        "joint_pos": evenly.positions,
        "joint_vel": evenly.velocities,
        "body_pos_w": poses[..., :3],
        "body_quat_w": poses[..., [6, 3, 4, 5]],
        "body_lin_vel_w": twists[..., :3].astype(np.float32),
        "body_ang_vel_w": twists[..., 3:].astype(np.float32),
        "joint_names": np.array(evenly.joint_names, dtype=str),
    }
    return npz({n: a for n, a in arrays.items() if a is not None}), notes


def write_mjlab(
    motion: Motion, robot: Description, rate: float | None
) -> tuple[bytes, tuple[str, ...]]:
    """Write the npz from which mjlab trains: joints in MuJoCo's order.

    Arguments and errors are those of ``writing.prepared``.

    Returns:
        The file's content, and messages on differences from the motion.
    """
    return _for_training(*prepared(motion, robot, rate), robot)


def write_whole_body_tracking(
    motion: Motion, robot: Description, rate: float | None
) -> tuple[bytes, tuple[str, ...]]:
    """Write the npz from which whole_body_tracking trains: in Isaac Lab's order.

    Arguments, results and errors are those of ``write_mjlab``.
    """
    isaac = breadth_first(robot, usual_joints(motion, robot))
    return _for_training(*prepared(motion, robot, rate, isaac), robot)


def _for_training(
    motion: Motion, fps: float, notes: tuple[str, ...], robot: Description
) -> tuple[bytes, tuple[str, ...]]:
    """Write all six arrays as float32, in the order of the motion's joints."""
    if abs(fps - CONTROL_RATE) > 1e-3:
        notes += (
            f"The file has {fps:g} Hz. Training plays a sample per control step, "
            f"usually at {CONTROL_RATE:g} Hz: resample the motion first.",
        )
    poses, twists = bodies(motion, robot)
    arrays = {
        "joint_pos": motion.positions,
        "joint_vel": velocities_of(motion),
        "body_pos_w": poses[..., :3],
        "body_quat_w": poses[..., [6, 3, 4, 5]],
        "body_lin_vel_w": twists[..., :3],
        "body_ang_vel_w": twists[..., 3:],
    }
    content = {name: array.astype(np.float32) for name, array in arrays.items()}
    return npz({"fps": np.array([number(fps)]), **content}), notes
