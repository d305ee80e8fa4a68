"""How fast links slide on the floor."""

from __future__ import annotations

import numpy as np

from g1_description.core.checks.runs import runs
from g1_description.core.motion.sampling import SNAP

SLIDE_WINDOW = 0.1
"""Over how long a sliding link's speed is averaged, in [s]."""


def sliding_speeds(
    slide: np.ndarray, touches: np.ndarray, times: np.ndarray
) -> np.ndarray:
    """Average how fast links slide, as long as they touch the floor.

    A foot that is put down or lifted moves a little on its last millimetres, which
    counts together with the time that it stands.

    Args:
        slide: Speeds of lowest points along the floor, in [m/s], shape (n, n_links).
        touches: Where they touch the floor, shape (n, n_links).
        times: Of the samples in [s], shape (n,).

    Returns:
        Means over ``SLIDE_WINDOW``, or the whole time of contact where that is shorter,
        in [m/s]; NaN where a link does not touch, shape (n, n_links).
    """
    found = np.full(slide.shape, np.nan)
    for column in np.flatnonzero(touches.any(axis=0)):
        for first, last in runs(touches[:, column]):
            rows = slice(first, last + 1)
            inside = times[rows]
            summed = np.append(0.0, np.cumsum(slide[rows, column]))
            latest = max(inside[0], inside[-1] - SLIDE_WINDOW)
            start = np.clip(inside - SLIDE_WINDOW / 2.0, inside[0], latest)
            begin = np.searchsorted(inside, start - SNAP, side="left")
            end = np.searchsorted(inside, start + SLIDE_WINDOW + SNAP, side="right")
            found[rows, column] = (summed[end] - summed[begin]) / (end - begin)
    return found
