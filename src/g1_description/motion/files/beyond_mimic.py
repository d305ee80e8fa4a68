"""Arrays of BeyondMimic and mjlab in an npz; also written by this package.

``fps, joint_pos, joint_vel, body_pos_w, body_quat_w``; body 0 is the root, quaternions
are w x y z. Isaac Lab orders joints and bodies breadth first, MuJoCo as in the file.
The order follows from ``joint_names``, which this package writes, or from the positions
of the bodies.
"""

from __future__ import annotations

import io
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from g1_description.errors import MotionError
from g1_description.motion.files.conventions import layouts, names_of_columns, of_robot
from g1_description.motion.files.source import MotionSource
from g1_description.motion.motion import Motion, sample
from g1_description.robot.description import Description, Joint
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.tree import below

ARRAYS = ("fps", "joint_pos", "body_pos_w", "body_quat_w")

ENDINGS = (".npz",)

BODY_MISMATCH = 0.002
"""Larger distances of bodies from those of the robot are reported, in [m]."""

N_COMPARED = 5
"""Samples whose bodies are compared with the robot's."""

EVEN = 1e-6
"""Tolerance of evenly spaced times, in [s]."""

BATCH = 1000
"""Samples per chunk when bodies are computed."""

MAX_SAMPLES = 1_000_000
"""Most samples that are written."""

OVERHEAD = 20_000
"""Most bytes of an npz without numbers and names."""

NO_BASE = "An npz needs base poses, and this motion has none; write .csv."

UNKNOWN_ORDER = "The joint order is unknown; assuming that of the robot's file."


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
    velocities = None
    if "joint_vel" in source.arrays:
        velocities = source.arrays.numbers("joint_vel", n_samples, n_joints)
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
    base = np.concatenate([places[:, 0], turns[:, 0, 1:], turns[:, 0, :1]], axis=1)
    names, notes = _names(named, positions, base, places, robot)
    trajectory = Motion(times, names, positions, velocities, base)
    return replace(trajectory, notes=(*notes, *of_times))


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
    even, fps, notes = _even(trajectory, rate)
    poses, twists = _bodies(even, robot)
    arrays = {
        "fps": np.array([fps]),
        "joint_pos": even.positions,
        "joint_vel": even.velocities,
        "body_pos_w": poses[..., :3],
        "body_quat_w": poses[..., [6, 3, 4, 5]],
        "body_lin_vel_w": twists[..., :3].astype(np.float32),
        "body_ang_vel_w": twists[..., 3:].astype(np.float32),
        "joint_names": np.array(even.joint_names, dtype=str),
    }
    stream = io.BytesIO()
    np.savez(stream, **{n: a for n, a in arrays.items() if a is not None})
    return stream.getvalue(), notes


def _even(
    trajectory: Motion, rate: float | None
) -> tuple[Motion, float, tuple[str, ...]]:
    """Resample a motion to evenly spaced times, if necessary.

    Returns:
        The motion, its samples per second, and a message if it was resampled.
    """
    times = trajectory.times - trajectory.times[0]
    mean = (len(times) - 1) / times[-1] if len(times) > 1 else 30.0
    fps = rate or (round(mean) if abs(mean - round(mean)) < 1e-3 else mean)
    n_samples = int(times[-1] * fps + 1e-3) + 1
    if n_samples > MAX_SAMPLES:
        raise MotionError(
            f"The motion would have {n_samples} samples at {fps:g} Hz; the limit is "
            f"{MAX_SAMPLES}."
        )
    regular = np.arange(n_samples) / fps
    if n_samples == len(times) and np.abs(times - regular).max() <= EVEN:
        return trajectory, float(fps), ()
    found = sample(trajectory, trajectory.times[0] + regular)
    velocities = None if trajectory.velocities is None else found.velocities
    names, poses = trajectory.joint_names, found.base_poses
    note = (
        f"The times are not evenly spaced: resampled to {n_samples} samples at "
        f"{fps:g} Hz."
    )
    even = Motion(regular, names, found.positions, velocities, poses)
    return even, float(fps), (note,)


def _bodies(trajectory: Motion, robot: Description) -> tuple[np.ndarray, np.ndarray]:
    """Place the root and the joints' child links.

    Returns:
        Poses, x y z and quaternion x y z w, shape (n_samples, n_joints + 1, 7), and
        twists along the map's axes, linear then angular, shape (..., 6).
    """
    child = {joint.name: joint.child for joint in robot.movable_joints}
    links = [robot.root, *(child[name] for name in trajectory.joint_names)]
    rows = [robot.link_names.index(link) for link in links]
    found = sample(trajectory, trajectory.times)
    base, base_twists = trajectory.base_poses, found.base_twists
    assert base is not None and base_twists is not None
    base_twists = _between(base_twists)
    velocities = trajectory.velocities
    if velocities is None:
        velocities = _between(found.velocities)
    positions = of_robot(trajectory.joint_names, trajectory.positions, robot)
    velocities = of_robot(trajectory.joint_names, velocities, robot)
    kinematics = Kinematics(robot)
    shape = len(trajectory.times), len(links)
    poses, twists = np.empty((*shape, 7)), np.empty((*shape, 6))
    for begin in range(0, len(poses), BATCH):
        part = slice(begin, begin + BATCH)
        all_poses, all_twists = kinematics.link_states(
            base[part], positions[part], base_twists[part], velocities[part]
        )
        poses[part], twists[part] = all_poses[:, rows], all_twists[:, rows]
    poses[:, 0] = base
    return poses, twists


def _between(differences: np.ndarray) -> np.ndarray:
    """Average the velocities before and after each sample, shape (n, ...)."""
    if len(differences) < 2:
        return differences
    behind = np.concatenate([differences[:-1], differences[-2:-1]])
    before = np.concatenate([behind[:1], behind[:-1]])
    return 0.5 * (before + behind)
