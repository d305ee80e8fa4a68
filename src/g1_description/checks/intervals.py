"""Intervals of samples and of time in which a condition holds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

GAP = 0.1
"""Longest time between findings of one cause, in [s]."""


def runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """List the intervals of samples in which a condition holds.

    Args:
        mask: Where it holds, shape (n_samples,).

    Returns:
        First and last sample of each.
    """
    edges = np.diff(np.concatenate([[0], mask.astype(int), [0]]))
    firsts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return [*zip(firsts.tolist(), ends.tolist())]


def intervals(times: np.ndarray, mask: np.ndarray) -> tuple[tuple[float, float], ...]:
    """List the intervals of time in which a condition holds.

    Args:
        times: Times of the samples in [s], rising, shape (n_samples,).
        mask: Where it holds, shape (n_samples,).

    Returns:
        First and last times of each, in [s].
    """
    return tuple((float(times[a]), float(times[b])) for a, b in runs(mask))


def without_short(times: np.ndarray, mask: np.ndarray, shortest: float) -> np.ndarray:
    """Remove the intervals that are shorter than a time, but not one of all samples.

    Args:
        times: Times of the samples in [s], rising, shape (n_samples,).
        mask: Where a condition holds, shape (n_samples,).
        shortest: In [s].
    """
    kept = mask.copy()
    for first, last in runs(mask):
        is_part = last - first < len(times) - 1
        if is_part and times[last] - times[first] < shortest:
            kept[first : last + 1] = False
    return kept


def around(n_samples: int, begins: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Mark the samples of many intervals, which may overlap.

    Args:
        n_samples: Number of samples.
        begins: First samples, shape (k,).
        ends: The samples behind the last ones, shape (k,).

    Returns:
        Shape (n_samples,).
    """
    edges = np.zeros(n_samples + 1, dtype=int)
    np.add.at(edges, np.clip(begins, 0, n_samples), 1)
    np.add.at(edges, np.clip(ends, 0, n_samples), -1)
    return np.cumsum(edges)[:-1] > 0


def near(
    times: np.ndarray, spans: Sequence[tuple[float, float]], reach: float
) -> np.ndarray:
    """Mark the samples near intervals of time.

    Args:
        times: Times of the samples in [s], rising, shape (n_samples,).
        spans: First and last times in [s].
        reach: Time before and after each, in [s].

    Returns:
        Shape (n_samples,).
    """
    firsts, lasts = np.reshape(spans, (-1, 2)).T
    begins = np.searchsorted(times, firsts - reach, "left")
    return around(len(times), begins, np.searchsorted(times, lasts + reach, "right"))


def time_share(times: np.ndarray, mask: np.ndarray) -> float:
    """Compute the fraction of the time in which a condition holds, from 0 to 1.

    Each sample stands for the time that is nearer to it than to others.

    Args:
        times: Times of the samples in [s], rising, shape (n_samples,).
        mask: Where it holds, shape (n_samples,).
    """
    if len(times) == 1:
        return float(mask[0])
    between = np.concatenate([times[:1], (times[1:] + times[:-1]) / 2.0, times[-1:]])
    return float(np.diff(between)[mask].sum() / (times[-1] - times[0]))
