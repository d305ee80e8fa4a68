"""How well motors followed a motion: errors, efforts at their limits, and a fall."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from g1_description.errors import InvalidValueError

REACHED = 0.01
"""How near a joint is to a motion that it has reached, in [rad] or [m]. The way there,
where the motion begins elsewhere than the robot, is no error of the motion's."""

MAX_LISTED = 5
"""How many joints a text lists, the worst ones."""


@dataclass(frozen=True)
class FallLimits:
    """From where on a base has fallen, beside that of its motion."""

    lean: float = math.pi / 4.0
    """Greatest angle between the two upward axes in [rad]: no humanoid comes back from
    farther."""

    drop: float = 0.25
    """How much lower it may be in [m]: below, it is on its knees."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: If one is out of its range.
        """
        if not 0.0 <= self.lean <= math.pi:
            raise InvalidValueError(f"lean is {self.lean}, it must be from 0 to pi")
        if not self.drop >= 0.0:
            raise InvalidValueError(f"drop is {self.drop}, it must be at least 0")


@dataclass(frozen=True, eq=False)
class TrackingReport:
    """What became of a motion that motors followed."""

    joint_names: tuple[str, ...]

    rms_errors: np.ndarray
    """Root of the mean square of position minus target, in [rad] or [m], shape (n,):
    from when the joint first reached the motion, over all steps where it never did."""

    largest_errors: np.ndarray
    """Largest distance from the target in these steps, in [rad] or [m], shape (n,)."""

    limit_shares: np.ndarray
    """Share of the time in which the motor gave all it can, from 0 to 1, shape (n,)."""

    largest_error_times: np.ndarray
    """When the error was largest, since the motion's beginning, in [s], shape (n,); NaN
    where there was none."""

    first_limit_times: np.ndarray
    """When the motor first gave all it can, in [s], shape (n,); NaN where never."""

    duration: float
    """How long the motors followed, in [s]."""

    fall_time: float | None = None
    """When it fell, since the motion's beginning, in [s]; None if it did not."""

    def __str__(self) -> str:
        """Describe it in a few lines, with the joints that were worst."""
        if not self.joint_names:
            return "No joint followed the motion."
        worst = np.argsort(-self.rms_errors, kind="stable")[:MAX_LISTED]
        width = max(len(self.joint_names[row]) for row in worst)
        total = math.sqrt(float(np.mean(self.rms_errors**2)))
        lines = [
            f"{len(self.joint_names)} joints followed for {self.duration:.2f} s, rms "
            f"error {total:.4f}; {self._fall()}",
            f"{'largest rms errors':{width}}     rms  largest     when  "
            "at effort limit",
        ]
        lines += [
            f"{self.joint_names[row]:{width}}  {self.rms_errors[row]:6.4f}   "
            f"{self.largest_errors[row]:6.4f}  {self._time(row)}  "
            f"{100.0 * self.limit_shares[row]:6.1f} %"
            for row in worst
        ]
        return "\n".join(lines)

    def _time(self, row: int) -> str:
        """Say when a joint's error was largest."""
        time = float(self.largest_error_times[row])
        return " " * 7 if math.isnan(time) else f"{time:5.2f} s"

    def _fall(self) -> str:
        """Say whether it fell."""
        if self.fall_time is None:
            return "it did not fall"
        return f"it fell after {self.fall_time:.2f} s"


class TrackingRecorder:
    """Collects what a report tells, a step at a time."""

    def __init__(self, joint_names: tuple[str, ...]) -> None:
        """Begin without steps.

        Args:
            joint_names: The joints that the motion moves.
        """
        self._names = joint_names
        self._steps = np.zeros(len(joint_names), dtype=int)
        self._has_reached = np.zeros(len(joint_names), dtype=bool)
        self._counts = np.zeros(len(joint_names), dtype=int)
        self._squares = np.zeros(len(joint_names))
        self._largest = np.zeros(len(joint_names))
        self._largest_times = np.full(len(joint_names), np.nan)
        self._at_limit = np.zeros(len(joint_names), dtype=int)
        self._limit_times = np.full(len(joint_names), np.nan)
        self._begin: float | None = None
        self._end = 0.0

    def add(
        self, time: float, joints: np.ndarray, errors: np.ndarray, at_limit: np.ndarray
    ) -> None:
        """Add a step.

        Args:
            time: Since the motion's beginning, in [s].
            joints: Which of the joints the motion still moves, shape (n,).
            errors: Their positions minus their targets, in [rad] or [m], shape (n,).
            at_limit: Whether their motors gave all they can, shape (n,).
        """
        if self._begin is None:
            self._begin = time
        self._end = time
        self._steps[joints] += 1
        sizes = np.abs(errors)
        self._begin_at(joints[(sizes <= REACHED) & ~self._has_reached[joints]])
        self._counts[joints] += 1
        self._squares[joints] += errors**2
        is_larger = sizes > self._largest[joints]
        self._largest[joints[is_larger]] = sizes[is_larger]
        self._largest_times[joints[is_larger]] = time
        if at_limit.any():
            limited = joints[at_limit]
            self._limit_times[limited[self._at_limit[limited] == 0]] = time
            self._at_limit[limited] += 1

    def _begin_at(self, joints: np.ndarray) -> None:
        """Forget the errors of joints until now, which reach the motion only now."""
        if joints.size:
            self._has_reached[joints] = True
            self._counts[joints], self._squares[joints] = 0, 0.0
            self._largest[joints], self._largest_times[joints] = 0.0, np.nan

    def report(self, fall_time: float | None) -> TrackingReport:
        """Compute what became of the motion.

        Args:
            fall_time: When it fell, in [s].
        """
        counts = np.maximum(self._counts, 1)
        return TrackingReport(
            self._names,
            np.sqrt(self._squares / counts),
            self._largest.copy(),
            self._at_limit / np.maximum(self._steps, 1),
            self._largest_times.copy(),
            self._limit_times.copy(),
            0.0 if self._begin is None else self._end - self._begin,
            fall_time,
        )


class FallDetector:
    """Finds when a base leaves the way of a motion for the floor.

    It has fallen when it leans by more than ``FallLimits.lean`` from the motion's base,
    in any direction, or has sunk since the beginning by ``FallLimits.drop`` more than
    that. Where the motion has no base, it is to stand as it did at the beginning, at
    any height.
    """

    def __init__(
        self,
        base_pose: np.ndarray,
        wanted: np.ndarray | None,
        limits: FallLimits | None = None,
    ) -> None:
        """Begin.

        Args:
            base_pose: T_world_base at the beginning, shape (7,).
            wanted: The motion's at that time, shape (7,); None where it has none.
            limits: From where on a base has fallen.
        """
        self._up = _up(base_pose)
        self._offset = 0.0 if wanted is None else float(wanted[2] - base_pose[2])
        limits = limits or FallLimits()
        self._least_cosine, self._max_drop = math.cos(limits.lean), limits.drop

    def has_fallen(self, base_pose: np.ndarray, wanted: np.ndarray | None) -> bool:
        """Return whether the base is where none is that stands.

        Args:
            base_pose: T_world_base now, shape (7,).
            wanted: The motion's, shape (7,); None where it has none.
        """
        up = self._up if wanted is None else _up(wanted)
        if sum(a * b for a, b in zip(_up(base_pose), up)) < self._least_cosine:
            return True
        drop = 0.0 if wanted is None else wanted[2] - base_pose[2] - self._offset
        return bool(drop > self._max_drop)


def _up(pose: np.ndarray) -> tuple[float, float, float]:
    """Compute the world's z axis in the base's own frame."""
    x, y, z, w = pose[3:].tolist()
    return 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
