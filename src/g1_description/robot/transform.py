"""Poses as rows of seven numbers: x, y, z and a unit quaternion (x, y, z, w).

This is the order of geometry_msgs/Pose in serialized messages. ``T_a_b`` takes b
coordinates to a; positions are in [m].
"""

from __future__ import annotations

import numpy as np

from g1_description.robot.rotation import IDENTITY as IDENTITY_ROTATION
from g1_description.robot.rotation import conjugate, multiply, rotate

IDENTITY = np.concatenate([np.zeros(3), IDENTITY_ROTATION])
IDENTITY.setflags(write=False)


def translation(place: np.ndarray) -> np.ndarray:
    """Return a translation in [m], shape (3,), as a pose, shape (7,)."""
    return np.concatenate([place, IDENTITY_ROTATION])


def compose(T_a_b: np.ndarray, T_b_c: np.ndarray) -> np.ndarray:
    """Chain two transforms.

    Args:
        T_a_b: Poses of frame b in frame a, shape (..., 7).
        T_b_c: Poses of frame c in frame b, shape (..., 7).

    Returns:
        T_a_c, shape (..., 7).
    """
    position = T_a_b[..., :3] + rotate(T_a_b[..., 3:], T_b_c[..., :3])
    rotation = multiply(T_a_b[..., 3:], T_b_c[..., 3:])
    return np.concatenate([position, rotation], axis=-1)


def inverse(T_a_b: np.ndarray) -> np.ndarray:
    """Invert T_a_b to T_b_a.

    Args:
        T_a_b: Poses, shape (..., 7).

    Returns:
        T_b_a, shape (..., 7).
    """
    q_b_a = conjugate(T_a_b[..., 3:])
    return np.concatenate([-rotate(q_b_a, T_a_b[..., :3]), q_b_a], axis=-1)
