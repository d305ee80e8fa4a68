"""What an inertia cannot be."""

from __future__ import annotations

import numpy as np

from .description import Inertial

ROUNDING = 1e-9
"""Share by which a sum of moments may be missed and still hold."""


def fault_of(inertial: Inertial) -> str:
    """Say what is wrong with an inertial; empty if nothing is."""
    if inertial.mass == 0.0:
        return "mass 0 with an inertia" if inertial.inertia.any() else ""
    moments = np.linalg.eigvalsh(inertial.inertia)
    told = ", ".join(f"{moment:.6g}" for moment in moments)
    if moments[0] <= 0.0:
        return f"inertia is not positive, principal moments {told}"
    if moments[2] > (moments[0] + moments[1]) * (1.0 + ROUNDING):
        return f"inertia breaks the triangle inequality, principal moments {told}"
    return ""
