"""Which checks can be made of a motion or a configuration, and why not the others."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from g1_description.checks.frames import Parts
from g1_description.checks.thresholds import LEVELS
from g1_description.errors import UnknownNameError
from g1_description.text import listed, similar_first

GROUND = ("penetration", "floating", "skating")
BALANCE = ("center_of_mass", "zero_moment_point")
RATES = ("velocity", "acceleration", "jerk", "jump", "base_jump")
PHYSICS = ("tracking", "saturation", "fall")
NAMES = tuple(name for name in LEVELS if name not in PHYSICS)
"""Names of the checks that need no simulation."""

NO_BASE = "the motion has no base"
"""Why the floor is not judged."""


@dataclass(frozen=True)
class Plan:
    """What is to be done."""

    made: tuple[str, ...]
    """Names of the checks that are made."""

    skipped: dict[str, str]
    """Names of those that are not, and why not."""

    measured: frozenset[str]
    """What is measured for them: ``contacts``, ``ground``, ``balance``, ``efforts``."""


class Planner:
    """Plans the checks of one robot."""

    def __init__(self, parts: Parts, is_fixed: bool) -> None:
        """Take over the robot.

        Args:
            parts: The robot.
            is_fixed: Whether something holds its base.
        """
        self._parts, self._is_fixed = parts, is_fixed

    def plan(
        self,
        joint_names: Sequence[str],
        only: Collection[str],
        has_base: bool,
        is_single: bool,
        has_velocities: bool,
    ) -> Plan:
        """Plan the checks of a motion.

        Args:
            joint_names: Its joints.
            only: Names of the checks to make; none: all.
            has_base: Whether it says where the base is.
            is_single: Whether it has one sample: it is a configuration.
            has_velocities: Whether it says how fast joints are.

        Raises:
            UnknownNameError: If there is no such check.
        """
        rates = {}
        if is_single:
            rates = dict.fromkeys(RATES, "there is only one configuration")
            if has_velocities:
                del rates["velocity"]
        skipped = self._skipped(has_base, rates)
        for name in ("acceleration", "jerk"):
            bounds = getattr(self._parts.thresholds, f"{name}_bounds").of(joint_names)
            if not np.isfinite(bounds).any():
                skipped.setdefault(name, "no bounds are given")
        return _plan(only, skipped)

    def _skipped(self, has_base: bool, rates: dict[str, str]) -> dict[str, str]:
        """Name the checks that cannot be made, and why not."""
        parts = self._parts
        skipped = {
            name: "it has no threshold"
            for name in NAMES
            if not getattr(parts.thresholds, name).is_judged
        }
        skipped.update(rates)
        has_mass = parts.masses.total > 0.0
        if not has_mass:
            skipped["effort"] = "the robot has no mass"
        elif not self._is_fixed:
            skipped["effort"] = "the base is free; only physics tells"
        if not parts.collisions.pairs:
            skipped["self_collision"] = "the robot has no two shapes that could touch"
        why = self._no_ground(has_base)
        if why:
            skipped.update(dict.fromkeys((*GROUND, *BALANCE, "base_jump"), why))
        elif not has_mass:
            skipped.update(dict.fromkeys(BALANCE, "the robot has no mass"))
        return skipped

    def _no_ground(self, has_base: bool) -> str:
        """Tell why nothing can be said of the floor; empty if something can."""
        if self._is_fixed:
            return "the base is fixed"
        if not has_base:
            return NO_BASE
        return "" if self._parts.ground_links else "the robot has no shapes"


def _plan(only: Collection[str], skipped: dict[str, str]) -> Plan:
    """Leave out what is not wanted, and what cannot be done."""
    for name in only:
        if name not in NAMES:
            known = listed(similar_first(name, NAMES))
            raise UnknownNameError(f"There is no check {name}; there are {known}.")
    wanted = [name for name in NAMES if not only or name in only]
    made = tuple(name for name in wanted if name not in skipped)
    left_out = {name: skipped[name] for name in wanted if name in skipped}
    return Plan(made, left_out, _measured(made))


def _measured(made: Collection[str]) -> frozenset[str]:
    """Name what must be measured for some checks."""
    wanted = set()
    if "self_collision" in made:
        wanted.add("contacts")
    if {*GROUND, *BALANCE} & {*made}:
        wanted.add("ground")
    if {*BALANCE, "floating"} & {*made}:
        wanted.add("balance")
    if "effort" in made:
        wanted.add("efforts")
    return frozenset(wanted)
