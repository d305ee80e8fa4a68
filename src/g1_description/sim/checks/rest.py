"""Judges one configuration at rest, without the work that a motion takes.

The verdict is that of the configuration as a motion of one sample.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np

from g1_description.core.checks import limits
from g1_description.core.checks.balance import Balance, balance_faults, margins
from g1_description.core.checks.ground.at_rest import GroundAtRest
from g1_description.core.checks.ground.faults import ground_faults
from g1_description.core.checks.ground.frames import GroundFrames
from g1_description.core.checks.verdict import (
    Fault,
    Verdict,
    judge,
    sorted_findings,
)
from g1_description.core.motion.trajectory import Trajectory
from g1_description.core.transform import IDENTITY, compose
from g1_description.sim.collisions.shape_collisions import Contacts

from .collision_faults import collisions_at_rest, deepest
from .frames import Parts
from .plan import Plan
from .timeline import Judged, Timeline

NOW = np.zeros(1)
"""The time of a configuration."""

YES = np.ones(1, dtype=bool)


@dataclass(frozen=True, eq=False)
class Rest:
    """What was measured of one configuration; None where it is not wanted."""

    contacts: Contacts | None = None
    ground: GroundFrames | None = None
    balance: Balance | None = None


class RestChecks:
    """The checks of one robot at rest, with all that is the same each time."""

    def __init__(
        self, name: str, parts: Parts, ground: GroundAtRest, T_base_root: np.ndarray
    ) -> None:
        """Gather limits.

        Args:
            name: The robot's.
            parts: The robot.
            ground: Its outlines.
            T_base_root: Where its root link is in its base, shape (7,).
        """
        self._name, self._parts, self._ground = name, parts, ground
        self._T_base_root = T_base_root
        joints = parts.joints
        self.rows = {joint.name: row for row, joint in enumerate(joints)}
        """Rows of the movable joints by name."""
        self._lower = np.array([joint.lower for joint in joints])
        self._upper = np.array([joint.upper for joint in joints])
        self._velocity = np.array([joint.velocity for joint in joints])
        self._turns = np.array([joint.kind != "prismatic" for joint in joints])
        total = parts.masses.total if parts.masses.total > 0.0 else np.nan
        self._share = parts.masses.mass / total

    def judge(
        self,
        trajectory: Trajectory,
        columns: list[int],
        plan: Plan,
        notes: tuple[str, ...],
    ) -> Judged:
        """Judge a configuration.

        Args:
            trajectory: A motion of one sample. Velocities are compared with their
                limits; all else is judged as at rest.
            columns: Rows of its joints.
            plan: What is to be judged.
            notes: Messages on what was assumed of the robot.
        """
        rest = self._measure(trajectory, columns, plan.measured)
        findings = [
            judge(fault, getattr(self._parts.thresholds, fault.check), NOW)
            for fault in self._faults(trajectory, columns, rest)
            if fault.check in plan.made
        ]
        timeline = self._timeline(trajectory, rest)
        bearing = () if rest.ground is None else np.flatnonzero(rest.ground.bears[0])
        verdict = Verdict(
            self._name,
            sorted_findings(findings),
            plan.made,
            plan.skipped,
            self._figures(columns, timeline),
            {self._parts.ground_links[column]: ((0.0, 0.0),) for column in bearing},
            notes,
        )
        return Judged(verdict, timeline)

    def _measure(
        self, trajectory: Trajectory, columns: list[int], wanted: Collection[str]
    ) -> Rest:
        """Measure a configuration."""
        if not wanted:
            return Rest()
        parts = self._parts
        positions = np.zeros((1, len(self.rows)))
        positions[0, columns] = trajectory.positions[0]
        base = trajectory.base_poses
        bases = IDENTITY[np.newaxis] if base is None else base
        roots = compose(bases, self._T_base_root)
        poses = parts.kinematics.link_poses(roots, positions)
        contacts = ground = balance = None
        if "contacts" in wanted:
            contacts = parts.collisions.contacts(poses)
        if "ground" in wanted:
            ground = self._ground.frame(poses)
        if "balance" in wanted and ground is not None:
            center = self._share @ parts.masses.centers(poses)
            (margin,) = margins(ground.support, center[:, :2])
            balance = Balance(center, margin, margin, YES)
        return Rest(contacts, ground, balance)

    def _faults(
        self, trajectory: Trajectory, columns: list[int], rest: Rest
    ) -> Iterator[Fault]:
        """List what may be wrong, without what certainly is not."""
        thresholds, positions = self._parts.thresholds, trajectory.positions
        joints = [self._parts.joints[column] for column in columns]
        least = thresholds.position.least
        beyond = np.maximum(
            positions[0] - self._upper[columns], self._lower[columns] - positions[0]
        )
        if (beyond > least).any():
            yield from limits.position_faults(joints, positions, least)
        if trajectory.velocities is not None:
            rates, bounds = trajectory.velocities, self._velocity[columns]
            least = thresholds.velocity.least
            yield from limits.rate_faults("velocity", joints, rates, bounds, least)
        if rest.contacts is not None and len(rest.contacts.pair):
            yield from collisions_at_rest(rest.contacts, self._parts.collisions.pairs)
        if rest.ground is not None:
            yield from self._ground_faults(rest.ground)
        if rest.balance is not None:
            least = min(
                thresholds.center_of_mass.least, thresholds.zero_moment_point.least
            )
            if -rest.balance.center_margin[0] > least:
                floor = thresholds.floor_height
                yield from balance_faults(rest.balance, YES, floor)

    def _ground_faults(self, ground: GroundFrames) -> list[Fault]:
        """List what may be wrong with the robot on its floor."""
        thresholds, heights = self._parts.thresholds, ground.heights
        bearing = heights[ground.bears]
        is_fine = not bearing.size or (
            -bearing.min() <= thresholds.penetration.least
            and bearing.max() <= thresholds.floating.least
            and thresholds.skating.least >= 0.0
        )
        lowest = heights.min(axis=1)
        if is_fine and lowest[0] <= thresholds.bearing_height:
            return []
        airborne = np.where(lowest > thresholds.bearing_height, lowest, np.nan)
        touches = ground.bears & (heights <= thresholds.contact_height)
        slides = np.where(touches, 0.0, np.nan)
        links = self._parts.ground_links
        return ground_faults(links, ground, slides, airborne)

    def _timeline(self, trajectory: Trajectory, rest: Rest) -> Timeline:
        """Gather what was measured."""
        positions, velocities = trajectory.positions, trajectory.velocities
        if velocities is None:
            velocities = np.zeros(positions.shape)
        names, depth = trajectory.joint_names, deepest(rest.contacts, 1)
        ground = rest.ground
        if ground is None:
            return Timeline(NOW, names, positions, velocities, depth)
        return Timeline(
            NOW,
            names,
            positions,
            velocities,
            depth,
            self._parts.ground_links,
            ground.heights,
            ground.bears,
            tuple(ground.support),
            rest.balance,
        )

    def _figures(self, columns: list[int], timeline: Timeline) -> dict[str, float]:
        """Compute what ``timeline.figures`` does."""
        at = timeline.positions[0]
        beyond = (at < self._lower[columns]) | (at > self._upper[columns])
        found: dict[str, float] = {
            "duration": 0.0,
            "samples": 1,
            "samples_beyond_limits": int(beyond.any()),
        }
        speeds = np.abs(timeline.velocities[0, self._turns[columns]])
        if speeds.size:
            found["largest_joint_speed"] = float(speeds.max())
        if np.isfinite(timeline.depth[0]):
            found["deepest_self_collision"] = float(timeline.depth[0])
        if timeline.heights is not None:
            found["lowest_height"] = float(timeline.heights.min())
        if timeline.balance is not None:
            margin = float(timeline.balance.center_margin[0])
            if np.isfinite(margin):
                found["least_center_margin"] = found["least_zmp_margin"] = margin
        return found
