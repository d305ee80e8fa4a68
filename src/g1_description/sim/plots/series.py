"""Series of numbers over time, made ready to be drawn."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from g1_description.core.robot.description import Joint

MAX_BINS = 1200
"""In how many pieces a long series is cut: a picture has no more columns of pixels."""

LEAST_WIDTH = 0.003
"""Least width of a marked time, as a share of the picture's."""


def thinned(times: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Leave out of a long series what no picture shows.

    Args:
        times: In [s], rising, shape (n,).
        values: Shape (n,); NaN where there is none.

    Returns:
        Times and values; of each piece of a long series the least and the largest one,
        so that peaks stay.
    """
    if len(times) <= 4 * MAX_BINS:
        return times, values
    size = -(-len(times) // MAX_BINS)
    whole = len(times) // size * size
    bins = values[:whole].reshape(-1, size)
    low = np.fmin.reduce(bins, axis=1)
    high = np.fmax.reduce(bins, axis=1)
    starts = times[:whole].reshape(-1, size)[:, 0]
    found = np.stack([low, high], axis=1).ravel()
    return (
        np.append(np.repeat(starts, 2), times[whole:]),
        np.append(found, values[whole:]),
    )


def in_limits(joint: Joint, positions: np.ndarray) -> np.ndarray:
    """Scale positions so that the lower limit is at -1 and the upper one at 1.

    Args:
        joint: The joint; without limits its largest distance from zero is taken.
        positions: In [rad] or [m], shape (n,).
    """
    lower, upper = joint.lower, joint.upper
    if not (np.isfinite(lower) and np.isfinite(upper)):
        most = float(np.abs(positions).max()) or 1.0
        lower, upper = -most, most
    middle, half = (lower + upper) / 2.0, (upper - lower) / 2.0
    return (positions - middle) / (half or 1.0)


def bars(
    intervals: Iterable[Sequence[float]], times: np.ndarray
) -> list[tuple[float, float]]:
    """Return beginnings and widths of stretches, wide enough to be seen.

    Args:
        intervals: First and last times of each, in [s]; they may overlap.
        times: Of the whole motion in [s], shape (n,).
    """
    least = LEAST_WIDTH * (float(times[-1] - times[0]) or 1.0)
    joined: list[list[float]] = []
    for first, last in sorted((float(first), float(last)) for first, last in intervals):
        lack = max(0.0, least - (last - first)) / 2.0
        if joined and first - lack <= joined[-1][1]:
            joined[-1][1] = max(joined[-1][1], last + lack)
        else:
            joined.append([first - lack, last + lack])
    return [(first, last - first) for first, last in joined]
