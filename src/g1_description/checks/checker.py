"""All checks of one robot: of motions, single configurations and its current state."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from g1_description.checks.contact_forces import ContactForces
from g1_description.checks.first_cause import Explanation, explain
from g1_description.checks.ground_samples import drifts
from g1_description.checks.intervals import intervals, time_share
from g1_description.checks.measured import CheckedRobot, Measured
from g1_description.checks.measuring import measure
from g1_description.checks.rule import Rule
from g1_description.checks.rules import RULES
from g1_description.checks.rules.forces import (
    CONTACT_FORCES,
    force_figures,
    forces,
    unknown_forces,
)
from g1_description.checks.rules.ground import slides
from g1_description.checks.rules.jumps import near_jumps
from g1_description.checks.rules.limits import check_bounds, zero_limits
from g1_description.checks.rules.obstacles import distances_of
from g1_description.checks.rules.physics import (
    physics_figures,
    physics_summary,
    saturated_joints,
)
from g1_description.checks.run import failed_run, states_of
from g1_description.checks.simulated import simulate
from g1_description.checks.surroundings import LEAST_CLEARANCE
from g1_description.checks.thresholds import Thresholds
from g1_description.checks.thresholds_file import read_thresholds
from g1_description.checks.verdict import Verdict, sorted_findings, with_causes
from g1_description.collisions.find_pairs import collisions_of
from g1_description.collisions.obstacles import Obstacles
from g1_description.collisions.self_collisions import SelfCollisions
from g1_description.errors import G1DescriptionError, MotionError, UnknownNameError
from g1_description.motion.history import CommandStream
from g1_description.motion.history_chunks import Stretch
from g1_description.motion.motion import (
    Motion,
    MotionLike,
    as_motion,
    configuration,
)
from g1_description.robot.assembly import limbs_of
from g1_description.robot.description import Description, limits_of
from g1_description.robot.state import RobotState
from g1_description.scenes.carried import named_link
from g1_description.scenes.scene import Scene
from g1_description.sim.rollout import Conditions, Rollout
from g1_description.text import listed, similar_first


class Checker:
    """Checks motions and configurations of one robot."""

    def __init__(
        self,
        description: Description,
        thresholds: Thresholds | None = None,
        fixed_base: bool = False,
        collisions: SelfCollisions | None = None,
        physics: Conditions | None = None,
        obstacles: Obstacles | None = None,
    ) -> None:
        """Prepare everything that does not depend on a motion.

        Args:
            description: The robot.
            thresholds: Limits of warnings and failures; None: the defaults.
            fixed_base: Whether the base is fixed, so that efforts are determined.
            collisions: Its shapes and the pairs of links that may touch; by default
                ``collisions_of`` it.
            physics: How motions are simulated; None: they are not.
            obstacles: The robot among the objects of a scene; None: there are none.

        Raises:
            AllowedPairsError: If the file of its allowed pairs cannot be read.
            ThresholdError: If the file of the defaults cannot be read, or thresholds
                name other joints.
        """
        self.description, self.physics = description, physics
        self.thresholds = thresholds or read_thresholds()
        check_bounds(self.thresholds, description)
        self.collisions = collisions or collisions_of(description)
        self.fixed_base = fixed_base
        self.obstacles = obstacles
        of_scene = obstacles.notes if obstacles else ()
        notes = (*zero_limits(description), *self.collisions.notes, *of_scene)
        self.notes = tuple(dict.fromkeys(notes))
        """Messages on assumptions about the robot."""
        self._limbs = limbs_of(description)
        if obstacles:  # each object is one of its own, or belongs to what carries it
            for name, each in obstacles.scene.items():
                link = each.attachments[0].link if each.attachments else ""
                link = link and named_link(description, link, name)
                self._limbs[name] = self._limbs.get(link, name)
        self._grouping = {rule.name: rule.grouping for rule in RULES}
        self.checked_robot = CheckedRobot(
            description, self.thresholds, self.collisions, fixed_base, obstacles
        )

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the arguments only: each process prepares the rest itself."""
        given = (self.description, self.thresholds, self.fixed_base)
        return Checker, (*given, self.collisions, self.physics, self.obstacles)

    def among(self, scene: Scene | None, visual_hulls: bool = True) -> Checker:
        """Return a checker of the same robot among other objects.

        Args:
            scene: The objects; None: there are none.
            visual_hulls: Whether what has no collision shapes uses the convex hulls of
                its visuals.

        Raises:
            UnknownNameError: If the scene names a link that the robot does not have.
        """
        obstacles = None
        if scene is not None:
            obstacles = Obstacles(self.description, scene, visual_hulls)
        return self._with(self.physics, obstacles)

    def without_physics(self) -> Checker:
        """Return a checker that simulates no motions."""
        if self.physics is None:
            return self
        return self._with(None, self.obstacles)

    def _with(self, physics: Conditions | None, obstacles: Obstacles | None) -> Checker:
        given = (self.description, self.thresholds, self.fixed_base)
        return Checker(*given, self.collisions, physics, obstacles)

    def check(
        self,
        motion: MotionLike,
        only: Collection[str] = (),
        objects: np.ndarray | None = None,
    ) -> Verdict:
        """Check a motion.

        Args:
            motion: Must fit the robot, as by ``fitted``.
            only: Names of the checks to make; none: all.
            objects: Poses of the objects in the map throughout, in the order of the
                scene, shape (n_objects, 7); None: as in the scene.

        Raises:
            UnknownNameError: If there is no such check.
            MotionError: If it is too long.
        """
        motion = as_motion(motion)
        rules = self._rules(motion, only, self.physics is not None)
        measured = self._measure(motion, rules, objects)
        if any(rule.needs_physics and not why for rule, why in rules.items()):
            self._play(measured, rules)
        return self._verdict(measured, rules, motion.notes)

    def check_state(
        self,
        positions: Mapping[str, float],
        base: np.ndarray | None = None,
        only: Collection[str] = (),
        velocities: Mapping[str, float] | None = None,
        objects: np.ndarray | None = None,
    ) -> Verdict:
        """Check one configuration at rest.

        Args:
            positions: Positions in [rad] or [m] by joint; others are at zero.
            base: T_map_base, shape (7,); None where it does not belong to the
                configuration.
            only: Names of the checks to make; none: all.
            velocities: Velocities in [rad/s] or [m/s] by joint, compared with limits;
                everything else is checked as at rest.
            objects: Poses of the objects in the map, in the order of the scene, shape
                (n_objects, 7); None: as in the scene.

        Returns:
            The verdict, with all times zero.

        Raises:
            UnknownNameError: If the robot has no such joint, or there is no such check.
            MotionError: If a value is not finite.
        """
        known = [joint.name for joint in self.checked_robot.joints]
        for name in positions:
            if name not in known:
                raise UnknownNameError(
                    f"{self.description.name} has no movable joint '{name}'. Its "
                    "joints: "
                    f"{listed(similar_first(name, known))}."
                )
        still = motion = configuration(positions, base)
        if velocities is not None:
            rates = [[velocities[name] for name in positions]]
            motion = replace(still, velocities=np.array(rates, dtype=float))
        rules = self._rules(motion, only, physics=False)
        measured = self._measure(still, rules, objects)
        if motion.velocities is not None:
            measured.velocities = motion.velocities
        return self._verdict(measured, rules, ())

    def contact_forces(self, motion: Motion) -> ContactForces:
        """Find the contact forces that a motion needs, as ``Robot.contact_forces``.

        Raises:
            MotionError: If they cannot be found.
        """
        why = unknown_forces(self.checked_robot, motion)
        if why:
            raise MotionError(f"Contact forces are unknown: {why}.")
        return measure(self.checked_robot, motion, ("forces",), {}).once(forces)

    def explain(
        self,
        states: Stretch,
        commands: Sequence[CommandStream] = (),
        played: Rollout | None = None,
    ) -> Explanation | None:
        """Find out why the robot fell last, or a joint strayed from its command.

        Args:
            states: Its states, with commanded positions and efforts where known.
            commands: The commands to it, with their positions.
            played: The simulation that they are from; None: they are of a robot.

        Returns:
            The first cause, and what followed; None if nothing failed.

        Raises:
            G1DescriptionError: If the states cannot be checked.
        """
        limits, bounds = None, None
        if played is not None and self.physics is not None:
            limits = self.physics.fall_limits
            bounds = dict(zip(played.joint_names, played.effort_limits.tolist()))
        run = failed_run(self.checked_robot, states, commands, limits, bounds)
        return None if run is None else explain(run)

    def _rules(
        self, motion: Motion, only: Collection[str], physics: bool
    ) -> dict[Rule, str]:
        """Select the rules, by default all, each with the reason it is skipped for."""
        rules = {rule.name: rule for rule in RULES if physics or not rule.needs_physics}
        for name in only:
            if name not in rules:
                known = listed(similar_first(name, rules))
                raise UnknownNameError(
                    f"Unknown check '{name}'. Known checks: {known}."
                )
        return {
            rule: rule.skipped(self.checked_robot, motion)
            for rule in rules.values()
            if not only or rule.name in only
        }

    def _measure(
        self,
        motion: Motion,
        rules: Mapping[Rule, str],
        objects: np.ndarray | None = None,
    ) -> Measured:
        """Make the measurements that active rules need."""
        made = [rule for rule, why in rules.items() if not why]
        needs = {need for rule in made for need in rule.needs}
        own = {rule.name: rule.measure for rule in made if rule.measure is not None}
        return measure(self.checked_robot, motion, needs, own, objects)

    def _play(self, measured: Measured, rules: dict[Rule, str]) -> None:
        """Simulate a motion; if that fails, skip the rules that need it."""
        assert self.physics is not None
        try:
            measured.played = simulate(measured, self.physics)
        except G1DescriptionError as error:
            why = str(error).rstrip(".")
            rules.update({rule: why for rule in rules if rule.needs_physics})
            return
        if saturated_joints(measured):
            freely = replace(self.physics, has_limits=False)
            with suppress(G1DescriptionError):  # their need stays unknown
                measured.unlimited = simulate(measured, freely)

    def _verdict(
        self, measured: Measured, rules: Mapping[Rule, str], notes: Collection[str]
    ) -> Verdict:
        """Collect the findings of all rules."""
        made = [rule for rule, why in rules.items() if not why]
        notes = [*self.notes, *notes]
        if measured.played is not None:
            notes += [*measured.played.left_out, physics_summary(measured)]
            cause = self.explain(states_of(measured.played), (), measured.played)
            notes += [cause.note] if cause else []
        found = sorted_findings(f for rule in made for f in rule.find(rule, measured))
        contacts = {}
        if measured.in_contact is not None:
            for column in np.flatnonzero(measured.in_contact.any(axis=0)):
                link, mask = measured.ground_links[column], measured.in_contact
                contacts[link] = intervals(measured.times, mask[:, column])
        verdict = Verdict(
            self.description.name,
            with_causes(found, self._grouping, self._limbs),
            tuple(rule.name for rule in made),
            {rule.name: why for rule, why in rules.items() if why},
            _figures(measured),
            contacts,
            tuple(dict.fromkeys(notes)),
            measured=measured,
        )
        values = verdict.rule_figures
        exclusions = self.thresholds.exclusions
        holding = tuple(rule.text for rule in exclusions if rule.holds(values))
        return replace(verdict, excluded_by=holding)


def _figures(measured: Measured) -> dict[str, float]:
    """Compute the figures of a motion."""
    joints, positions = measured.joints, measured.motion.positions
    lower, upper = limits_of(joints)
    beyond = ((positions < lower) | (positions > upper)).any(axis=1)
    turns = [joint.kind != "prismatic" for joint in joints]
    speeds, balance = np.abs(measured.velocities[:, turns]), measured.balance
    found = {
        "duration": float(measured.times[-1] - measured.times[0]),
        "samples": len(positions),
        "samples_beyond_limits": int(beyond.sum()),
    }
    if speeds.size:
        found["joint_speed.max"] = float(speeds.max())
    if measured.motion.base_poses is not None:
        found.update(_ways(measured))
    if measured.power is not None and len(measured.times) > 1:
        is_known = measured.once(near_jumps).is_known
        gain = np.where(is_known, np.maximum(measured.power, 0.0), 0.0)
        means = (gain[1:] + gain[:-1]) / 2.0
        found["energy"] = float(means @ np.diff(measured.times))
    if measured.in_contact is not None:
        any_link = measured.in_contact.any(axis=1)
        found["contact_share"] = time_share(measured.times, any_link)
    if measured.ground is not None and len(measured.times) > 1:
        touches = ~np.isnan(measured.once(slides))
        if touches.any():
            distances = drifts(measured.ground.steps, touches)
            found["largest_drift"] = float(np.nanmax(distances))
    is_made = not CONTACT_FORCES.skipped(measured.robot, measured.motion)
    if is_made and measured.wrench is not None:
        found.update(force_figures(measured))
    found.update(_distances(measured))
    if measured.heights is not None:
        found["lowest_height"] = float(measured.heights.min())
    if balance is not None and np.isfinite(balance.center_margin).any():
        found["least_center_margin"] = float(np.nanmin(balance.center_margin))
    if measured.played is not None:
        found.update(physics_figures(measured.played))
    return found


def _distances(measured: Measured) -> dict[str, float]:
    """Find the deepest self-collision, and how near objects are."""
    found = {}
    if measured.contacts is not None:
        found["deepest_self_collision"] = float(measured.depth.max())
    if measured.near_objects is not None:
        nearest = [
            np.nanmin(d)
            for _, d, _ in measured.once(distances_of)
            if not np.isnan(d).all()
        ]
        if nearest:
            found[LEAST_CLEARANCE] = float(min(nearest))
    return found


def _ways(measured: Measured) -> dict[str, float]:
    """Compute the path of the base in [m] and its largest speed in [m/s]."""
    steps = np.linalg.norm(np.diff(measured.base_poses()[:, :3], axis=0), axis=1)
    speeds = steps / np.diff(measured.times)
    return {
        "root_path": float(steps.sum()),
        "root_speed.max": float(speeds.max()) if len(speeds) else 0.0,
    }


AT_REST = tuple(rule.name for rule in RULES if rule.only_at_rest)
"""Checks that apply only to a robot at rest."""

LIVE = tuple(r.name for r in RULES if r.is_live and not r.needs_physics)
"""Checks of a current state."""

STANDSTILL = 1e-6
"""States closer in time than this, in [s], have no velocity: simulated time is
paused."""


class LiveCheck:
    """Checks states of one robot; an unchanged state is not checked again."""

    def __init__(self, checker: Checker) -> None:
        self.checker = checker
        joints = checker.description.movable_joints
        self._joints = frozenset(joint.name for joint in joints)
        self._last: tuple[float, np.ndarray] | None = None
        self._newest: tuple[object, Verdict] | None = None

    def begin_again(self) -> None:
        """Forget the last state, because time went back."""
        self._last = None

    def check(self, state: RobotState, objects: np.ndarray | None = None) -> Verdict:
        """Check a state.

        Args:
            state: Its unknown joints, such as those of hands, are ignored.
            objects: As for ``Checker.check_state``.

        Returns:
            The verdict. While the centre of mass moves, the checks of ``AT_REST`` are
            skipped.

        Raises:
            G1DescriptionError: If it cannot be checked.
        """
        positions, velocities = state.positions_by_name, state.velocities_by_name
        base = state.base_pose
        places = (None if a is None else a.tobytes() for a in (base, objects))
        content = positions, *places, velocities
        if self._newest is None or content != self._newest[0]:
            own = self._own(positions)
            rates = None if velocities is None else self._own(velocities) or None
            verdict = self.checker.check_state(own, base, LIVE, rates, objects)
            self._newest = content, verdict
        verdict = self._newest[1]
        if not self._moves(state.time, verdict):
            return verdict
        removed = [name for name in verdict.checked if name in AT_REST]
        return replace(
            verdict,
            findings=tuple(f for f in verdict.findings if f.check not in removed),
            checked=tuple(name for name in verdict.checked if name not in removed),
            skipped={**verdict.skipped, **dict.fromkeys(removed, "the robot moves")},
        )

    def _own(self, values: Mapping[str, float]) -> dict[str, float]:
        """Select the robot's joints; raise if there are none."""
        own = {name: value for name, value in values.items() if name in self._joints}
        if values and not own:
            raise UnknownNameError(
                f"{self.checker.description.name} has none of these joints: "
                f"{listed(values)}."
            )
        return own

    def _moves(self, time: float, verdict: Verdict) -> bool:
        """Return whether the centre of mass has moved since the last state."""
        assert verdict.measured is not None
        balance, last = verdict.measured.balance, self._last
        if balance is None:
            self._last = None
            return False
        center = balance.center[0]
        self._last = time, center
        if last is None or time - last[0] < STANDSTILL:
            return False
        speed = np.linalg.norm(center - last[1]) / (time - last[0])
        return bool(speed > self.checker.thresholds.still_speed)
