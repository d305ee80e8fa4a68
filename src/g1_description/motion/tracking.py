"""How well motors followed a motion: errors, saturated efforts, and falls."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from g1_description.errors import InvalidValueError

REACHED = 0.01
"""Error at which a joint has reached its motion, in [rad] or [m]. Before, it moves
there from its initial position, which is not an error."""

MAX_LISTED = 5
"""Number of joints in a text, those with the largest errors."""


@dataclass(frozen=True)
class FallLimits:
    """Largest deviations of the base from its motion without a fall."""

    lean: float = math.pi / 4.0
    """Angle between the two upward axes in [rad]: no humanoid recovers from more."""

    drop: float = 0.25
    """Difference in height in [m]: lower, it is on its knees."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: If one is out of its range.
        """
        if not 0.0 <= self.lean <= math.pi:
            raise InvalidValueError(f"lean must be from 0 to pi (got {self.lean})")
        if not self.drop >= 0.0:
            raise InvalidValueError(f"drop must be at least 0 (got {self.drop})")


@dataclass(frozen=True, eq=False)
class TrackingReport:
    """How motors followed a motion."""

    joint_names: tuple[str, ...]

    rms_errors: np.ndarray
    """RMS of position minus target in [rad] or [m], shape (n,): since the joint first
    reached the motion, or over all steps if it never did."""

    largest_errors: np.ndarray
    """Largest distance from the target since then, in [rad] or [m], shape (n,)."""

    limit_shares: np.ndarray
    """Fraction of the steps with the motor at its effort limit, shape (n,)."""

    largest_error_times: np.ndarray
    """Time of the largest error since the start of the motion, in [s], shape (n,); NaN
    without an error."""

    first_limit_times: np.ndarray
    """First time of the motor at its limit, in [s], shape (n,); NaN if never."""

    duration: float
    """How long the motors followed, in [s]."""

    fall_time: float | None = None
    """Time of a fall since the start of the motion, in [s]; None without a fall."""

    def __str__(self) -> str:
        """Summarize it, with the joints of the largest errors."""
        if not self.joint_names:
            return "No joint followed the motion."
        worst = np.argsort(-self.rms_errors, kind="stable")[:MAX_LISTED]
        width = max(len(self.joint_names[row]) for row in worst)
        total = math.sqrt(float(np.mean(self.rms_errors**2)))
        fall = "it did not fall"
        if self.fall_time is not None:
            fall = f"it fell after {self.fall_time:.2f} s"
        lines = [
            f"{len(self.joint_names)} joints followed for {self.duration:.2f} s, rms "
            f"error {total:.4f}; {fall}",
            f"{'largest rms errors':{width}}     rms  largest     when  "
            "at effort limit",
        ]
        for row in worst:
            time = float(self.largest_error_times[row])
            when = " " * 7 if math.isnan(time) else f"{time:5.2f} s"
            lines.append(
                f"{self.joint_names[row]:{width}}  {self.rms_errors[row]:6.4f}   "
                f"{self.largest_errors[row]:6.4f}  {when}  "
                f"{100.0 * self.limit_shares[row]:6.1f} %"
            )
        return "\n".join(lines)


class TrackingRecorder:
    """Collects the numbers of a report, for a motion's joints."""

    def __init__(self, joint_names: tuple[str, ...]) -> None:
        n_joints = len(joint_names)
        self._names = joint_names
        self._has_reached = np.zeros(n_joints, dtype=bool)
        # Steps in total, those with counted errors, and those at the effort limit.
        self._steps, self._counts, self._at_limit = np.zeros((3, n_joints), dtype=int)
        self._squares, self._largest = np.zeros((2, n_joints))
        self._largest_times, self._limit_times = np.full((2, n_joints), np.nan)
        self._begin: float | None = None
        self._end = 0.0

    def add(
        self,
        times: np.ndarray,
        joints: np.ndarray,
        errors: np.ndarray,
        at_limit: np.ndarray,
    ) -> None:
        """Add steps.

        Args:
            times: Since the motion's beginning, in [s], shape (n_steps,).
            joints: Indices of the joints that the motion still moves, shape (n,).
            errors: Their positions minus their targets, in [rad] or [m], shape
                (n_steps, n).
            at_limit: Whether their motors are at their effort limits, shape
                (n_steps, n).
        """
        self._begin = times[0] if self._begin is None else self._begin
        self._end = times[-1]
        self._steps[joints] += len(times)
        sizes = np.abs(errors)
        has_reached = np.logical_or.accumulate(sizes <= REACHED)
        is_new = has_reached[-1] & ~self._has_reached[joints]
        reaching = joints[is_new]
        if reaching.size:  # earlier errors are those of the path there
            self._has_reached[reaching] = True
            self._counts[reaching], self._squares[reaching] = 0, 0.0
            self._largest[reaching], self._largest_times[reaching] = 0.0, np.nan
        counts = has_reached | ~is_new
        self._counts[joints] += counts.sum(axis=0)
        sizes = np.where(counts, sizes, 0.0)
        self._squares[joints] += (sizes**2).sum(axis=0)
        largest, at = sizes.max(axis=0), times[sizes.argmax(axis=0)]
        is_larger = largest > self._largest[joints]
        self._largest[joints[is_larger]] = largest[is_larger]
        self._largest_times[joints[is_larger]] = at[is_larger]
        if at_limit.any():
            first = times[at_limit.argmax(axis=0)]
            is_first = at_limit.any(axis=0) & (self._at_limit[joints] == 0)
            self._limit_times[joints[is_first]] = first[is_first]
            self._at_limit[joints] += at_limit.sum(axis=0)

    def report(self, fall_time: float | None) -> TrackingReport:
        """Compute the report; the time of a fall is in [s]."""
        return TrackingReport(
            self._names,
            np.sqrt(self._squares / np.maximum(self._counts, 1)),
            self._largest.copy(),
            self._at_limit / np.maximum(self._steps, 1),
            self._largest_times.copy(),
            self._limit_times.copy(),
            0.0 if self._begin is None else self._end - self._begin,
            fall_time,
        )


class FallDetector:
    """Detects falls by comparing the base with its motion.

    A base has fallen if it leans from the motion's by more than ``FallLimits.lean``, in
    any direction, or has sunk by ``FallLimits.drop`` more than the motion's since the
    start. Without a base in the motion, it is compared with its initial attitude, at
    any height.

    Args:
        base_pose: T_world_base at the start, shape (7,).
        desired: Base pose of the motion at that time, shape (7,); None without a base.
        limits: Largest deviations without a fall.
    """

    def __init__(
        self,
        base_pose: np.ndarray,
        desired: np.ndarray | None,
        limits: FallLimits | None = None,
    ) -> None:
        self._up = _up(base_pose)
        self._offset = 0.0 if desired is None else float(desired[2] - base_pose[2])
        self._limits = limits or FallLimits()

    def has_fallen(
        self, base_poses: np.ndarray, desired: np.ndarray | None
    ) -> np.ndarray:
        """Return whether a base has fallen.

        Args:
            base_poses: T_world_base, shape (..., 7).
            desired: Their desired poses, shape (..., 7); None without a base.

        Returns:
            Shape (...).
        """
        up = self._up if desired is None else _up(desired)
        cosines = sum(a * b for a, b in zip(_up(base_poses), up))
        fallen = np.asarray(cosines < math.cos(self._limits.lean))
        if desired is not None:
            drop = desired[..., 2] - base_poses[..., 2] - self._offset
            fallen = fallen | (drop > self._limits.drop)
        return fallen


def _up(poses: np.ndarray) -> tuple[np.ndarray, ...]:
    """Compute the world's z axis in the base's own frame, each part of shape (n,)."""
    x, y, z, w = poses.T[3:]
    return 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
