"""The configuration of a motion at any time.

Joints follow cubic Hermite polynomials where the motion has velocities, else straight
lines; the base moves in straight lines and turns at a constant rate about one axis
between two samples (slerp). Before its beginning and after its end the motion rests,
but for the velocities of a single sample, which it has for ``SINGLE_TIME``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from g1_description.core.rotation import multiply, rotate, shorter_turn

from .trajectory import Trajectory

SNAP = 0.5e-9
"""A time this near to that of a sample is that of the sample, in [s]: stamps count in
nanoseconds."""


@dataclass(frozen=True, eq=False)
class Sample:
    """Configurations and how they change, at one or several times."""

    positions: np.ndarray
    """Of the motion's joints in [rad] or [m], shape (..., n_joints)."""

    velocities: np.ndarray
    """In [rad/s] or [m/s], shape (..., n_joints)."""

    base_poses: np.ndarray | None
    """T_map_base, shape (..., 7); None where the motion has no base."""

    base_twists: np.ndarray | None
    """Linear velocity of the base's origin and its angular velocity, along the map's
    axes, in [m/s] and [rad/s], shape (..., 6)."""


def sample(trajectory: Trajectory, times: np.ndarray | float) -> Sample:
    """Interpolate a motion.

    Args:
        trajectory: The motion.
        times: Since its beginning in [s], shape (...).

    Returns:
        The configurations. At the time of a sample they are the sample to the last
        bit; the velocities there are those of what follows.
    """
    found = np.asarray(times, dtype=float)
    if len(trajectory.times) == 1:
        return _single(trajectory, found)
    first, last, gaps, moves = _segments(trajectory.times, found)
    elapsed = found - trajectory.times[first]
    share = np.where(moves & (elapsed > SNAP), elapsed, 0.0) / gaps
    positions, velocities = _joints(trajectory, first, last, share, gaps)
    velocities = np.where(moves[..., np.newaxis], velocities, 0.0)
    if trajectory.base_poses is None:
        return Sample(positions, velocities, None, None)
    begin, end = trajectory.base_poses[first], trajectory.base_poses[last]
    poses, twists = _base(begin, end, share, gaps)
    return Sample(
        positions, velocities, poses, np.where(moves[..., np.newaxis], twists, 0.0)
    )


def _single(trajectory: Trajectory, times: np.ndarray) -> Sample:
    """Return the only sample of a motion, which moves for ``SINGLE_TIME`` at most."""
    n_joints = len(trajectory.joint_names)
    positions = np.broadcast_to(trajectory.positions[0], (*times.shape, n_joints))
    velocities = np.zeros(positions.shape)
    if trajectory.velocities is not None:
        is_shown = times > trajectory.duration - SNAP
        is_shown &= times < trajectory.rest_time
        velocities[is_shown] = trajectory.velocities[0]
    if trajectory.base_poses is None:
        return Sample(positions, velocities, None, None)
    poses = np.broadcast_to(trajectory.base_poses[0], (*times.shape, 7))
    return Sample(positions, velocities, poses, np.zeros((*times.shape, 6)))


def _segments(
    knots: np.ndarray, times: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Find between which samples times are.

    Returns:
        The sample at or before each time and the one after it, the time between them
        in [s], 1 where there is none, and whether the motion moves then.
    """
    first = np.searchsorted(knots, times + SNAP, side="right") - 1
    moves = (first >= 0) & (first < len(knots) - 1)
    first = np.minimum(np.maximum(first, 0), len(knots) - 1)  # np.clip is slow
    last = np.minimum(first + 1, len(knots) - 1)
    return first, last, np.where(moves, knots[last] - knots[first], 1.0), moves


def _joints(
    trajectory: Trajectory,
    first: np.ndarray,
    last: np.ndarray,
    share: np.ndarray,
    gaps: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Interpolate the joints; return positions and velocities."""
    s, h = share[..., np.newaxis], gaps[..., np.newaxis]
    p0, p1 = trajectory.positions[first], trajectory.positions[last]
    if trajectory.velocities is None:
        return p0 + s * (p1 - p0), (p1 - p0) / h
    # Cubic Hermite polynomial on [0, 1], and its derivative.
    v0, v1 = h * trajectory.velocities[first], h * trajectory.velocities[last]
    step = p1 - p0
    square, cube = 3.0 * step - 2.0 * v0 - v1, v0 + v1 - 2.0 * step
    positions = p0 + s * (v0 + s * (square + s * cube))
    return positions, (v0 + s * (2.0 * square + 3.0 * s * cube)) / h


def _base(
    begin: np.ndarray, end: np.ndarray, share: np.ndarray, gaps: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Interpolate the base's pose; return poses and twists."""
    s, h = share[..., np.newaxis], gaps[..., np.newaxis]
    offset = end[..., :3] - begin[..., :3]
    axis, half = shorter_turn(begin[..., 3:], end[..., 3:])
    part = np.concatenate([np.sin(s * half) * axis, np.cos(s * half)], axis=-1)
    poses = np.concatenate(
        [begin[..., :3] + s * offset, multiply(begin[..., 3:], part)], axis=-1
    )
    spin = rotate(begin[..., 3:], 2.0 * half * axis)
    return poses, np.concatenate([offset, spin], axis=-1) / h
