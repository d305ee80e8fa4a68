"""Poses as programs give them."""

from __future__ import annotations

from typing import Any

import numpy as np

from g1_description.core.bounds import NORM_TOLERANCE
from g1_description.core.errors import InvalidValueError
from g1_description.core.motion.trajectory import UNIT_TOLERANCE
from g1_description.core.rotation import normalized


def as_poses(given: Any) -> np.ndarray:
    """Check poses of the base.

    Args:
        given: x y z and quaternion x y z w, shape (..., 7).

    Returns:
        A new array of the same shape, with quaternions of unit length.

    Raises:
        InvalidValueError: If they are no poses.
    """
    try:
        poses = np.array(given, dtype=float)
    except (TypeError, ValueError):
        poses = np.zeros(0)
    if poses.shape[-1:] != (7,) or not np.isfinite(poses).all():
        raise InvalidValueError(
            f"The base given is {str(given)[:80]}; a pose is seven finite numbers, "
            "x y z and quaternion x y z w."
        )
    lengths = np.linalg.norm(poses[..., 3:], axis=-1)
    errors = np.abs(lengths - 1.0)
    if (errors > NORM_TOLERANCE).any():
        raise InvalidValueError(
            "The base has a quaternion of length "
            f"{lengths.flat[int(np.argmax(errors))]:.6g}, not 1."
        )
    rounded = errors > UNIT_TOLERANCE
    poses[rounded, 3:] = normalized(poses[rounded, 3:])
    return poses
