"""A motion in memory, wherever it came from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from g1_description.core.bounds import MAX_VALUE, NORM_TOLERANCE
from g1_description.core.errors import MotionError
from g1_description.core.rotation import normalized
from g1_description.core.text import listed

SINGLE_TIME = 0.1
"""How long a motion of a single sample has that sample's velocities, in [s]: who sends
one sample after the other wants to see them, and who stops is at rest soon."""

UNIT_TOLERANCE = 1e-12
"""A quaternion this near to unit length stays as it is."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Configurations of one robot at rising times.

    Raises:
        MotionError: If shapes do not match, times do not rise, or a number is not
            finite or out of bounds.
    """

    times: np.ndarray
    """When the robot is in each configuration, since the beginning, in [s], rising,
    shape (n_samples,)."""

    joint_names: tuple[str, ...]

    positions: np.ndarray
    """Positions of the joints in [rad] or [m], shape (n_samples, n_joints)."""

    velocities: np.ndarray | None = None
    """Velocities of the joints in [rad/s] or [m/s], shape (n_samples, n_joints); None
    where they are unknown."""

    base_poses: np.ndarray | None = None
    """T_map_base, x y z and quaternion x y z w, shape (n_samples, 7); None where the
    base does not belong to the motion."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        n_samples, n_joints = len(self.times), len(self.joint_names)
        if not n_samples:
            raise MotionError("The motion has no samples.")
        self._check_names()
        self._check("time", self.times, (n_samples,))
        self._check("position", self.positions, (n_samples, n_joints))
        if self.velocities is not None:
            self._check("velocity", self.velocities, (n_samples, n_joints))
        if self.base_poses is not None:
            self._check("base pose", self.base_poses, (n_samples, 7))
            object.__setattr__(self, "base_poses", _normalized(self.base_poses))
        is_late = self.times[1:] <= self.times[:-1]
        if is_late.any():
            late = int(np.argmax(is_late))
            before, after = self.times[late], self.times[late + 1]
            raise MotionError(
                f"The times of the motion do not rise: sample {late + 2} is at "
                f"{after:g} s, the one before at {before:g} s."
            )

    def _check_names(self) -> None:
        """Check that no joint is named twice."""
        names = self.joint_names
        if len(set(names)) == len(names):
            return
        twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
        raise MotionError(f"The motion names joints twice: {listed(twice)}.")

    def _check(self, what: str, array: np.ndarray, shape: tuple[int, ...]) -> None:
        """Check one array's shape and numbers."""
        if array.shape != shape:
            raise MotionError(
                f"The motion has an array of shape {array.shape} for each {what}, "
                f"where {shape} belongs to {shape[0]} samples."
            )
        with np.errstate(invalid="ignore"):  # NaN does not fit
            fits = np.abs(array) <= MAX_VALUE
        if not fits.all():
            first = tuple(np.argwhere(~fits)[0])
            raise MotionError(
                f"Sample {first[0] + 1} of the motion has the {what} {array[first]}; "
                f"numbers must be within +-{MAX_VALUE:g}."
            )

    @property
    def duration(self) -> float:
        """Time from zero to the last sample, in [s]."""
        return float(self.times[-1])

    @property
    def rest_time(self) -> float:
        """Time from which on it rests at its last sample, in [s]."""
        is_single = len(self.times) == 1 and self.velocities is not None
        return self.duration + (SINGLE_TIME if is_single else 0.0)


def _normalized(poses: np.ndarray) -> np.ndarray:
    """Scale quaternions to unit length, which rounding in a file spoils.

    Args:
        poses: Poses, shape (n, 7).

    Raises:
        MotionError: If one is far from it.
    """
    lengths = np.sqrt(np.einsum("ij,ij->i", poses[:, 3:], poses[:, 3:]))
    errors = np.abs(lengths - 1.0)
    if errors.max() > NORM_TOLERANCE:
        wrong = np.argmax(errors > NORM_TOLERANCE)
        raise MotionError(
            f"The base of sample {wrong + 1} has a quaternion of length "
            f"{lengths[wrong]:.6g}, not 1."
        )
    rounded = errors > UNIT_TOLERANCE
    if rounded.any():
        poses = poses.copy()
        poses[rounded, 3:] = normalized(poses[rounded, 3:])
    return poses
