"""Masses, inertias and friction of links, the same in all engines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from g1_description.robot.description import Inertial, Link
from g1_description.robot.lumping import is_positive

DEFAULT_FRICTION = 1.0
"""Default coefficient of friction, as in Gazebo."""

UNKNOWN = Inertial(1.0, np.zeros(3), np.eye(3))
"""Mass properties of links without any, which occur only in kinematic physics: PyBullet
finds no contacts without a mass."""


def inertial_of(link: Link) -> Inertial:
    """Return the mass properties of a link, an impossible inertia as Gazebo's ODE."""
    inertial = link.inertial or UNKNOWN
    if is_positive(inertial.inertia):
        return inertial
    return replace(inertial, inertia=np.eye(3))


def principal_axes(inertia: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute principal moments and axes of inertia.

    Args:
        inertia: Tensor in [kg m^2], shape (3, 3).

    Returns:
        Principal moments in [kg m^2], shape (3,), and the principal axes as the
        columns of a rotation matrix, shape (3, 3).
    """
    moments, axes = np.linalg.eigh(inertia)
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    return moments, axes
