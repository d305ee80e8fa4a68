"""Smooth ways from one joint configuration to another."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from g1_description.core.motion.trajectory import Trajectory

N_SAMPLES = 101
"""Samples of a way: cubic polynomials between them are within 1e-7 of its length."""


def minimum_jerk(start: np.ndarray, goal: np.ndarray, share: float) -> np.ndarray:
    """Give a point of the way that begins and ends at rest with the least jerk.

    Each joint goes straight from start to goal and never beyond either, so what is
    between limits at both ends stays between them.

    Args:
        start: Positions at the beginning in [rad] or [m], shape (n,).
        goal: Positions at the end, shape (n,).
        share: How much of the time is over; below 0 is before, above 1 after.

    Returns:
        Positions, shape (n,).
    """
    t = min(max(share, 0.0), 1.0)
    done = t**3 * (10.0 - 15.0 * t + 6.0 * t**2)
    way = (1.0 - done) * start + done * goal
    return np.clip(way, np.minimum(start, goal), np.maximum(start, goal))


def minimum_jerk_trajectory(
    joint_names: Sequence[str], start: np.ndarray, goal: np.ndarray, seconds: float
) -> Trajectory:
    """Sample the way of all joints, with velocities.

    Args:
        joint_names: The joints.
        start: Their positions at the beginning in [rad] or [m], shape (n,).
        goal: Their positions at the end, shape (n,).
        seconds: How long it takes in [s].
    """
    shares = np.linspace(0.0, 1.0, N_SAMPLES)
    rates = 30.0 * shares**2 * (1.0 - shares) ** 2 / seconds
    return Trajectory(
        shares * seconds,
        tuple(joint_names),
        np.array([minimum_jerk(start, goal, share) for share in shares.tolist()]),
        np.outer(rates, goal - start),
    )
