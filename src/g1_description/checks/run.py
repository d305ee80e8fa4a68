"""What a robot did before it failed: its states, its commands, and what pushed it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from g1_description.checks.external_forces import external_forces
from g1_description.checks.measured import (
    CheckedRobot,
    Measured,
    rotation_vectors,
)
from g1_description.checks.measuring import measure
from g1_description.checks.rule import units
from g1_description.motion.history import CommandStream
from g1_description.motion.history_chunks import Stretch
from g1_description.motion.motion import Motion
from g1_description.motion.tracking import FallDetector, FallLimits
from g1_description.robot.description import limits_of
from g1_description.robot.dynamics import GRAVITY
from g1_description.robot.transform import compose, inverse
from g1_description.sim.rollout import Rollout
from g1_description.text import listed

BEFORE = 10.0
"""Longest time before a failure that is looked at, in [s]."""

RATE = 100.0
"""Highest rate of its samples, in [Hz]."""

ERROR = 0.2
"""Tracking error of a joint that is a failure, in [rad] or [m]."""

ASTRAY, TURNED = 0.15, 0.3
"""Distances of the base from its commanded pose that are failures, in [m] and [rad]."""

PLACED, PLACED_SPEED = 0.05, 10.0
"""A base that moves this far in [m] and this fast in [m/s] between two states was put
there."""

PLACED_TURN, PLACED_RATE = 0.3, 15.0
"""So was one that turns this far in [rad] and this fast in [rad/s]."""

AFTER = 0.1
"""Time after a failure that tells how large events at the failure are, in [s]."""

DROPS, LANDS = 1.5, 0.1
"""Longest time of a drop as a multiple of that of a free fall, and more in [s]."""

NEEDS = ("ground", "balance", "forces", "efforts")
"""What is measured of its motions."""


class Run:
    """The last seconds before a failure, and ``AFTER``. Unknown is None or NaN."""

    def __init__(
        self,
        robot: CheckedRobot,
        states: Stretch,
        commands: Sequence[CommandStream],
        effort_limits: Mapping[str, float],
    ) -> None:
        """Take the joints of the robot.

        Args:
            robot: The robot.
            states: Its states.
            commands: The commands to it, with their positions.
            effort_limits: Limits of the motors by joint in [N m] or [N], where they
                differ from those of the robot's file.
        """
        self.robot, self.states, self.commands = robot, states, commands
        known = {joint.name: joint for joint in robot.joints}
        names = [name for name in states.names if name in known]
        self._columns = [states.names.index(name) for name in names]
        limits = [effort_limits.get(name, known[name].effort) for name in names]
        self.joints = [replace(known[n], effort=e) for n, e in zip(names, limits)]
        """The m joints with known positions."""
        self.desired = np.full((len(states.stamps), len(names)), np.nan)
        """Their commanded positions in [rad] or [m], of each state, shape (n, m)."""
        for column, name in enumerate(names):
            if states.commanded is not None and name in states.commanded_names:
                own = states.commanded_names.index(name)
                self.desired[:, column] = states.commanded[:, own]
        self.times = 1e-9 * states.stamps
        """Times of the states in [s], shape (n,)."""
        self.end, self.failure = np.nan, ""
        """When it failed in [s], and what did."""

    @cached_property
    def errors(self) -> np.ndarray:
        """Return positions minus commands in [rad] or [m], shape (n, m).

        Commands beyond the limits of a joint are those to its limits, if it is there.
        """
        now = self.states.positions[:, self._columns]
        lower, upper = limits_of(self.joints)
        lower, upper = np.minimum(lower, now), np.maximum(upper, now)
        return np.asarray(now - self.desired.clip(lower, upper))

    @property
    def held(self) -> np.ndarray:
        """Return commanded positions in [rad] or [m], shape (n, m).

        Until its first command a joint is where it is then, without one where it is
        at first.
        """
        held = self.desired.copy()
        for column, is_known in enumerate((~np.isnan(held)).T):
            first = int(is_known.argmax())
            rows = slice(first) if is_known.any() else slice(None)
            place = self.states.positions[max(first - 1, 0), self._columns[column]]
            held[rows, column] = place
        return held

    @property
    def bases(self) -> np.ndarray | None:
        """Return poses of the base, shape (n, 7)."""
        return _whole(None if self.robot.is_fixed else self.states.base_poses)

    @cached_property
    def efforts(self) -> np.ndarray | None:
        """Efforts of the motors in [N m] or [N], shape (n, m)."""
        efforts = _whole(self.states.efforts)
        return None if efforts is None else np.asarray(efforts[:, self._columns])

    @property
    def unknown(self) -> str:
        """Return which evidence is missing; empty if none is."""
        missing = {
            "efforts of the motors": self.efforts is None,
            "commands": bool(np.isnan(self.desired).all()),
            "how it stands": not (self.stands or self.robot.is_fixed),
        }
        names = listed(name for name, is_missing in missing.items() if is_missing)
        return f"Not known: {names}." if names else ""

    # --- what checks measure of it, at fewer times ---

    @cached_property
    def _few(self) -> slice:
        """Which states are measured."""
        rate = (len(self.times) - 1) / max(np.ptp(self.times), 1e-9)
        return slice(None, None, max(int(np.ceil(rate / RATE - 1e-6)), 1))

    def _motion(self, positions: np.ndarray, bases: np.ndarray | None) -> Motion:
        """Return the measured ones of positions and poses of the base as a motion."""
        names = tuple(joint.name for joint in self.joints)
        bases = None if bases is None else bases[self._few]
        return Motion(self.times[self._few], names, positions[self._few], None, bases)

    @cached_property
    def measured(self) -> Measured:
        """Measurements of the motion of the robot."""
        motion = self._motion(self.states.positions[:, self._columns], self.bases)
        needs = [need for need in NEEDS if not self.robot.lacks(need, motion)]
        return measure(self.robot, motion, needs, {})

    @cached_property
    def stands(self) -> bool:
        """Whether it is known how the robot stands: on the floor, if not above it.

        What is in the air at first, and does not drop, stands on something unknown.
        """
        ground = self.measured.ground
        if ground is None or self.measured.balance is None:
            return False
        height = max(float(ground.heights[0].min()), 0.0)
        time = DROPS * np.sqrt(2.0 * height / GRAVITY) + LANDS
        is_first = self.measured.times <= self.times[0] + time
        return bool(ground.in_contact[is_first].any())

    @cached_property
    def external(self) -> dict[str, np.ndarray] | None:
        """Forces by link that neither floor nor motors explain, shape (k, 3)."""
        is_whole = len(self.joints) == len(self.robot.joints)
        if self.efforts is None or not is_whole or self.measured.balance is None:
            return None
        if len(self.times) < 2:
            return None
        period = np.ptp(self.times) / (len(self.times) - 1)
        reach = int(self.robot.thresholds.window / max(period, 1e-9) + 0.5)
        reach = min(reach, (len(self.times) - 1) // 2)
        kernel = 1.0 - np.abs(np.arange(-reach, reach + 1)) / (reach + 1)
        counts = np.convolve(np.ones(len(self.times)), kernel, "same")
        means = [np.convolve(e, kernel, "same") / counts for e in self.efforts.T]
        by_name = dict(zip((joint.name for joint in self.joints), means))
        efforts = [
            np.interp(self.measured.times, self.times, by_name[joint.name])
            for joint in self.robot.joints
        ]
        return external_forces(self.measured, np.array(efforts).T)

    @cached_property
    def commanded(self) -> Measured | None:
        """Measurements of the commanded motion; None if it is not known.

        Without a commanded base, the foot that stands first stays where it is.
        """
        held = self.held
        is_unknown = np.isnan(self.desired).all() or np.isnan(held).any()
        if not self.stands or is_unknown:
            return None
        motion = self._motion(held, _whole(self.states.commanded_bases))
        if motion.base_poses is None:
            ground = self.measured.ground
            assert ground is not None
            if not ground.in_contact[0].any():
                return None
            foot = self.robot.ground.rows[ground.columns[ground.in_contact[0].argmax()]]
            place = self.measured.link_poses(self.robot.links[foot], self.times[:1])
            free = Measured(self.robot, motion)
            poses = free.link_poses(self.robot.links[foot], motion.times)
            bases = compose(np.broadcast_to(place, poses.shape), inverse(poses))
            motion = replace(motion, base_poses=bases)
        return measure(self.robot, motion, NEEDS, {})


def failed_run(
    robot: CheckedRobot,
    states: Stretch,
    commands: Sequence[CommandStream] = (),
    fall_limits: FallLimits | None = None,
    effort_limits: Mapping[str, float] | None = None,
) -> Run | None:
    """Find the last fall, or else the first joint or base that is off its command.

    Args:
        robot: The robot.
        states: Its states.
        commands: The commands to it, with their positions.
        fall_limits: Deviations of the base that are no fall.
        effort_limits: As of ``Run``.

    Returns:
        What was before; None if nothing failed.
    """
    given = commands, effort_limits or {}
    if states.base_poses is not None:  # states without a base say nothing of a fall
        is_known = ~np.isnan(states.base_poses).any(axis=1)
        states = states.rows(is_known) if is_known.any() else states
    whole, limits = Run(robot, states, *given), fall_limits or FallLimits()
    begins = _begins(whole)
    ends = [*begins[1:], len(whole.times)]
    falls = (_fall(whole, *span, limits) for span in zip(begins[::-1], ends[::-1]))
    found = next(filter(None, falls), None) or min(_strays(whole), default=None)
    if found is None:
        return None
    failed, text = found
    first = int(np.searchsorted(whole.times, whole.times[failed] - BEFORE))
    first = max([first, *(begin for begin in begins if begin <= failed)])
    last = int(np.searchsorted(whole.times, whole.times[failed] + AFTER))
    last = min([max(last, failed + 1), *(end for end in ends if end > failed)])
    run = Run(robot, states.rows(slice(first, last)), *given)
    run.end, run.failure = float(whole.times[failed]), text
    return run


def _begins(run: Run) -> list[int]:
    """List the first row, and those at which the robot was placed."""
    if run.bases is None:
        return [0]
    steps = np.linalg.norm(np.diff(run.bases[:, :3], axis=0), axis=1)
    turns = rotation_vectors(run.bases[:-1, 3:], run.bases[1:, 3:])
    turns, periods = np.linalg.norm(turns, axis=1), np.diff(run.times)
    is_placed = (steps > PLACED_SPEED * periods) & (steps > PLACED)
    is_placed |= (turns > PLACED_RATE * periods) & (turns > PLACED_TURN)
    return [0, *(np.flatnonzero(is_placed) + 1).tolist()]


def _fall(run: Run, first: int, end: int, limits: FallLimits) -> tuple[int, str] | None:
    """Find the row of the last fall in a range of rows."""
    if run.bases is None:
        return None
    bases, desired = run.bases[first:end], run.states.commanded_bases
    has_fallen = FallDetector(bases[0], None, limits).has_fallen(bases, None)
    if desired is not None:
        base_targets = desired[first:end]
        rows = np.flatnonzero(~np.isnan(base_targets).any(axis=1))
        if len(rows):
            detector = FallDetector(bases[rows[0]], base_targets[rows[0]], limits)
            has_fallen[rows] = detector.has_fallen(bases[rows], base_targets[rows])
    falls = np.flatnonzero(has_fallen[1:] & ~has_fallen[:-1])
    return (first + int(falls[-1]) + 1, "the robot falls") if len(falls) else None


def _strays(run: Run) -> list[tuple[int, str]]:
    """List the first rows of joints, and of the base, that are off their commands."""
    found = []
    errors = np.nan_to_num(np.abs(run.errors))
    for column in np.flatnonzero((errors > ERROR).any(axis=0)):
        joint = run.joints[column]
        text = f"{joint.name} is {ERROR} {units(joint)[0]} off its command"
        found.append((int((errors[:, column] > ERROR).argmax()), text))
    desired = run.states.commanded_bases
    if run.bases is not None and desired is not None:
        rows = np.flatnonzero(~np.isnan(desired).any(axis=1))
        bases, desired = run.bases[rows], desired[rows]
        away = np.linalg.norm((bases - desired)[:, :2], axis=1)
        turns = rotation_vectors(desired[:, 3:], bases[:, 3:])
        is_astray = (away > ASTRAY) | (np.linalg.norm(turns, axis=1) > TURNED)
        if is_astray.any():
            text = f"the base is {ASTRAY} m or {TURNED} rad off its command"
            found.append((int(rows[is_astray.argmax()]), text))
    return found


def _whole(array: np.ndarray | None) -> np.ndarray | None:
    """Return an array, or None if a value is unknown."""
    return None if array is None or np.isnan(array).any() else array


def states_of(played: Rollout) -> Stretch:
    """Return a simulated motion as the states of a robot."""
    return Stretch(
        1,
        np.round(1e9 * played.times).astype(np.int64),
        played.joint_names,
        played.joint_names,
        played.positions,
        played.velocities,
        played.base_poses,
        None,
        played.mean_efforts,
        played.desired,
        played.desired_base_poses,
    )
