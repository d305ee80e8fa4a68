"""Arrays of BeyondMimic and mjlab in an npz, which we write, too.

``fps, joint_pos, joint_vel, body_pos_w, body_quat_w``; body 0 is the root, quaternions
are w x y z. Isaac Lab counts joints and bodies breadth first, MuJoCo in the order of
the file; ``joint_names`` tells, which our own files have, or the bodies' places do.
"""

from __future__ import annotations

import io
from collections.abc import Collection, Sequence

import numpy as np

from g1_description.errors import MotionError
from g1_description.motion.files.source import MotionSource
from g1_description.motion.files.unnamed import layouts, names_of_columns, of_robot
from g1_description.motion.motion import Motion
from g1_description.motion.trajectory import Trajectory, sample
from g1_description.robot.description import Description, Joint
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.tree import below

ARRAYS = ("fps", "joint_pos", "body_pos_w", "body_quat_w")

ENDINGS = (".npz",)

BODY_MISMATCH = 0.002
"""Bodies farther than this from where the robot has them are reported, in [m]."""

N_COMPARED = 5
"""Samples whose bodies are compared with the robot's."""

EVEN = 1e-6
"""Times this near to those of a rate are that rate's, in [s]."""

BATCH = 1000
"""Samples whose bodies are computed at once."""

MAX_SAMPLES = 1_000_000
"""Most samples that are written."""

OVERHEAD = 20_000
"""Most bytes of an npz without numbers and names."""

NO_BASE = "An npz needs the base, which this motion has not."

UNKNOWN_ORDER = (
    "The order of the joints is unknown: that of the robot's file is assumed."
)


def recognise(source: MotionSource) -> bool:
    """Return whether a file has these arrays; velocities and names may be missing."""
    return {*ARRAYS} <= {*source.arrays}


def read(source: MotionSource, robot: Description) -> Motion:
    """Read a motion.

    Raises:
        MotionError: If names, shapes or numbers are others.
    """
    positions = source.numbers("joint_pos", None, None)
    n_samples, n_joints = positions.shape
    places = source.numbers("body_pos_w", n_samples, None, 3)
    turns = source.numbers("body_quat_w", n_samples, places.shape[1], 4)
    velocities = None
    if "joint_vel" in source.arrays:
        velocities = source.numbers("joint_vel", n_samples, n_joints)
    if not places.shape[1]:
        raise MotionError("body_pos_w has no bodies; the first one is the root.")
    named = None
    if "joint_names" in source.arrays:
        named = source.names("joint_names")
        if len(named) != n_joints:
            raise MotionError(f"{len(named)} joint_names come with {n_joints} joints.")
    times, of_times = source.times(n_samples)
    base = np.concatenate([places[:, 0], turns[:, 0, 1:], turns[:, 0, :1]], axis=1)
    names, notes = _names(named, positions, base, places, robot)
    trajectory = Trajectory(times, names, positions, velocities, base)
    return Motion(trajectory, (*notes, *of_times))


def _names(
    named: tuple[str, ...] | None,
    positions: np.ndarray,
    base: np.ndarray,
    places: np.ndarray,
    robot: Description,
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Name the joints: as the file does, else as the places of the bodies fit best.

    Returns:
        The names, and messages if they are a choice or the bodies do not fit.
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
        found.append("The joints are in the order of Isaac Lab.")
    if errors[best] > BODY_MISMATCH:
        found.append(
            f"The file's bodies are up to {errors[best]:.3f} m from where {robot.name} "
            "has them: it is of another robot, or of another version."
        )
    return orders[best], tuple(found)


def _orders(n_joints: int, robot: Description) -> list[tuple[str, ...]]:
    """List the orders that joints without names may have."""
    found = layouts(n_joints, robot)
    isaac = [_breadth_first(robot, names) for names in found]
    return [*found, *(order for order in isaac if len(order) == n_joints)]


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
    names: Sequence[str],
    positions: np.ndarray,
    base: np.ndarray,
    places: np.ndarray,
    robot: Description,
) -> float:
    """Compute the largest distance of bodies from the robot's, in [m].

    Positions are those of the named joints, others are at zero; ``places`` those of the
    root and the joints' child links, shape (n, n_joints + 1, 3).
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
    """Return how many samples ``write`` may write.

    Args:
        joints: Names of the joints, which have velocities.
        has_base: Whether there is a base.
        size: Most bytes.

    Raises:
        MotionError: If there is none.
    """
    if not has_base:
        raise MotionError(NO_BASE)
    n_joints, n_bodies = len(joints), len(joints) + 1
    names = 4 * n_joints * max(map(len, joints), default=0)
    sample = 2 * 8 * n_joints + (7 * 8 + 6 * 4) * n_bodies
    return min((size - OVERHEAD - names) // sample, MAX_SAMPLES)


def write(
    trajectory: Trajectory, robot: Description, rate: float | None
) -> tuple[bytes, tuple[str, ...]]:
    """Write a motion at even times from zero on.

    Args:
        trajectory: With a base; joints of the robot that it has not are at zero.
        robot: The robot, of whose links the places are written.
        rate: Samples per second, in [Hz]; None: those of the motion, on average.

    Returns:
        The file's content, and messages on what is not as in the motion.

    Raises:
        MotionError: If it has no base, or the rate makes too many samples.
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
    trajectory: Trajectory, rate: float | None
) -> tuple[Trajectory, float, tuple[str, ...]]:
    """Bring a motion to even times; as it is where they are.

    Returns:
        The motion, its samples per second, and what was done to it.
    """
    times = trajectory.times - trajectory.times[0]
    mean = (len(times) - 1) / times[-1] if len(times) > 1 else 30.0
    fps = rate or (round(mean) if abs(mean - round(mean)) < 1e-3 else mean)
    n_samples = int(times[-1] * fps + 1e-3) + 1
    if n_samples > MAX_SAMPLES:
        raise MotionError(
            f"{n_samples} samples at {fps:g} Hz are more than {MAX_SAMPLES}."
        )
    regular = np.arange(n_samples) / fps
    if n_samples == len(times) and np.abs(times - regular).max() <= EVEN:
        return trajectory, float(fps), ()
    found = sample(trajectory, trajectory.times[0] + regular)
    velocities = None if trajectory.velocities is None else found.velocities
    names, poses = trajectory.joint_names, found.base_poses
    note = f"The times are not even: written as {n_samples} samples at {fps:g} Hz."
    even = Trajectory(regular, names, found.positions, velocities, poses)
    return even, float(fps), (note,)


def _bodies(
    trajectory: Trajectory, robot: Description
) -> tuple[np.ndarray, np.ndarray]:
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
    """Find velocities at samples from those behind each, shape (n, ...)."""
    if len(differences) < 2:
        return differences
    behind = np.concatenate([differences[:-1], differences[-2:-1]])
    before = np.concatenate([behind[:1], behind[:-1]])
    return 0.5 * (before + behind)
