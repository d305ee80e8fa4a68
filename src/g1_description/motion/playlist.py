"""The motions that one robot plays; for each joint, the newest one applies."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, NamedTuple

import numpy as np

from g1_description.motion.motion import SNAP, Motion, Sample, sample
from g1_description.motion.tolerances import Tolerances, worst_violation


class Setpoint(NamedTuple):
    """Joints and base of a motion at one time; at several, they are the first axis."""

    rows: np.ndarray
    """Indices of the robot's movable joints that it moves, shape (n,)."""

    positions: np.ndarray
    """In [rad] or [m], shape (n,) or (n_times, n)."""

    velocities: np.ndarray
    """In [rad/s] or [m/s], of the same shape."""

    base_pose: np.ndarray | None = None
    """Pose of the root link in the map, shape (7,) or (n_times, 7); None if it is
    not moved."""

    base_twist: np.ndarray | None = None
    """Velocity of the root link's origin and its angular velocity, along the map's
    axes, shape (6,) or (n_times, 6); None with the pose."""

    def at(self, index: int) -> Setpoint:
        """Return that at one of several times."""
        joints = self.positions[index], self.velocities[index]
        if self.base_pose is None or self.base_twist is None:
            return Setpoint(self.rows, *joints)
        base = self.base_pose[index], self.base_twist[index]
        return Setpoint(self.rows, *joints, *base)


AHEAD = 64
"""Configurations that are interpolated together, where times have a common step: numpy
takes hardly longer for them than for one."""


class Playback:
    """A motion that is played, except for joints that newer commands took over.

    Args:
        motion: The motion.
        start_ns: Time zero of the motion, in [ns].
        columns: Indices of the motion's joints that the robot has, shape (n,).
        rows: Their indices among the robot's movable joints, shape (n,).
    """

    def __init__(
        self,
        motion: Motion,
        start_ns: int,
        columns: np.ndarray,
        rows: np.ndarray,
    ) -> None:
        self.start_ns = start_ns
        self.has_begun = False
        self.moves_base = motion.base_poses is not None
        """Whether it moves the base."""
        self.is_single = len(motion.times) == 1
        """Whether it is a single configuration."""
        self._motion = motion
        self._sampled_ns = self._step_ns = 0
        self._ahead: tuple[int, int, Sample] | None = None
        """Time of the first of several configurations and their step, in [ns], and
        them."""
        self._n_reached = 0
        self._columns = columns
        self.rows = rows
        """Indices of the robot's movable joints that it moves, shape (n,)."""

    @property
    def is_empty(self) -> bool:
        """Whether it moves neither joints nor the base."""
        return not (self.moves_base or len(self.rows))

    def release(self, rows: Collection[int], base: bool) -> None:
        """Release joints, given by rows, and optionally the base."""
        gone = set(rows)
        kept = [n for n, row in enumerate(self.rows.tolist()) if row not in gone]
        self.rows, self._columns = self.rows[kept], self._columns[kept]
        self.moves_base = self.moves_base and not base

    def begin(self, time_ns: int, present: Setpoint) -> None:
        """Begin, and move to the first sample from the present state.

        Args:
            time_ns: When it begins, in [ns].
            present: State of all joints and the base at that time.
        """
        self.has_begun = True
        elapsed = max(0.0, self._elapsed(time_ns))
        old = self._motion
        if elapsed >= old.times[0]:
            return
        positions, velocities = old.positions[0].copy(), np.zeros(len(old.joint_names))
        positions[self._columns] = present.positions[self.rows]
        velocities[self._columns] = present.velocities[self.rows]
        added: dict[str, Any] = {"times": np.append(elapsed, old.times)}
        added["positions"] = np.vstack([positions, old.positions])
        if old.velocities is not None:
            added["velocities"] = np.vstack([velocities, old.velocities])
        if old.base_poses is not None:
            first = (
                old.base_poses[0] if present.base_pose is None else present.base_pose
            )
            added["base_poses"] = np.vstack([first, old.base_poses])
        self._motion, self._ahead = replace(old, **added), None

    def reaches_sample(self, time_ns: int) -> bool:
        """Return whether there is a sample since the time of the last call."""
        times, before = self._motion.times, self._n_reached
        until = self._elapsed(time_ns) + SNAP
        self._n_reached = int(np.searchsorted(times, until, side="right"))
        return self._n_reached != before

    def is_over(self, time_ns: int) -> bool:
        """Return whether it has ended at a time in [ns]."""
        return self._elapsed(time_ns) >= self._motion.rest_time

    def setpoint(self, time_ns: int) -> Setpoint:
        """Sample it at a time in [ns]."""
        step_ns, self._sampled_ns = time_ns - self._sampled_ns, time_ns
        is_steady, self._step_ns = step_ns == self._step_ns > 0, step_ns
        if is_steady:
            return self.setpoints(time_ns, step_ns, 1).at(0)
        found = sample(self._motion, np.array([self._elapsed(time_ns)]))
        return self._select(found, slice(0, 1)).at(0)

    def setpoints(self, time_ns: int, step_ns: int, count: int) -> Setpoint:
        """Sample it at several times.

        Args:
            time_ns: The first time in [ns].
            step_ns: From one time to the next, in [ns].
            count: Number of times.

        Returns:
            The setpoints, with the times as a first axis.
        """
        ahead, index = self._ahead, AHEAD
        if ahead is not None and ahead[1] == step_ns > 0:
            index, rest = divmod(time_ns - ahead[0], step_ns)
            index = AHEAD if rest else index
        if ahead is None or not 0 <= index <= AHEAD - count:
            numbers = range(max(AHEAD, count))
            times = [self._elapsed(time_ns + step_ns * number) for number in numbers]
            ahead = time_ns, step_ns, sample(self._motion, np.array(times))
            self._ahead, index = ahead, 0
        return self._select(ahead[2], slice(index, index + count))

    def _select(self, found: Sample, at: slice) -> Setpoint:
        """Select times of a sampled motion, and what it still moves."""
        columns = self._columns
        joints = found.positions[at, columns], found.velocities[at, columns]
        if not self.moves_base or found.base_poses is None:
            return Setpoint(self.rows, *joints)
        assert found.base_twists is not None, "a base has a twist"
        return Setpoint(self.rows, *joints, found.base_poses[at], found.base_twists[at])

    def steady_steps(self, time_ns: int, step_ns: int) -> int:
        """Count the steps after a time in [ns] until it begins, or its last one."""
        if not self.has_begun:
            return -((time_ns - self.start_ns) // step_ns) - 1
        left = 1e9 * (self._motion.rest_time - self._elapsed(time_ns))
        return math.ceil(left / step_ns - 1e-6)

    def _elapsed(self, time_ns: int) -> float:
        """Compute the time since the beginning, in [s]."""
        return 1e-9 * (time_ns - self.start_ns)


class Playlist:
    """The motions that are played, and those that have not begun.

    Args:
        joint_names: The robot's movable joints.
    """

    def __init__(self, joint_names: Sequence[str]) -> None:
        self._row_of = {name: row for row, name in enumerate(joint_names)}
        self._names: tuple[str, ...] = ()
        self._columns = self._rows = np.zeros(0, dtype=int)
        self._playbacks: list[Playback] = []

    def __bool__(self) -> bool:
        """Return whether there is any."""
        return bool(self._playbacks)

    @property
    def is_waiting(self) -> bool:
        """Whether any motion has not begun."""
        return any(not one.has_begun for one in self._playbacks)

    def add(self, motion: Motion, start_ns: int) -> Playback:
        """Add a motion; it takes its joints from motions that would begin later.

        Args:
            motion: The motion; unknown joints are ignored.
            start_ns: Time zero of the motion, in [ns].
        """
        names = motion.joint_names
        if names != self._names:
            own = [column for column, name in enumerate(names) if name in self._row_of]
            self._columns = np.array(own, dtype=int)
            self._rows = np.array([self._row_of[names[n]] for n in own], dtype=int)
            self._names = names
        playback = Playback(motion, start_ns, self._columns, self._rows)
        later = [
            one
            for one in self._playbacks
            if not one.has_begun and one.start_ns >= start_ns
        ]
        self._release(later, playback.rows, playback.moves_base)
        self._playbacks.append(playback)
        return playback

    def release(self, rows: Collection[int] = (), base: bool = False) -> None:
        """Release joints, given by rows, and optionally the base."""
        self._release(self._playbacks, rows, base)

    def begin(self, time_ns: int, present: Setpoint) -> None:
        """Begin motions that are due; they take their joints from earlier motions.

        Args:
            time_ns: The time in [ns].
            present: State of all joints and the base.
        """
        for playback in [*self._playbacks]:
            if playback.start_ns <= time_ns and not playback.has_begun:
                playback.begin(time_ns, present)
                older = self._playbacks[: self._playbacks.index(playback)]
                self._release(older, playback.rows, playback.moves_base)

    def steady_steps(self, time_ns: int, step_ns: int) -> int:
        """Count the steps after a time before one in which a motion begins or ends.

        Args:
            time_ns: The time in [ns].
            step_ns: Length of a step in [ns].

        Returns:
            At least 1: the first step may begin motions, and the last one end some.
        """
        steps = [one.steady_steps(time_ns, step_ns) for one in self._playbacks]
        return max(1, min(steps, default=1))

    def moving(self) -> list[Playback]:
        """List the motions that have begun."""
        return [one for one in self._playbacks if one.has_begun]

    def drop_over(self, time_ns: int) -> None:
        """Remove motions that have ended at a time in [ns]."""
        self._playbacks = [
            one
            for one in self._playbacks
            if not (one.has_begun and one.is_over(time_ns))
        ]

    def _release(
        self, playbacks: Collection[Playback], rows: Collection[int], base: bool
    ) -> None:
        """Release joints and base from motions, and remove empty ones."""
        if not playbacks:
            return
        for playback in playbacks:
            playback.release(rows, base)
        self._playbacks = [one for one in self._playbacks if not one.is_empty]


class Outcome(Enum):
    """The state of a goal."""

    UNDER_WAY = "under way"
    REACHED = "reached"
    OFF_PATH = "a path tolerance is violated"
    OFF_GOAL = "a goal tolerance is violated"


@dataclass(frozen=True, eq=False)
class Progress:
    """Joints at one time of a trajectory.

    Rows of arrays are positions in [rad] or [m] and velocities in [rad/s] or [m/s],
    shape (2, n_joints).
    """

    desired: np.ndarray
    actual: np.ndarray

    error: np.ndarray
    """The desired minus the actual ones."""

    outcome: Outcome

    message: str
    """Clause on the joint that violates a tolerance; else empty."""


class Following:
    """Compares joints with a trajectory, by the rules of joint_trajectory_controller.

    During the motion no error may exceed its path tolerance. After the end, each joint
    must come within its goal tolerances within the goal time; it need not stay there
    until the others arrive.

    Args:
        motion: The desired motion. Before its first sample, the joints move there
            from their present positions.
        start_ns: Time zero of the motion, in [ns].
        tolerances: The largest errors.
        is_continuous: Whether full turns of a joint are ignored, shape (n_joints,).
    """

    def __init__(
        self,
        motion: Motion,
        start_ns: int,
        tolerances: Tolerances,
        is_continuous: np.ndarray,
    ) -> None:
        self.joint_names = motion.joint_names
        self.start_ns = start_ns
        every = np.arange(len(self.joint_names))
        self._playback = Playback(motion, start_ns, every, every)
        self._end = motion.end
        self._tolerances, self._has_path = tolerances, tolerances.has_path
        self._is_continuous = is_continuous
        self._reached = np.zeros(len(self.joint_names), dtype=bool)

    def decides_at(self, time_ns: int) -> bool:
        """Return whether errors at a time in [ns] can end the goal."""
        return self._has_path or self._elapsed(time_ns) >= self._end

    def update(self, time_ns: int, actual: np.ndarray) -> Progress:
        """Compare the joints with the trajectory.

        Args:
            time_ns: The time in [ns], not before the start.
            actual: Positions and velocities then, shape (2, n_joints).
        """
        if not self._playback.has_begun:
            self._playback.begin(time_ns, Setpoint(self._playback.rows, *actual))
        setpoint = self._playback.setpoint(time_ns)
        desired = np.stack([setpoint.positions, setpoint.velocities])
        error = desired - actual
        turns = np.round(error[0] / (2.0 * np.pi))
        error[0] -= np.where(self._is_continuous, 2.0 * np.pi * turns, 0.0)
        outcome, message = self._outcome(self._elapsed(time_ns), error)
        return Progress(desired, actual, error, outcome, message)

    def _outcome(self, time: float, error: np.ndarray) -> tuple[Outcome, str]:
        """Return the goal's state, with a message if it failed."""
        allowed = self._tolerances
        if time < self._end:
            message = worst_violation(self.joint_names, error, allowed.path)
            return (Outcome.OFF_PATH if message else Outcome.UNDER_WAY), message
        message = worst_violation(self.joint_names, error, allowed.goal)
        if message and time >= self._end + allowed.goal_time:
            return Outcome.OFF_GOAL, message
        self._reached |= (np.abs(error) <= allowed.goal).all(axis=0)
        return (Outcome.REACHED if self._reached.all() else Outcome.UNDER_WAY), ""

    def _elapsed(self, time_ns: int) -> float:
        """Compute the time since the start, in [s]."""
        return (time_ns - self.start_ns) / 1e9


def remaining(motion: Motion, time: float) -> Motion | None:
    """Remove the samples until a time, in [s]; None if none follows."""
    first = int(np.searchsorted(motion.times, time + SNAP, side="right"))
    if first == len(motion.times):
        return None
    velocities, bases = motion.velocities, motion.base_poses
    return replace(
        motion,
        times=motion.times[first:],
        positions=motion.positions[first:],
        velocities=None if velocities is None else velocities[first:],
        base_poses=None if bases is None else bases[first:],
    )
