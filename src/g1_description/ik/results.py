"""Results of inverse kinematics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from g1_description.ik.solver import TOLERANCE


class TargetError(NamedTuple):
    """How far a link is from its target."""

    position: float | None
    """In [m]; None: any position will do."""

    rotation: float | None
    """In [rad], or the angle between an axis and its aim; None: any rotation will
    do."""

    @property
    def normalized(self) -> float:
        """Return the larger part as a multiple of the tolerance."""
        return float((np.array([part or 0.0 for part in self]) / TOLERANCE).max())


@dataclass(frozen=True, eq=False)
class IkResult:
    """The configuration that inverse kinematics found."""

    positions: np.ndarray
    """Positions in [rad] or [m], within the limits, shape (n_joints,)."""

    base: np.ndarray
    """Pose of the base link in the world, shape (7,)."""

    errors: Mapping[str, TargetError]
    """Distances of links from their targets, fixed links included."""

    reached: bool
    """Whether all targets are reached within 1 mm and 0.5 degrees, with balance and
    distances where these are requested."""

    margin: float | None
    """Distance of the centre of mass, or of the zero-moment point where that keeps the
    balance, from the nearest edge of what supports the robot, in [m], negative outside;
    None without balance."""

    steps: int
    """Number of steps of the solver."""

    message: str
    """A sentence on targets that are missed; empty if there is none."""


def error_text(error: TargetError) -> str:
    """Write an error as text."""
    texts = []
    if error.position is not None:
        is_far = error.position >= 1.0
        millimetres = f"{1e3 * error.position:.3g} mm"
        texts.append(f"{error.position:.2f} m" if is_far else millimetres)
    if error.rotation is not None:
        texts.append(f"{np.degrees(error.rotation):.2g} degrees")
    return " and ".join(texts)
