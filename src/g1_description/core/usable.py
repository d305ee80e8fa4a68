"""Whether numbers that came from elsewhere can be a robot's."""

from __future__ import annotations

import numpy as np

from .errors import LARGEST

NOT_UNIT = 1e-3
"""A quaternion whose length differs from 1 by more is none."""


def all_usable(lengths: np.ndarray, poses: np.ndarray, twists: np.ndarray) -> bool:
    """Tell whether all links have numbers that a robot can have; NaN is none."""
    if not len(lengths):
        return True
    deviation = np.abs(lengths - 1.0).max()
    largest = np.abs(poses).max(), np.abs(twists).max()
    return bool(
        deviation <= NOT_UNIT and largest[0] <= LARGEST and largest[1] <= LARGEST
    )


def usable_rows(
    lengths: np.ndarray, poses: np.ndarray, twists: np.ndarray
) -> np.ndarray:
    """Tell which links have numbers that a robot can have, shape (n_links,)."""
    with np.errstate(invalid="ignore"):
        sizes = np.abs(np.concatenate([poses, twists], axis=1)).max(axis=1)
        return (np.abs(lengths - 1.0) <= NOT_UNIT) & (sizes <= LARGEST)
