"""The numbers that a robot can have, whatever format its file has."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .errors import LARGEST, DescriptionError


def checked(what: str, numbers: Sequence[float], least: float = -LARGEST) -> np.ndarray:
    """Check that numbers are some that a robot can have.

    Raises:
        DescriptionError: If one is NaN, or out of bounds.
    """
    array = np.array(numbers, dtype=float)
    if not ((array >= least) & (array <= LARGEST)).all():
        raise DescriptionError(
            f"{what[0].upper()}{what[1:]} has the numbers {array.tolist()}, "
            f"not all are from {least:g} to {LARGEST:g}."
        )
    return array
