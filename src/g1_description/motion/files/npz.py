"""Motions as npz files: their arrays, and how they are written."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from g1_description.errors import MotionError, cause
from g1_description.motion.trajectory import Trajectory, sample
from g1_description.robot.description import Description
from g1_description.robot.kinematics import Kinematics

MAX_BYTES = 250_000_000
"""All arrays that are read have no more, in bytes."""

MAX_MEMBERS = 1000
"""Most files in an npz."""

_MEMBER = b"PK\x01\x02"
"""Begins what a zip file says of each of its files."""


def read_npz(data: bytes, wanted: Collection[str]) -> dict[str, Any]:
    """Read some arrays of an npz file.

    Args:
        data: The file.
        wanted: Names of the arrays to read.

    Returns:
        The wanted arrays by name; what else the file has is None.

    Raises:
        MotionError: If the file is damaged, too large, or an array holds objects.
    """
    if data.count(_MEMBER) > MAX_MEMBERS:
        raise MotionError(f"The npz has more than {MAX_MEMBERS} files.")
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            _check_members(arrays.zip.infolist(), wanted)
            return {n: arrays[n] if n in wanted else None for n in arrays.files}
    except MotionError:
        raise
    # Whatever a damaged file makes zipfile and numpy raise.
    except Exception as error:
        raise MotionError(f"The npz file cannot be read: {cause(error)}.") from error


def _check_members(members: list[zipfile.ZipInfo], wanted: Collection[str]) -> None:
    """Refuse a zip file without arrays, or one that grows too large."""
    sizes = {member.filename: member.file_size for member in members}
    if not any(name.endswith(".npy") for name in sizes):
        if any(name.endswith("/data.pkl") for name in sizes):
            raise MotionError("A PyTorch file; convert it to npz or CSV.")
        raise MotionError("A zip file without arrays: not an npz.")
    size = sum(sizes.get(f"{name}.npy", 0) for name in wanted)
    if size > MAX_BYTES:
        raise MotionError(
            f"The arrays have {size / 1e6:.0f} MB; a motion's have at most "
            f"{MAX_BYTES / 1e6:.0f} MB."
        )


EVEN = 1e-6
"""Times this near to those of a rate are that rate's, in [s]."""

MAX_SAMPLES = 1_000_000
"""Most samples of a file."""

NO_BASE = "An npz needs the base, which this motion has not."

OVERHEAD = 20_000
"""Bytes of an npz beside numbers and names, at most."""


def most_even_samples(joints: Sequence[str], has_base: bool, size: int) -> int:
    """Return how many samples ``npz_bytes`` may write.

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


def npz_bytes(
    trajectory: Trajectory, robot: Description, rate: float | None = None
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
    wanted = np.arange(n_samples) / fps
    if n_samples == len(times) and np.abs(times - wanted).max() <= EVEN:
        return trajectory, float(fps), ()
    found = sample(trajectory, trajectory.times[0] + wanted)
    velocities = None if trajectory.velocities is None else found.velocities
    names, poses = trajectory.joint_names, found.base_poses
    note = f"The times are not even: written as {n_samples} samples at {fps:g} Hz."
    even = Trajectory(wanted, names, found.positions, velocities, poses)
    return even, float(fps), (note,)


def _bodies(
    trajectory: Trajectory, robot: Description
) -> tuple[np.ndarray, np.ndarray]:
    """Place the root and the joints' child links.

    Returns:
        Poses, x y z and quaternion x y z w, shape (n_samples, n_joints + 1, 7), and
        twists along the map's axes, linear then angular, shape (..., 6).
    """
    own = [joint.name for joint in robot.movable_joints]
    child = {joint.name: joint.child for joint in robot.movable_joints}
    links = [robot.root, *(child[name] for name in trajectory.joint_names)]
    rows = [robot.link_names.index(link) for link in links]
    columns = [own.index(name) for name in trajectory.joint_names]
    kinematics, (positions, velocities) = Kinematics(robot), np.zeros((2, len(own)))
    found = sample(trajectory, trajectory.times)
    shape = len(trajectory.times), len(links)
    poses, twists = np.empty((*shape, 7)), np.empty((*shape, 6))
    base_poses, base_twists = trajectory.base_poses, found.base_twists
    assert base_poses is not None and base_twists is not None
    base_twists = _between(base_twists)
    joint_velocities = trajectory.velocities
    if joint_velocities is None:
        joint_velocities = _between(found.velocities)
    for number, base in enumerate(base_poses):
        positions[columns] = trajectory.positions[number]
        velocities[columns] = joint_velocities[number]
        all_poses, all_twists = kinematics.link_states(
            base, positions, base_twists[number], velocities
        )
        poses[number], twists[number] = all_poses[rows], all_twists[rows]
        poses[number, 0] = base
    return poses, twists


def _between(differences: np.ndarray) -> np.ndarray:
    """Find velocities at samples from those behind them; behind the last is none.

    Args:
        differences: Velocities between each sample and the next, shape (n, ...).
    """
    if len(differences) < 2:
        return differences
    behind = np.concatenate([differences[:-1], differences[-2:-1]])
    before = np.concatenate([behind[:1], behind[:-1]])
    return 0.5 * (before + behind)
