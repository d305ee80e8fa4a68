"""Inertials: what one cannot be, and the sum of several."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from g1_description.core.rotation import to_axes
from g1_description.core.text import listed

from .description import Inertial, Link

TOLERANCE = 1e-9
"""Relative rounding error of the moments: plates meet the triangle inequality with
equality, and the least moment of a singular tensor is not quite zero."""


def is_positive(inertia: np.ndarray) -> bool:
    """Return whether a tensor, shape (3, 3), is positive definite."""
    least, _, most = np.linalg.eigvalsh(inertia)
    return bool(least > max(TOLERANCE * most, 0.0))


def impossible_inertias(links: Iterable[Link]) -> tuple[str, ...]:
    """Return messages on links of which physics cannot, or should not, use the inertia.

    Gazebo's ODE takes 1 kg m^2 about each axis for a tensor that is not positive
    definite, and any other as it is.
    """
    found: dict[bool, list[str]] = {False: [], True: []}
    for link in links:
        if link.inertial and fault_of(link.inertial):
            found[is_positive(link.inertial.inertia)].append(link.name)
    why = {
        False: "is not positive definite; 1 kg m^2 about each axis is used, as in "
        "Gazebo",
        True: "violates the triangle inequality; used as it is",
    }
    return tuple(
        f"inertia of {listed(names)} {why[positive]}"
        for positive, names in found.items()
        if names
    )


def fault_of(inertial: Inertial) -> str:
    """Return a message on what is wrong with an inertial; empty if nothing is."""
    if inertial.mass == 0.0:
        return "mass 0 with an inertia" if inertial.inertia.any() else ""
    moments = np.linalg.eigvalsh(inertial.inertia)
    listed = ", ".join(f"{moment:.6g}" for moment in moments)
    if not is_positive(inertial.inertia):
        return f"inertia is not positive, principal moments {listed}"
    if moments[2] > (moments[0] + moments[1]) * (1.0 + TOLERANCE):
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
