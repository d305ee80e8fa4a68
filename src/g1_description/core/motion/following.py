"""A trajectory that joints follow: where they should be, and whether they are."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from .playlist import Playback, Setpoint
from .sampling import SNAP
from .tolerances import Tolerances, worst_violation
from .trajectory import Trajectory


class Outcome(Enum):
    """What has become of a goal."""

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
    """Which joint violates a tolerance, as a part of a sentence; else empty."""


class Following:
    """Compares joints with a trajectory, by the rules of joint_trajectory_controller.

    On the way no error may exceed its path tolerance. From the end on a joint has to
    come within its goal tolerances before the time for that is over; it need not stay
    there until the others come.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        start_ns: int,
        tolerances: Tolerances,
        is_continuous: np.ndarray,
    ) -> None:
        """Wait for the beginning.

        Args:
            trajectory: Where the joints should be. Before its first sample they go
                there from where they are.
            start_ns: When its times count from, in [ns].
            tolerances: How far they may be from it.
            is_continuous: Whether whole turns of a joint do not count, shape
                (n_joints,).
        """
        self.joint_names = trajectory.joint_names
        self.start_ns = start_ns
        every = np.arange(len(self.joint_names))
        self._playback = Playback(trajectory, start_ns, every, every)
        self._end = trajectory.duration
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
        wanted = self._playback.setpoint(time_ns)
        desired = np.stack([wanted.positions, wanted.velocities])
        error = desired - actual
        turns = np.round(error[0] / (2.0 * np.pi))
        error[0] -= np.where(self._is_continuous, 2.0 * np.pi * turns, 0.0)
        outcome, message = self._outcome(self._elapsed(time_ns), error)
        return Progress(desired, actual, error, outcome, message)

    def _outcome(self, time: float, error: np.ndarray) -> tuple[Outcome, str]:
        """Find what has become of the goal, with a message where it has failed."""
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


def remaining(trajectory: Trajectory, time: float) -> Trajectory | None:
    """Leave out the samples until a time, in [s]; None where no others follow."""
    first = int(np.searchsorted(trajectory.times, time + SNAP, side="right"))
    if first == len(trajectory.times):
        return None
    velocities, bases = trajectory.velocities, trajectory.base_poses
    return replace(
        trajectory,
        times=trajectory.times[first:],
        positions=trajectory.positions[first:],
        velocities=None if velocities is None else velocities[first:],
        base_poses=None if bases is None else bases[first:],
    )
