"""All checks of one robot: of motions, and of single configurations."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from g1_description.checks.faults import all_faults
from g1_description.checks.finding import compared, intervals, sorted_findings
from g1_description.checks.ground import Ground, Outline
from g1_description.checks.limits import check_bounds, zero_limits
from g1_description.checks.measured import Measured, Parts, measured_motion
from g1_description.checks.physics import CHECKS, PhysicsCheck
from g1_description.checks.thresholds import LEVELS, Thresholds, read_thresholds
from g1_description.checks.verdict import Verdict
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

GROUND = ("penetration", "floating", "skating")
BALANCE = ("center_of_mass", "zero_moment_point")
RATES = ("velocity", "acceleration", "jerk", "jump", "base_jump")
NAMES = tuple(name for name in LEVELS if name not in CHECKS)
"""Names of the checks that need no simulation."""

NO_BASE = "the motion has no base"
"""Why the floor is not checked."""


def collisions_of(
    description: Description, file: Path | None = None, visual_hulls: bool = True
) -> SelfCollisions:
    """Prepare a robot's self-collisions.

    Args:
        description: The robot.
        file: Its allowed pairs. By default those of the G1, and for a robot with other
            links pairs that are found now.
        visual_hulls: Whether links without collision shapes have the hulls of their
            visual ones.

    Raises:
        AllowedPairsError: If a file cannot be read, or the given one is another
            robot's.
    """
    if file is not None:
        return SelfCollisions(description, read_allowed_pairs(file), visual_hulls)
    known = read_allowed_pairs(share_folder() / G1_PAIRS)
    try:
        return SelfCollisions(description, known, visual_hulls)
    except AllowedPairsError:
        found = quick_allowed_pairs(description)
    other = SelfCollisions(description, found, visual_hulls)
    note = (
        f"Which links of {description.name} overlap by design was found in "
        f"{QUICK_SAMPLES} random configurations; collision_pairs makes a file of it."
    )
    other.notes = (note, *other.notes)
    return other


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


class Checker:
    """Checks motions and configurations of one robot."""

    def __init__(
        self,
        description: Description,
        thresholds: Thresholds | None = None,
        fixed_base: bool = False,
        collisions: SelfCollisions | None = None,
        physics: PhysicsCheck | None = None,
    ) -> None:
        """Prepare all that does not depend on a motion.

        Args:
            description: The robot.
            thresholds: What is a warning and what a failure; None: the defaults.
            fixed_base: Whether something holds the base, so that efforts are known.
            collisions: Its shapes and the pairs of links that may touch; by default
                ``collisions_of`` it.
            physics: Plays motions in physics; None: they are not.

        Raises:
            AllowedPairsError: If the file of the G1's allowed pairs cannot be read.
            ThresholdError: If the file of the defaults cannot be read, or thresholds
                name other joints.
        """
        self.description = description
        self.thresholds = thresholds or read_thresholds()
        check_bounds(self.thresholds, description)
        self.collisions = collisions or collisions_of(description)
        self.fixed_base, self.physics = fixed_base, physics
        self.notes = (*zero_limits(description), *self.collisions.notes)
        """Messages on what was assumed of the robot."""
        names = [name for name in description.link_names if name != WORLD]
        kinematics = Kinematics(description)
        outlines = outlines_of(self.collisions.shapes)
        ground = Ground(outlines, kinematics.end_links(), self.thresholds)
        self._parts = Parts(
            description,
            description.movable_joints,
            tuple(names[row] for row in ground.rows),
            kinematics,
            Masses(description),
            ground,
            self.collisions,
            self.thresholds,
        )
        self._is_fixed = fixed_base or base_of(description)[0] == WORLD

    def __reduce__(self) -> tuple[Any, ...]:
        """Go to other processes without what each prepares for itself."""
        given = (self.description, self.thresholds, self.fixed_base)
        return Checker, (*given, self.collisions, self.physics)

    def check(self, motion: Motion, only: Collection[str] = ()) -> Verdict:
        """Check a motion.

        Args:
            motion: It fits the robot.
            only: Names of the checks to make; none: all.

        Raises:
            UnknownNameError: If there is no such check.
            MotionError: If it is too long.
        """
        kinematic = only
        if self.physics is not None:
            kinematic = [name for name in only if name not in CHECKS]
        verdict = self._checked(motion, self._skipped(motion.trajectory), kinematic)
        if self.physics is None:
            return verdict
        dynamic = [name for name in only if name in CHECKS]
        if only and not kinematic:
            # Figures and pictures need what was measured, but nothing else was asked.
            verdict = replace(verdict, findings=(), checked=(), skipped={})
        if only and not dynamic:
            return verdict
        return self.physics.added(verdict, motion, dynamic)

    def check_state(
        self,
        positions: Mapping[str, float],
        base: np.ndarray | None = None,
        only: Collection[str] = (),
        velocities: Mapping[str, float] | None = None,
    ) -> Verdict:
        """Check one configuration at rest.

        Args:
            positions: Of joints in [rad] or [m], by name; the others are at zero.
            base: T_map_base, shape (7,); None where it does not belong to the
                configuration.
            only: Names of the checks to make; none: all.
            velocities: Of the same joints in [rad/s] or [m/s], compared with their
                limits; all else is checked as at rest.

        Returns:
            The verdict, with all times zero.

        Raises:
            UnknownNameError: If the robot has no such joint, or there is no such check.
            MotionError: If a number is none that a robot can have.
        """
        known = [joint.name for joint in self._parts.joints]
        for name in positions:
            if name not in known:
                raise UnknownNameError(
                    f"{self.description.name} has no movable joint {name}; it has "
                    f"{listed(similar_first(name, known))}."
                )
        trajectory = _single(positions, base, velocities)
        skipped = self._skipped(trajectory)
        at_rest = Motion(replace(trajectory, velocities=None))
        return self._checked(at_rest, skipped, only, trajectory.velocities)

    def _checked(
        self,
        motion: Motion,
        skipped: Mapping[str, str],
        only: Collection[str],
        velocities: np.ndarray | None = None,
    ) -> Verdict:
        """Make the checks that are not skipped.

        Args:
            motion: It fits the robot.
            skipped: Names of checks that cannot be made, and why not.
            only: Names of the checks to make; none: all.
            velocities: Of its joints at its samples, shape (n, n_joints), to compare
                with their limits instead of the motion's own.
        """
        for name in only:
            if name not in NAMES:
                known = listed(similar_first(name, NAMES))
                raise UnknownNameError(f"There is no check {name}; there are {known}.")
        requested = [name for name in NAMES if not only or name in only]
        made = tuple(name for name in requested if name not in skipped)
        measured = measured_motion(motion.trajectory, self._parts, _needed(made))
        if velocities is not None:
            measured.velocities = velocities
        findings = [
            compared(fault, getattr(self.thresholds, fault.check), measured.times)
            for fault in all_faults(self._parts, measured)
            if fault.check in made
        ]
        return Verdict(
            self.description.name,
            sorted_findings(findings),
            made,
            {name: skipped[name] for name in requested if name in skipped},
            self._figures(measured),
            _bearing(measured),
            (*self.notes, *motion.notes),
            measured,
        )

    def _skipped(self, trajectory: Trajectory) -> dict[str, str]:
        """Name the checks that cannot be made of a motion, and why not."""
        parts, thresholds = self._parts, self.thresholds
        skipped = {
            name: "it has no threshold"
            for name in NAMES
            if not getattr(thresholds, name).is_checked
        }
        if len(trajectory.times) == 1:
            has_speeds = trajectory.velocities is not None
            rates = RATES[1:] if has_speeds else RATES
            skipped.update(dict.fromkeys(rates, "there is only one configuration"))
        has_mass = parts.masses.total > 0.0
        if not has_mass:
            skipped["effort"] = "the robot has no mass"
        elif not self._is_fixed:
            skipped["effort"] = "the base is free; only physics tells"
        if not parts.collisions.pairs:
            skipped["self_collision"] = "the robot has no two shapes that could touch"
        why = self._no_ground(trajectory.base_poses is not None)
        if why:
            skipped.update(dict.fromkeys((*GROUND, *BALANCE, "base_jump"), why))
        elif not has_mass:
            skipped.update(dict.fromkeys(BALANCE, "the robot has no mass"))
        for name in ("acceleration", "jerk"):
            bounds = getattr(thresholds, f"{name}_bounds").of(trajectory.joint_names)
            if not np.isfinite(bounds).any():
                skipped.setdefault(name, "no bounds are given")
        return skipped

    def _no_ground(self, has_base: bool) -> str:
        """Say why the floor is not checked; empty if it is."""
        if self._is_fixed:
            return "the base is fixed"
        if not has_base:
            return NO_BASE
        return "" if self._parts.ground_links else "the robot has no shapes"

    def _figures(self, measured: Measured) -> dict[str, float]:
        """Compute the figures of a motion."""
        joints = measured.joints_of(self._parts.joints)
        positions = measured.trajectory.positions
        lower = np.array([joint.lower for joint in joints])
        upper = np.array([joint.upper for joint in joints])
        beyond = ((positions < lower) | (positions > upper)).any(axis=1)
        turns = [joint.kind != "prismatic" for joint in joints]
        speeds, balance = np.abs(measured.velocities[:, turns]), measured.balance
        found: dict[str, float | None] = {
            "duration": float(measured.times[-1] - measured.times[0]),
            "samples": len(positions),
            "samples_beyond_limits": int(beyond.sum()),
            "largest_joint_speed": float(speeds.max()) if speeds.size else None,
            "deepest_self_collision": _largest(measured.depth),
        }
        if measured.heights is not None:
            found["lowest_height"] = float(measured.heights.min())
        if balance is not None:
            found["least_center_margin"] = least(balance.center_margin)
            found["least_zmp_margin"] = least(balance.zmp_margin)
        return {name: value for name, value in found.items() if value is not None}


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


def _needed(made: Collection[str]) -> frozenset[str]:
    """Name what must be measured for some checks."""
    needed = set()
    if "self_collision" in made:
        needed.add("contacts")
    if {*GROUND, *BALANCE} & {*made}:
        needed.add("ground")
    if {*BALANCE, "floating"} & {*made}:
        needed.add("balance")
    if "effort" in made:
        needed.add("efforts")
    return frozenset(needed)


def _bearing(measured: Measured) -> dict[str, tuple[tuple[float, float], ...]]:
    """List when links are in contact with the floor."""
    if measured.bearing is None:
        return {}
    return {
        measured.ground_links[column]: intervals(
            measured.times, measured.bearing[:, column]
        )
        for column in np.flatnonzero(measured.bearing.any(axis=0))
    }


def _largest(values: np.ndarray) -> float | None:
    """Return the greatest number; None if none is known."""
    return float(np.nanmax(values)) if np.isfinite(values).any() else None


def least(values: np.ndarray) -> float | None:
    """Return the least number; None if none is known."""
    return float(np.nanmin(values)) if np.isfinite(values).any() else None
