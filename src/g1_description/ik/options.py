"""Options of inverse kinematics, and their checks."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from g1_description.errors import InvalidValueError
from g1_description.ik.limits import Limit
from g1_description.ik.solver import Configuration
from g1_description.ik.targets import FARTHEST, Target, is_number
from g1_description.scenes.scene import Scene
from g1_description.text import listed

BALANCE_MARGIN, BALANCE_SHARE = 0.03, 0.5
"""Least distance of the centre of mass from the edges of the support polygon by
default, in [m], and the most of the distance of its middle from them that this is."""

ZMP = "zmp"
"""Balance of the zero-moment point."""

MAX_WEIGHT = 10.0
"""Largest weight of a target: a tenth of that of fixed links."""

BELOW = 0.01
"""Depth below a floor up to which fixed links stand on it, in [m]."""

BASES = {
    "free": np.ones(6),
    "planar": np.array([1.0, 1.0, 0.0, 0.0, 0.0, 1.0]),
    "fixed": np.zeros(6),
}
"""How the base may move: along and about the world's axes."""


@dataclass(frozen=True)
class IkOptions:
    """Conditions on a configuration, besides the limits of joints."""

    fixed_links: Collection[str] | None = None
    """Links that stay, by name or role; None: the feet of the robot's profile, as far
    as they have no target."""

    balance: float | str | None = False
    """By how much in [m] the centre of mass must be inside the edges of the links that
    stand on the floor. True: ``BALANCE_MARGIN``, less where they are narrow; None,
    False and 0: anywhere. ``ZMP``: so is the zero-moment point of a trajectory."""

    avoid_collisions: bool = False
    """Whether links keep away from each other."""

    floor: float | None = None
    """Height in [m] below which no link gets, except fixed ones; None: no floor."""

    base_motion: str | None = None
    """How the base moves, one of ``BASES``; None: freely if a link is fixed or a foot
    has a target, else not at all. A base that the robot's file fixes to the world never
    moves."""

    weights: Mapping[str, float] | None = None
    """Weights of targets, by default 1; infinite: others must not disturb it."""

    points: Mapping[str, Any] | None = None
    """Points of links that are brought to their targets, x y z in the frame of the
    link; by default its origin."""

    limits: Sequence[Limit] = ()
    """Further limits; see ``ik.limits.Limit``."""

    scene: Scene | None = None
    """Objects from which links keep away."""

    def __post_init__(self) -> None:
        """Refuse values that mean something else than they say.

        Raises:
            InvalidValueError: If balance is no length, avoid_collisions no boolean, or
                limits are no limits.
        """
        balance, flags = self.balance, (bool, np.bool_, type(None))
        is_margin = is_number(balance) and 0.0 <= float(balance or 0.0) <= 1.0
        if not (is_margin or isinstance(balance, flags) or str(balance) == ZMP):
            raise InvalidValueError(
                f"balance must be True, False, '{ZMP}' or a margin in m, from 0 to 1 "
                f"(got {str(balance)[:80]})."
            )
        if not isinstance(self.avoid_collisions, (bool, np.bool_)):
            raise InvalidValueError(
                "avoid_collisions must be True or False (got "
                f"{str(self.avoid_collisions)[:80]})."
            )
        if not isinstance(self.scene, (Scene, type(None))):
            raise InvalidValueError(
                f"scene must be a Scene or None (got {str(self.scene)[:80]}): read a "
                "file with Scene.read."
            )
        methods = "approach", "excess_message"
        if not isinstance(self.limits, Sequence) or not all(
            hasattr(limit, method) for limit in self.limits for method in methods
        ):
            raise InvalidValueError(
                f"limits must be a list of objects with the methods {listed(methods)} "
                f"(got {str(self.limits)[:80]})."
            )


def link_names(given: Any) -> list[str]:
    """Read names of links."""
    is_list = isinstance(given, Iterable) and not isinstance(given, str)
    names = [*given] if is_list else [given]
    if not all(isinstance(name, str) for name in names):
        raise InvalidValueError(
            f"fixed_links must be names or roles of links (got {str(given)[:80]})."
        )
    return names


def floor_height(given: Any, start: Configuration) -> float | None:
    """Read the height of the floor."""
    if given is None:
        return None
    if not is_number(given) or not np.isfinite(given):
        raise InvalidValueError(
            f"floor must be the height of the floor in m, or None (got {given})."
        )
    above = float(given) - float(start.root[2])
    if above > FARTHEST:
        raise InvalidValueError(
            f"floor is {above:.3g} m above the robot: it is in m, at most "
            f"{FARTHEST:g} m above."
        )
    return float(given)


def target_weight(name: str, given: Any) -> float:
    """Read the weight of a target."""
    weight = float(given) if is_number(given) else 0.0
    if not weight > 0.0:
        raise InvalidValueError(
            f"The weight of {name} must be a number greater than 0 (got {given})."
        )
    return weight


def has_carried(targets: Mapping[str, Any], scene: Scene | None) -> bool:
    """Return whether a target is relative to an object that links carry."""
    given = targets.values() if isinstance(targets, Mapping) else ()
    names = [str(one.relative_to) for one in given if isinstance(one, Target)]
    return any(scene and n in scene and scene[n].attachments for n in names)
