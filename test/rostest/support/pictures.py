"""Compare pictures of a page: uint8, shape (height, width, 3), RGB."""

from __future__ import annotations

import numpy as np
from PIL import Image

TOLERANCE = 8
"""Difference of a colour that nobody sees, of 255: edges are smoothed, lights round."""


def changed(one, other, tolerance=TOLERANCE):
    """Mark pixels that differ by more than a tolerance: bool, (height, width)."""
    if one.shape != other.shape:
        raise AssertionError(
            f"pictures of {one.shape} and {other.shape} do not compare"
        )
    return (np.abs(one.astype(int) - other) > tolerance).any(axis=2)


def share_changed(one, other, tolerance=TOLERANCE):
    """Give the share of the pixels that differ by more than a tolerance: 0 to 1."""
    return float(changed(one, other, tolerance).mean())


def read_picture(path):
    """Read a file."""
    with Image.open(path) as picture:
        return np.asarray(picture.convert("RGB"))
