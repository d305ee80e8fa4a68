"""Edited motions: cut, scaled in time, moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from g1_description.errors import InvalidValueError
from g1_description.motion.motion import SNAP, Motion, sample
from g1_description.robot.rotation import rotate
from g1_description.robot.transform import compose, inverse


def cut(
    trajectory: Motion, begin: float | None = None, end: float | None = None
) -> Motion:
    """Cut a part out of a motion.

    Args:
        trajectory: The motion.
        begin: Start of the part, in [s], where a sample is inserted; None: that of the
            motion.
        end: End of the part, in [s]; None: that of the motion.

    Returns:
        The part, with the motion's own times.

    Raises:
        InvalidValueError: If the part is not inside the motion.
    """
    first, last = float(trajectory.times[0]), trajectory.duration
    begin, end = (first if begin is None else begin), (last if end is None else end)
    if not first <= begin <= end <= last:
        raise InvalidValueError(
            f"The requested range {begin:g}-{end:g} s is outside the motion "
            f"({first:g}-{last:g} s)."
        )
    inside = (trajectory.times > begin + SNAP) & (trajectory.times < end - SNAP)
    ends = np.unique([begin, end])
    times = np.concatenate([ends[:1], trajectory.times[inside], ends[1:]])
    found = sample(trajectory, times)
    velocities = found.velocities
    if trajectory.velocities is not None and end == last:
        velocities[-1] = trajectory.velocities[-1]
    return replace(
        trajectory,
        times=times,
        positions=found.positions,
        velocities=None if trajectory.velocities is None else velocities,
        base_poses=found.base_poses,
    )


def at_speed(trajectory: Motion, speed: float, start: float = 0.0) -> Motion:
    """Scale the speed of a motion.

    Args:
        trajectory: The motion.
        speed: Seconds of the motion in a second, positive.
        start: Time of the motion that becomes zero, in [s].
    """
    velocities = trajectory.velocities
    return replace(
        trajectory,
        times=(trajectory.times - start) / speed,
        velocities=None if velocities is None else speed * velocities,
    )


def later(trajectory: Motion, lead_in: float) -> Motion:
    """Delay a motion, so that the robot can move to the first sample and rest there.

    Args:
        trajectory: The motion.
        lead_in: The delay in [s]; 0: the motion is returned unchanged.
    """
    if not lead_in:
        return trajectory
    velocities = trajectory.velocities
    if velocities is not None:
        velocities = np.vstack([np.zeros_like(velocities[:1]), velocities[1:]])
    return replace(trajectory, times=trajectory.times + lead_in, velocities=velocities)


def moved(trajectory: Motion, T_map_motion: np.ndarray) -> Motion:
    """Move the base of a motion as a whole.

    Args:
        trajectory: The motion.
        T_map_motion: New pose of the motion's origin in the map, shape (7,).
    """
    if trajectory.base_poses is None:
        return trajectory
    return replace(trajectory, base_poses=compose(T_map_motion, trajectory.base_poses))


def to_start_at(trajectory: Motion, pose: np.ndarray) -> Motion:
    """Move a motion so that it starts at a position and yaw.

    Height, roll and pitch of the motion are kept.

    Args:
        trajectory: The motion.
        pose: Of the base in the map, shape (7,).
    """
    if trajectory.base_poses is None:
        return trajectory
    T_map_motion = compose(
        _on_floor(pose), inverse(_on_floor(trajectory.base_poses[0]))
    )
    return moved(trajectory, T_map_motion)


def _on_floor(pose: np.ndarray) -> np.ndarray:
    """Project a pose to the floor: its position, and the heading of its x axis."""
    forward = rotate(pose[3:], np.array([1.0, 0.0, 0.0]))
    half = 0.5 * np.arctan2(forward[1], forward[0])
    return np.array([pose[0], pose[1], 0.0, 0.0, 0.0, np.sin(half), np.cos(half)])


N_SAMPLES = 101
"""Samples of a path: cubic polynomials between them are within 1e-7 of its length."""


def minimum_jerk(start: np.ndarray, goal: np.ndarray, fraction: float) -> np.ndarray:
    """Compute a point of the minimum-jerk path between two configurations.

    Each joint stays between start and goal, so limits that hold at both ends hold
    everywhere.

    Args:
        start: Positions at the beginning in [rad] or [m], shape (n,).
        goal: Positions at the end, shape (n,).
        fraction: Fraction of the time, clamped to 0 to 1.

    Returns:
        Positions, shape (n,).
    """
    t = min(max(fraction, 0.0), 1.0)
    done = t**3 * (10.0 - 15.0 * t + 6.0 * t**2)
    path = (1.0 - done) * start + done * goal
    return np.clip(path, np.minimum(start, goal), np.maximum(start, goal))


def minimum_jerk_trajectory(
    joint_names: Sequence[str], start: np.ndarray, goal: np.ndarray, seconds: float
) -> Motion:
    """Sample a minimum-jerk path of joints, with velocities.

    Args:
        joint_names: The joints.
        start: Their positions at the beginning in [rad] or [m], shape (n,).
        goal: Their positions at the end, shape (n,).
        seconds: Duration in [s].
    """
    fractions = np.linspace(0.0, 1.0, N_SAMPLES)
    rates = 30.0 * fractions**2 * (1.0 - fractions) ** 2 / seconds
    return Motion(
        fractions * seconds,
        tuple(joint_names),
        np.array(
            [minimum_jerk(start, goal, fraction) for fraction in fractions.tolist()]
        ),
        np.outer(rates, goal - start),
    )
