"""Inertials: what one cannot be, and the sum of several."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from g1_description.core.rotation import to_axes

from .description import Inertial

TRIANGLE_TOLERANCE = 1e-9
"""Relative rounding error allowed in the triangle inequality of the moments: plates
meet it with equality."""


def fault_of(inertial: Inertial) -> str:
    """Return a message on what is wrong with an inertial; empty if nothing is."""
    if inertial.mass == 0.0:
        return "mass 0 with an inertia" if inertial.inertia.any() else ""
    moments = np.linalg.eigvalsh(inertial.inertia)
    listed = ", ".join(f"{moment:.6g}" for moment in moments)
    if moments[0] <= 0.0:
        return f"inertia is not positive, principal moments {listed}"
    if moments[2] > (moments[0] + moments[1]) * (1.0 + TRIANGLE_TOLERANCE):
        return f"inertia breaks the triangle inequality, principal moments {listed}"
    return ""


def combine_inertials(
    parts: Iterable[tuple[Inertial, np.ndarray]],
) -> Inertial | None:
    """Add up masses that are rigidly connected (parallel-axis theorem).

    Args:
        parts: Inertials with the pose, shape (7,), of their link in the body.

    Returns:
        The inertial of the body, or None where there is no mass at all.
    """
    placed = [
        (part.mass, *_turned(part, pose)) for part, pose in parts if part.mass > 0.0
    ]
    if not placed:
        return None
    mass = sum(part[0] for part in placed)
    center = np.sum([part[0] * part[1] for part in placed], axis=0) / mass
    inertia = np.zeros((3, 3))
    for part_mass, part_center, part_inertia in placed:
        offset = part_center - center
        steiner = offset @ offset * np.eye(3) - np.outer(offset, offset)
        inertia += part_inertia + part_mass * steiner
    return Inertial(mass, center, inertia)


def _turned(part: Inertial, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Write a link's center of mass and inertia in its body's frame."""
    axes = to_axes(pose[3:])
    center = pose[:3] + axes @ part.center_of_mass
    return center, axes @ part.inertia @ axes.T
