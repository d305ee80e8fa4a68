"""All checks of one robot: of motions, and of single configurations."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from g1_description.core.checks.ground import (
    Ground,
)
from g1_description.core.checks.states import States, states_of
from g1_description.core.checks.thresholds import LEVELS, Thresholds
from g1_description.core.checks.verdict import (
    Verdict,
    judge,
    sorted_findings,
)
from g1_description.core.dynamics.masses import Masses
from g1_description.core.errors import UnknownNameError
from g1_description.core.motion.motion import Motion
from g1_description.core.motion.trajectory import Trajectory
from g1_description.core.robot.assembly import WORLD
from g1_description.core.robot.description import Description
from g1_description.core.robot.kinematics import Kinematics
from g1_description.core.text import listed, similar_first
from g1_description.sim.collisions.self_collisions import SelfCollisions

from .collision_faults import deepest
from .faults import all_faults
from .frames import Frames, Parts, measure
from .outlines import outlines_of
from .robot_collisions import collisions_of
from .timeline import Timeline, bearing, figures

GROUND = ("penetration", "floating", "skating")
BALANCE = ("center_of_mass", "zero_moment_point")
RATES = ("velocity", "acceleration", "jerk", "jump", "base_jump")
PHYSICS = ("tracking", "saturation", "fall")
NAMES = tuple(name for name in LEVELS if name not in PHYSICS)
"""Names of the checks that need no simulation."""


@dataclass(frozen=True, eq=False)
class Judged:
    """A verdict, and what it was found from."""

    verdict: Verdict
    timeline: Timeline


class Checker:
    """Checks motions and configurations of one robot."""

    def __init__(
        self,
        description: Description,
        collisions: SelfCollisions,
        thresholds: Thresholds | None = None,
        fixed_base: bool = False,
    ) -> None:
        """Prepare all that does not depend on a motion.

        Args:
            description: The robot.
            collisions: Its shapes and the pairs of links that may touch.
            thresholds: What is a warning and what a failure.
            fixed_base: Whether something holds the base, so that efforts are known.
        """
        self.description = description
        self.thresholds = thresholds or Thresholds()
        self.notes: tuple[str, ...] = ()
        """Messages on what was assumed of the robot."""
        self.collisions = collisions
        self._is_fixed = fixed_base or description.root == WORLD
        names = [name for name in description.link_names if name != WORLD]
        kinematics = Kinematics(description)
        ground = Ground(
            outlines_of(collisions.shapes), kinematics.end_links(), self.thresholds
        )
        self._ground_links = tuple(names[row] for row in ground.rows)
        self._parts = Parts(
            description.movable_joints,
            self._ground_links,
            kinematics,
            Masses(description),
            ground,
            collisions,
            self.thresholds,
        )

    @classmethod
    def of(
        cls,
        description: Description,
        thresholds: Thresholds | None = None,
        pairs: Path | None = None,
        visual_hulls: bool = True,
        fixed_base: bool = False,
    ) -> Checker:
        """Prepare the checks of a robot, with its file of allowed pairs.

        Args:
            description: The robot.
            thresholds: What is a warning and what a failure.
            pairs: The file; by default that of the G1, and for a robot with other links
                pairs that are found now.
            visual_hulls: Whether links without collision shapes have the hulls of
                their visual ones.
            fixed_base: Whether something holds the base, so that efforts are known.

        Raises:
            AllowedPairsError: If the given file cannot be read, or is another robot's.
        """
        collisions, notes = collisions_of(description, pairs, visual_hulls)
        checker = cls(description, collisions, thresholds, fixed_base)
        checker.notes = notes
        return checker

    def check_state(
        self,
        positions: Mapping[str, float],
        base: np.ndarray | None = None,
        only: Collection[str] = (),
    ) -> Verdict:
        """Judge one configuration at rest.

        Args:
            positions: Of joints in [rad] or [m], by name; the others are at zero.
            base: T_map_base, shape (7,); None where it does not belong to the
                configuration.
            only: Names of the checks to make; none: all.

        Returns:
            The verdict, with all times zero.

        Raises:
            UnknownNameError: If the robot has no such joint, or there is no such check.
            MotionError: If a number is none that a robot can have.
        """
        self._check_joints(positions)
        trajectory = Trajectory(
            np.zeros(1),
            tuple(positions),
            np.array([[*positions.values()]], dtype=float),
            base_poses=None if base is None else np.array([base], dtype=float),
        )
        return self.check_motion(Motion(trajectory), only).verdict

    def check_motion(self, motion: Motion, only: Collection[str] = ()) -> Judged:
        """Judge a motion.

        Args:
            motion: It fits the robot.
            only: Names of the checks to make; none: all.

        Returns:
            The verdict, and what was measured.

        Raises:
            UnknownNameError: If there is no such check.
        """
        _check_names(only)
        trajectory = motion.trajectory
        states = states_of(
            trajectory, self.description, self.thresholds.longest_interval
        )
        skipped = self._skipped(states)
        wanted = [name for name in NAMES if not only or name in only]
        made = [name for name in wanted if name not in skipped]
        frames = measure(states, self._parts, _measured(made))
        timeline = self._timeline(states, frames)
        faults = all_faults(self._parts, states, frames, timeline)
        findings = [
            judge(fault, getattr(self.thresholds, fault.check), states.times)
            for fault in faults
            if fault.check in made
        ]
        verdict = Verdict(
            self.description.name,
            sorted_findings(findings),
            tuple(made),
            {name: skipped[name] for name in wanted if name in skipped},
            figures(states.joints_of(self._parts.joints), timeline),
            bearing(timeline),
            (*self.notes, *motion.notes),
        )
        return Judged(verdict, timeline)

    def _skipped(self, states: States) -> dict[str, str]:
        """Name the checks that cannot be made of a motion, and why not."""
        skipped = {}
        thresholds = self.thresholds
        for name in NAMES:
            if not getattr(thresholds, name).is_judged:
                skipped[name] = "it has no threshold"
        if len(states.times) == 1 and states.trajectory.velocities is None:
            skipped.update(dict.fromkeys(RATES, "there is only one configuration"))
        names = states.trajectory.joint_names
        for name in ("acceleration", "jerk"):
            bounds = getattr(thresholds, f"{name}_bounds").of(names)
            if not np.isfinite(bounds).any():
                skipped.setdefault(name, "no bounds are given")
        if not self._is_fixed:
            skipped["effort"] = "the base is free; only physics tells"
        if not self.collisions.pairs:
            skipped["self_collision"] = "the robot has no two shapes that could touch"
        why = self._no_ground(states)
        if why:
            skipped.update(dict.fromkeys((*GROUND, *BALANCE, "base_jump"), why))
        elif not self._parts.masses.total > 0.0:
            skipped.update(dict.fromkeys(BALANCE, "the robot has no mass"))
        return skipped

    def _no_ground(self, states: States) -> str:
        """Tell why nothing can be said of the floor; empty if something can."""
        if self._is_fixed:
            return "the base is fixed"
        if not states.has_base:
            return "the motion has no base"
        return "" if self._ground_links else "the robot has no shapes"

    def _timeline(self, states: States, frames: Frames) -> Timeline:
        """Gather what was measured at each sample."""
        _, positions, _, velocities = states.at(states.times)
        shown = Timeline(
            states.times,
            states.trajectory.joint_names,
            positions[:, states.columns],
            velocities[:, states.columns],
            deepest(frames.contacts, len(states.times)),
        )
        if frames.ground is None:
            return shown
        return replace(
            shown,
            ground_links=self._ground_links,
            heights=frames.ground.heights,
            bearing=self._parts.ground.bearing(frames.ground, states.times),
            support=tuple(frames.ground.support),
            balance=frames.balance,
        )

    def _check_joints(self, names: Collection[str]) -> None:
        """Check that the robot has all joints."""
        own = [joint.name for joint in self.description.movable_joints]
        for name in names:
            if name not in own:
                raise UnknownNameError(
                    f"{self.description.name} has no movable joint {name}; it has "
                    f"{listed(similar_first(name, own))}."
                )


def _check_names(only: Collection[str]) -> None:
    """Check that there are such checks."""
    for name in only:
        if name not in NAMES:
            known = listed(similar_first(name, NAMES))
            raise UnknownNameError(f"There is no check {name}; there are {known}.")


def _measured(made: Collection[str]) -> set[str]:
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
    return wanted
