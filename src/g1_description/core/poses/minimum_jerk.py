"""Smooth ways from one joint configuration to another."""

from __future__ import annotations

import numpy as np


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
