"""All checks of one robot: of motions, and of single configurations."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from g1_description.checks.findings import all_faults, deepest
from g1_description.checks.frames import Frames, Parts, measure
from g1_description.checks.ground import Ground, Outline
from g1_description.checks.limits import check_bounds, zero_limits
from g1_description.checks.plan import NAMES, Plan, Planner
from g1_description.checks.states import States, states_of
from g1_description.checks.thresholds import Thresholds, read_thresholds
from g1_description.checks.timeline import Judged, Timeline, bearing, figures
from g1_description.checks.verdict import Verdict, judge, sorted_findings
from g1_description.collisions.allowed_pairs import read_allowed_pairs
from g1_description.collisions.convex_shapes import ConvexShape
from g1_description.collisions.find_pairs import QUICK_SAMPLES, quick_allowed_pairs
from g1_description.collisions.self_collisions import SelfCollisions
from g1_description.errors import AllowedPairsError, UnknownNameError
from g1_description.files.model_files import share_folder
from g1_description.motion.motion import Motion
from g1_description.motion.trajectory import Trajectory
from g1_description.robot.assembly import WORLD, base_of
from g1_description.robot.description import Description
from g1_description.robot.dynamics import Masses
from g1_description.robot.kinematics import Kinematics
from g1_description.text import listed, similar_first

G1_PAIRS = "config/collisions_g1.yaml"
"""The allowed pairs of the G1 and its revisions."""


def collisions_of(
    description: Description, file: Path | None = None, visual_hulls: bool = True
) -> tuple[SelfCollisions, tuple[str, ...]]:
    """Prepare a robot's self-collisions.

    Args:
        description: The robot.
        file: Its allowed pairs. By default those of the G1, and for a robot with other
            links pairs that are found now.
        visual_hulls: Whether links without collision shapes have the hulls of their
            visual ones.

    Returns:
        They, and messages on what was assumed and what could not be read.

    Raises:
        AllowedPairsError: If a file cannot be read, or the given one is another
            robot's.
    """
    if file is not None:
        given = SelfCollisions(description, read_allowed_pairs(file), visual_hulls)
        return given, given.left_out
    known = read_allowed_pairs(share_folder() / G1_PAIRS)
    try:
        own = SelfCollisions(description, known, visual_hulls)
        return own, own.left_out
    except AllowedPairsError:
        found = quick_allowed_pairs(description)
    other = SelfCollisions(description, found, visual_hulls)
    note = (
        f"Which links of {description.name} overlap by design was found in "
        f"{QUICK_SAMPLES} random configurations; collision_pairs makes a file of it."
    )
    return other, (note, *other.left_out)


def outlines_of(shapes: Iterable[ConvexShape]) -> list[Outline]:
    """Outline the shapes that collide: one outline per link and radius.

    Args:
        shapes: Of all links.
    """
    points = defaultdict(list)
    for shape in shapes:
        points[shape.link, shape.radius].append(shape.points)
    return [
        Outline(row, np.concatenate(parts), radius)
        for (row, radius), parts in points.items()
    ]


__all__ = ["NAMES", "Checker", "Judged"]


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
            thresholds: What is a warning and what a failure; None: the defaults.
            fixed_base: Whether something holds the base, so that efforts are known.
        """
        self.description = description
        self.thresholds = thresholds or read_thresholds()
        check_bounds(self.thresholds, description)
        self.notes = zero_limits(description)
        """Messages on what was assumed of the robot."""
        self.collisions = collisions
        names = [name for name in description.link_names if name != WORLD]
        kinematics = Kinematics(description)
        outlines = outlines_of(collisions.shapes)
        ground = Ground(outlines, kinematics.end_links(), self.thresholds)
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
        is_fixed = fixed_base or base_of(description)[0] == WORLD
        self._planner = Planner(self._parts, is_fixed)

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
            thresholds: What is a warning and what a failure; None: the defaults.
            pairs: The file; by default that of the G1, and for a robot with other links
                pairs that are found now.
            visual_hulls: Whether links without collision shapes have the hulls of
                their visual ones.
            fixed_base: Whether something holds the base, so that efforts are known.

        Raises:
            AllowedPairsError: If a file cannot be read, or the given one is another
                robot's.
            ThresholdError: If the file of the defaults cannot be read.
        """
        collisions, notes = collisions_of(description, pairs, visual_hulls)
        checker = cls(description, collisions, thresholds, fixed_base)
        checker.notes = (*checker.notes, *notes)
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
        return self.judge_state(positions, base, only).verdict

    def judge_state(
        self,
        positions: Mapping[str, float],
        base: np.ndarray | None = None,
        only: Collection[str] = (),
        velocities: Mapping[str, float] | None = None,
    ) -> Judged:
        """Judge one configuration, and return what was measured of it as well.

        Args:
            positions: As for ``check_state``.
            base: Likewise.
            only: Likewise.
            velocities: Of the same joints, or none, in [rad/s] or [m/s]: compared with
                their limits; all else is judged as at rest.

        Raises:
            UnknownNameError: As for ``check_state``.
            MotionError: Likewise.
        """
        self._check_names(positions)
        trajectory = _single(positions, base, velocities)
        plan = self._plan(trajectory, only)
        at_rest = Motion(replace(trajectory, velocities=None))
        return self._judge(at_rest, plan, trajectory.velocities)

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
        return self._judge(motion, self._plan(motion.trajectory, only))

    def _plan(self, trajectory: Trajectory, only: Collection[str]) -> Plan:
        """Plan the checks of a motion."""
        return self._planner.plan(
            trajectory.joint_names,
            only,
            trajectory.base_poses is not None,
            len(trajectory.times) == 1,
            trajectory.velocities is not None,
        )

    def _judge(
        self, motion: Motion, plan: Plan, velocities: np.ndarray | None = None
    ) -> Judged:
        """Judge a motion.

        Args:
            motion: It fits the robot.
            plan: Which checks to make.
            velocities: Of its joints at its samples, shape (n, n_joints), to compare
                with their limits instead of the motion's own.
        """
        trajectory = motion.trajectory
        states = states_of(
            trajectory, self.description, self.thresholds.longest_interval
        )
        frames = measure(states, self._parts, plan.measured)
        timeline = self._timeline(states, frames)
        if velocities is not None:
            timeline = replace(timeline, velocities=velocities)
        faults = all_faults(self._parts, states, frames, timeline)
        findings = [
            judge(fault, getattr(self.thresholds, fault.check), states.times)
            for fault in faults
            if fault.check in plan.made
        ]
        verdict = Verdict(
            self.description.name,
            sorted_findings(findings),
            plan.made,
            plan.skipped,
            figures(states.joints_of(self._parts.joints), trajectory, timeline),
            bearing(timeline),
            (*self.notes, *motion.notes),
        )
        return Judged(verdict, timeline)

    def _timeline(self, states: States, frames: Frames) -> Timeline:
        """Gather what was measured at each sample."""
        shown = Timeline(
            states.times,
            states.trajectory.joint_names,
            *states.joint_states(),
            deepest(frames.contacts, len(states.times)),
        )
        if frames.ground is None:
            return shown
        return replace(
            shown,
            ground_links=tuple(
                self._ground_links[column] for column in frames.ground.columns
            ),
            heights=frames.ground.heights,
            bearing=frames.ground.bears,
            support=tuple(frames.ground.support),
            balance=frames.balance,
        )

    def _check_names(self, names: Collection[str]) -> None:
        """Look whether the robot has some joints.

        Raises:
            UnknownNameError: If it has not all of them.
        """
        known = [joint.name for joint in self._parts.joints]
        for name in names:
            if name not in known:
                raise UnknownNameError(
                    f"{self.description.name} has no movable joint {name}; it has "
                    f"{listed(similar_first(name, known))}."
                )


def _single(
    positions: Mapping[str, float],
    base: np.ndarray | None,
    velocities: Mapping[str, float] | None,
) -> Trajectory:
    """Make a motion of one configuration."""
    rates = None
    if velocities is not None:
        rates = np.array([[velocities[name] for name in positions]], dtype=float)
    return Trajectory(
        np.zeros(1),
        tuple(positions),
        np.array([[*positions.values()]], dtype=float),
        rates,
        None if base is None else np.array([base], dtype=float),
    )
