"""A motion: its samples, their interpolation, and fitting it to a robot."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, Union

import numpy as np

from g1_description.bounds import MAX_VALUE, NORM_TOLERANCE, UNIT_TOLERANCE
from g1_description.errors import InvalidValueError, MotionError, UnknownNameError
from g1_description.robot.description import Description
from g1_description.robot.rotation import multiply, normalized, rotate, shorter_turn
from g1_description.text import did_you_mean, listed, similar_first

SINGLE_TIME = 0.1
"""Duration of the velocities of a single sample, in [s]: a stream of single samples has
velocities, and when it stops the robot is at rest."""

SNAP = 0.5e-9
"""Times closer than this to a sample's are equal to it, in [s]: stamps have a
resolution of 1 ns."""

MAX_SAMPLES = 1_000_000
"""Most samples of a resampled motion."""

SAME_END = 1e-3
"""Periods by which a resampled motion may end later: files round times."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Configurations of one robot at increasing times.

    Raises:
        MotionError: If shapes do not match, times do not increase, or a number is not
            finite or out of bounds.
    """

    times: np.ndarray
    """Times of the configurations since the start, in [s], increasing, shape
    (n_samples,)."""

    joint_names: tuple[str, ...]

    positions: np.ndarray
    """Positions of the joints in [rad] or [m], shape (n_samples, n_joints)."""

    velocities: np.ndarray | None = None
    """Velocities of the joints in [rad/s] or [m/s], shape (n_samples, n_joints); None
    where they are unknown."""

    base_poses: np.ndarray | None = None
    """T_map_base, x y z and quaternion x y z w, shape (n_samples, 7); None if the
    motion has no base."""

    notes: tuple[str, ...] = ()
    """Messages of the file's reader on assumptions, and on joints that do not fit."""

    has_times: bool = True
    """Whether its file has times or a rate."""

    name: str = ""
    """Name in the file; else the name of the file without the extension."""

    def __repr__(self) -> str:
        """Show its size."""
        base = "without a base" if self.base_poses is None else "with a base"
        return (
            f"<Motion: {len(self.times)} samples from {self.times[0]:g} to "
            f"{self.times[-1]:g} s, {len(self.joint_names)} joints, {base}>"
        )

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
                f"Timestamps must increase: sample {late + 2} is at {after:g} s, "
                f"after one at {before:g} s."
            )

    def _check_names(self) -> None:
        """Check that no joint is named twice."""
        names = self.joint_names
        if len(set(names)) == len(names):
            return
        twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
        raise MotionError(f"The motion has duplicate joints: {listed(twice)}.")

    def _check(self, label: str, array: np.ndarray, shape: tuple[int, ...]) -> None:
        """Check one array's shape and numbers."""
        if array.shape != shape:
            raise MotionError(
                f"The {label} array of the motion must have the shape {shape} (got "
                f"{array.shape})."
            )
        with np.errstate(invalid="ignore"):  # NaN is not within bounds
            fits = np.abs(array) <= MAX_VALUE
        if not fits.all():
            first = tuple(np.argwhere(~fits)[0])
            raise MotionError(
                f"The {label} of sample {first[0] + 1} must be within +-{MAX_VALUE:g} "
                f"(got {array[first]})."
            )

    @property
    def trajectory(self) -> Motion:
        """The motion itself; deprecated."""
        warnings.warn(
            "Motion.trajectory is deprecated; use the motion itself",
            DeprecationWarning,
            stacklevel=2,
        )
        return self

    @property
    def base(self) -> np.ndarray | None:
        """``base_poses``, under the name of the arguments of ``Robot``."""
        return self.base_poses

    @property
    def begin(self) -> float:
        """Time of the first sample, in [s]."""
        return float(self.times[0])

    @property
    def end(self) -> float:
        """Time of the last sample, in [s]."""
        return float(self.times[-1])

    @property
    def duration(self) -> float:
        """Time from the first to the last sample, in [s]."""
        return self.end - self.begin

    @property
    def rest_time(self) -> float:
        """Time at which it comes to rest at its last sample, in [s]."""
        is_single = len(self.times) == 1 and self.velocities is not None
        return self.end + (SINGLE_TIME if is_single else 0.0)

    def cut(self, begin: float | None = None, end: float | None = None) -> Motion:
        """Cut a part out.

        Args:
            begin: Start of the part in [s], a time of the motion, where a sample is
                inserted; None: that of the motion.
            end: End of the part, in [s]; None: that of the motion.

        Returns:
            The part, with the motion's own times.

        Raises:
            InvalidValueError: If the part is not inside the motion.
        """
        begin = self.begin if begin is None else begin
        end = self.end if end is None else end
        if not self.begin <= begin <= end <= self.end:
            raise InvalidValueError(
                f"The requested range {begin:g}-{end:g} s is outside the motion "
                f"({self.begin:g}-{self.end:g} s)."
            )
        inside = (self.times > begin + SNAP) & (self.times < end - SNAP)
        ends = np.unique([begin, end])
        times = np.concatenate([ends[:1], self.times[inside], ends[1:]])
        return self.sampled(times)

    def sampled(self, times: np.ndarray) -> Motion:
        """Take other samples.

        Between samples joints follow cubic Hermite polynomials where velocities are
        known, else straight lines; the base has constant velocities (Shoemake, SIGGRAPH
        1985).

        Args:
            times: In [s], increasing, shape (n,); outside the motion its first or last
                sample is taken.

        Returns:
            The motion of these samples; at its end the last velocities are kept.

        Raises:
            MotionError: If the times do not increase.
        """
        found = sample(self, times)
        velocities = None
        if self.velocities is not None:
            velocities = found.velocities
            if times[-1] > self.end - SNAP:
                velocities[-1] = self.velocities[-1]
        return replace(
            self,
            times=times,
            positions=found.positions,
            velocities=velocities,
            base_poses=found.base_poses,
        )

    def resampled(self, rate: float) -> Motion:
        """Take evenly spaced samples.

        Args:
            rate: Samples per second, in [Hz].

        Returns:
            The motion from its first sample on; its last one is left out where the
            rate does not meet it.

        Raises:
            InvalidValueError: If the rate is not positive, or makes too many samples.
        """
        if not 0.0 < rate < np.inf:
            raise InvalidValueError(f"The rate must be greater than 0 (got {rate:g}).")
        n_samples = self.duration * rate + SAME_END
        if n_samples > MAX_SAMPLES:
            raise InvalidValueError(
                f"The motion would have {n_samples:.0f} samples at {rate:g} Hz; the "
                f"limit is {MAX_SAMPLES}."
            )
        times = self.begin + np.arange(int(n_samples) + 1) / rate
        found = self.sampled(np.minimum(times, self.end))
        return replace(found, times=times, has_times=True)

    def at_speed(self, speed: float, start: float = 0.0) -> Motion:
        """Scale the speed.

        Args:
            speed: Seconds of the motion in a second, positive.
            start: Time of the motion that becomes zero, in [s].

        Returns:
            The motion, with its velocities scaled, too.

        Raises:
            InvalidValueError: If the speed is not positive.
        """
        if not 0.0 < speed < np.inf:
            raise InvalidValueError(
                f"The speed must be greater than 0 (got {speed:g})."
            )
        velocities = self.velocities
        return replace(
            self,
            times=(self.times - start) / speed,
            velocities=None if velocities is None else speed * velocities,
        )

    def arranged(self, joint_names: Sequence[str]) -> Motion:
        """Keep exactly these joints, in this order.

        Args:
            joint_names: Joints that it does not have are at 0 rad or m; its others are
                left out.

        Returns:
            The motion, with notes on joints added and left out.
        """
        column = {name: number for number, name in enumerate(self.joint_names)}
        notes = [*self.notes]
        lost = [name for name in self.joint_names if name not in joint_names]
        if lost:
            tops = np.abs(self.positions).max(axis=0)
            each = listed(f"{name} (up to {tops[column[name]]:.3g})" for name in lost)
            notes.append(f"Ignored joints: {each}.")
        added = [name for name in joint_names if name not in column]
        if added:
            notes.append(f"Joints added at 0: {listed(added)}.")

        def of_joints(values: np.ndarray | None) -> np.ndarray | None:
            if values is None:
                return None
            wider = np.pad(values, ((0, 0), (0, 1)))  # the last column is 0
            return wider[:, [column.get(name, -1) for name in joint_names]]

        positions = of_joints(self.positions)
        assert positions is not None
        return replace(
            self,
            joint_names=tuple(joint_names),
            positions=positions,
            velocities=of_joints(self.velocities),
            notes=tuple(notes),
        )

    def renamed(self, names: Mapping[str, str]) -> Motion:
        """Rename joints.

        Args:
            names: New names by old names.

        Returns:
            The motion; joints without a new name keep theirs.

        Raises:
            UnknownNameError: If the motion has no joint of an old name.
            MotionError: If two joints would have the same name.
        """
        own = self.joint_names
        for name in names:
            if name not in own:
                raise UnknownNameError(
                    f"The motion has no joint '{name}'. Its joints: "
                    f"{listed(similar_first(name, own)) or 'none'}."
                )
        return replace(self, joint_names=tuple(names.get(n, n) for n in own))


class HasMotion(Protocol):
    """A result with a motion, such as an ``IkPath`` or ``Keyframes``."""

    @property
    def motion(self) -> Motion:
        """The motion."""


MotionLike = Union[Motion, HasMotion]


def as_motion(given: MotionLike) -> Motion:
    """Return a motion, or that of a result.

    Raises:
        MotionError: If it is neither.
    """
    motion = getattr(given, "motion", given)
    if not isinstance(motion, Motion):
        raise MotionError(
            "The motion must be a Motion, or a result that has one, such as an IkPath "
            f"or Keyframes (got {str(given)[:80]})."
        )
    return motion


def configuration(
    positions: Mapping[str, float], base: np.ndarray | None = None
) -> Motion:
    """Make a motion of one sample.

    Args:
        positions: Positions of joints in [rad] or [m], by name.
        base: Pose of the base in the map, shape (7,); None: unknown.
    """
    values = np.array([[*positions.values()]], dtype=float)
    poses = None if base is None else base[np.newaxis]
    return Motion(np.zeros(1), tuple(positions), values, base_poses=poses)


def _normalized(poses: np.ndarray) -> np.ndarray:
    """Scale quaternions of poses, shape (n, 7), to unit length: files round them."""
    lengths = np.sqrt(np.einsum("ij,ij->i", poses[:, 3:], poses[:, 3:]))
    errors = np.abs(lengths - 1.0)
    if errors.max() > NORM_TOLERANCE:
        wrong = np.argmax(errors > NORM_TOLERANCE)
        raise MotionError(
            f"The base quaternion of sample {wrong + 1} must have length 1 (got "
            f"{lengths[wrong]:.6g})."
        )
    rounded = errors > UNIT_TOLERANCE
    if rounded.any():
        poses = poses.copy()
        poses[rounded, 3:] = normalized(poses[rounded, 3:])
    return poses


@dataclass(frozen=True, eq=False)
class Sample:
    """Configurations and velocities at one or several times."""

    positions: np.ndarray
    """Positions of its joints in [rad] or [m], shape (..., n_joints)."""

    velocities: np.ndarray
    """In [rad/s] or [m/s], shape (..., n_joints)."""

    base_poses: np.ndarray | None
    """T_map_base, shape (..., 7); None if the motion has no base."""

    base_twists: np.ndarray | None
    """Linear velocity of the base's origin and its angular velocity, along the map's
    axes, in [m/s] and [rad/s], shape (..., 6)."""


def sample(motion: Motion, times: np.ndarray | float) -> Sample:
    """Interpolate a motion.

    Args:
        motion: The motion.
        times: Since its start in [s], shape (...).

    Returns:
        The configurations. At the time of a sample they equal the sample exactly, with
        the velocities of the following segment.
    """
    found = np.asarray(times, dtype=float)
    if len(motion.times) == 1:
        return _single(motion, found)
    first, last, gaps, moves = _segments(motion.times, found)
    elapsed = found - motion.times[first]
    fraction = np.where(moves & (elapsed > SNAP), elapsed, 0.0) / gaps
    positions, velocities = _joints(motion, first, last, fraction, gaps)
    velocities = np.where(moves[..., np.newaxis], velocities, 0.0)
    if motion.base_poses is None:
        return Sample(positions, velocities, None, None)
    begin, end = motion.base_poses[first], motion.base_poses[last]
    poses, twists = _base(begin, end, fraction, gaps)
    return Sample(
        positions, velocities, poses, np.where(moves[..., np.newaxis], twists, 0.0)
    )


def _single(motion: Motion, times: np.ndarray) -> Sample:
    """Return the only sample of a motion, with velocities for ``SINGLE_TIME``."""
    n_joints = len(motion.joint_names)
    positions = np.broadcast_to(motion.positions[0], (*times.shape, n_joints))
    velocities = np.zeros(positions.shape)
    if motion.velocities is not None:
        is_shown = times > motion.end - SNAP
        is_shown &= times < motion.rest_time
        velocities[is_shown] = motion.velocities[0]
    if motion.base_poses is None:
        return Sample(positions, velocities, None, None)
    poses = np.broadcast_to(motion.base_poses[0], (*times.shape, 7))
    return Sample(positions, velocities, poses, np.zeros((*times.shape, 6)))


def _segments(
    knots: np.ndarray, times: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Find the samples before and after times.

    Returns:
        Indices of the samples before and after each time, the time between them in [s]
        (1 without one), and whether the motion moves.
    """
    first = np.searchsorted(knots, times + SNAP, side="right") - 1
    moves = (first >= 0) & (first < len(knots) - 1)
    first = np.minimum(np.maximum(first, 0), len(knots) - 1)  # np.clip is slow
    last = np.minimum(first + 1, len(knots) - 1)
    return first, last, np.where(moves, knots[last] - knots[first], 1.0), moves


def _joints(
    motion: Motion,
    first: np.ndarray,
    last: np.ndarray,
    fraction: np.ndarray,
    gaps: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Interpolate the joints; return positions and velocities."""
    s, h = fraction[..., np.newaxis], gaps[..., np.newaxis]
    p0, p1 = motion.positions[first], motion.positions[last]
    if motion.velocities is None:
        return p0 + s * (p1 - p0), (p1 - p0) / h
    # Cubic Hermite polynomial on [0, 1], and its derivative.
    v0, v1 = h * motion.velocities[first], h * motion.velocities[last]
    step = p1 - p0
    square, cube = 3.0 * step - 2.0 * v0 - v1, v0 + v1 - 2.0 * step
    positions = p0 + s * (v0 + s * (square + s * cube))
    return positions, (v0 + s * (2.0 * square + 3.0 * s * cube)) / h


def _base(
    begin: np.ndarray, end: np.ndarray, fraction: np.ndarray, gaps: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Interpolate the base's pose; return poses and twists."""
    s, h = fraction[..., np.newaxis], gaps[..., np.newaxis]
    offset = end[..., :3] - begin[..., :3]
    axis, half = shorter_turn(begin[..., 3:], end[..., 3:])
    part = np.concatenate([np.sin(s * half) * axis, np.cos(s * half)], axis=-1)
    poses = np.concatenate(
        [begin[..., :3] + s * offset, multiply(begin[..., 3:], part)], axis=-1
    )
    spin = rotate(begin[..., 3:], 2.0 * half * axis)
    return poses, np.concatenate([offset, spin], axis=-1) / h


def fitted(motion: Motion, robot: Description) -> Motion:
    """Remove the joints that a robot does not have.

    Returns:
        The motion of the other joints, in their order, with notes.

    Raises:
        MotionError: If the robot has none of its joints.
    """
    own = [joint.name for joint in robot.movable_joints]
    names = motion.joint_names
    if not names and motion.base_poses is None:
        raise MotionError("The motion has neither joints nor a base.")
    unknown = [name for name in names if name not in own]
    if names and len(unknown) == len(names):
        raise MotionError(
            f"{robot.name} has none of the motion's joints, {listed(names)}. Its "
            f"joints: {listed(own)}."
        )
    notes = [*motion.notes]
    missing = [name for name in own if name not in names]
    if unknown:
        notes.append(
            f"Joints that {robot.name} does not have are ignored: {listed(unknown)}"
            f"{did_you_mean(unknown[0], missing)}."
        )
    if missing:
        notes.append(
            f"Joints missing from the motion are not moved: {listed(missing)}."
        )
    if unknown:
        motion = motion.arranged([name for name in names if name not in unknown])
    return replace(motion, notes=tuple(notes))
