"""A motion of a robot at the times that checks look at."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from g1_description.errors import MotionError
from g1_description.motion.trajectory import Sample, Trajectory, sample
from g1_description.robot.assembly import root_in_base
from g1_description.robot.description import Description, Joint
from g1_description.robot.dynamics import RobotMotion
from g1_description.robot.rotation import cross, rotate, shorter_turn
from g1_description.robot.transform import IDENTITY, compose

MAX_TIMES = 200_000
"""At how many times a motion can be judged: 55 minutes at 60 Hz."""

CHUNK = 512
"""Samples that are worked on at once: some 20 MB of intermediate results."""


@dataclass(frozen=True, eq=False)
class States:
    """All movable joints of a robot, and its base, at rising times."""

    trajectory: Trajectory
    times: np.ndarray
    """In [s], rising, shape (n,): those of the motion's samples, and times between
    them where these are far apart."""

    columns: np.ndarray
    """Rows of the motion's joints among the robot's movable ones, shape (k,)."""

    n_joints: int
    """How many movable joints the robot has."""

    T_base_root: np.ndarray = field(default_factory=lambda: IDENTITY)
    """The root link in the base link, which is another one where the root is the world
    and the robot floats in it, shape (7,)."""

    @property
    def has_base(self) -> bool:
        """Whether the motion says where the base is."""
        return self.trajectory.base_poses is not None

    @cached_property
    def own_rows(self) -> np.ndarray:
        """Rows of the motion's own samples among the times, shape (n_samples,)."""
        return np.searchsorted(self.times, self.trajectory.times)

    def spread(self, values: np.ndarray, fill: float) -> np.ndarray:
        """Put values of the motion's own samples among all times.

        Args:
            values: Shape (n_samples, ...).
            fill: The value at other times.

        Returns:
            Shape (n, ...).
        """
        found = np.full((len(self.times), *values.shape[1:]), fill)
        found[self.own_rows] = values
        return found

    def joints_of(self, movable: Sequence[Joint]) -> list[Joint]:
        """Select the motion's joints from all movable ones, in the motion's order."""
        return [movable[column] for column in self.columns]

    def chunks(self) -> Iterator[slice]:
        """Cut the times into pieces that fit into memory."""
        for first in range(0, len(self.times), CHUNK):
            yield slice(first, min(first + CHUNK, len(self.times)))

    def at(
        self, times: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Find the whole robot at some times.

        Args:
            times: In [s], shape (m,).

        Returns:
            Root poses, shape (m, 7), all joints' positions, shape (m, n_joints), root
            twists, shape (m, 6), and all joints' velocities, shape (m, n_joints).
            Joints that the motion does not have are at zero, a base that it does not
            have is at the map's origin.
        """
        found = sample(self.trajectory, times)
        positions = np.zeros((2, len(times), self.n_joints))
        positions[0][:, self.columns] = found.positions
        positions[1][:, self.columns] = found.velocities
        poses, twists = _base_of(found, len(times))
        if self.T_base_root is not IDENTITY:
            roots = compose(poses, self.T_base_root)
            lever = roots[:, :3] - poses[:, :3]
            twists = twists.copy()
            twists[:, :3] += cross(twists[:, 3:], lever)
            poses = roots
        return poses, positions[0], twists, positions[1]

    def joint_states(self) -> tuple[np.ndarray, np.ndarray]:
        """Find the motion's joints at all times, piece by piece to save memory.

        Returns:
            Positions and velocities in [rad] or [m] and per second, shape (n, k) each.
        """
        shape = (len(self.times), len(self.columns))
        positions, velocities = np.empty(shape), np.empty(shape)
        for piece in self.chunks():
            found = sample(self.trajectory, self.times[piece])
            positions[piece], velocities[piece] = found.positions, found.velocities
        return positions, velocities

    def base_poses(self) -> np.ndarray:
        """Find the base at all times, shape (n, 7), likewise."""
        poses = np.empty((len(self.times), 7))
        for piece in self.chunks():
            found = sample(self.trajectory, self.times[piece])
            poses[piece] = _base_of(found, piece.stop - piece.start)[0]
        return poses

    def dynamics(self, times: np.ndarray, window: float) -> RobotMotion:
        """Find how the robot moves, by differences over a time before and after.

        Args:
            times: In [s], shape (m,).
            window: In [s].

        Returns:
            Velocities are means over the window on both sides, accelerations are
            differences between those of both sides.
        """
        before, now, after = (self.at(times + shift) for shift in (-window, 0, window))
        back, ahead = _step(before[0], now[0]), _step(now[0], after[0])
        joints = [row[1] for row in (before, now, after)]
        return RobotMotion(
            now[0],
            now[1],
            (back + ahead) / (2.0 * window),
            (joints[2] - joints[0]) / (2.0 * window),
            (ahead - back) / window**2,
            (joints[2] - 2.0 * joints[1] + joints[0]) / window**2,
        )


def states_of(
    trajectory: Trajectory, robot: Description, longest_interval: float
) -> States:
    """Choose the times at which checks look at a motion.

    Args:
        trajectory: Of joints that the robot has.
        robot: The robot.
        longest_interval: At least so often, in [s].

    Raises:
        MotionError: If these are more times than fit into memory.
    """
    names = [joint.name for joint in robot.movable_joints]
    columns = [names.index(name) for name in trajectory.joint_names]
    times = _refined(trajectory.times, longest_interval)
    rows = np.array(columns, dtype=int)
    return States(trajectory, times, rows, len(names), root_in_base(robot))


def _refined(knots: np.ndarray, longest: float) -> np.ndarray:
    """Put times between samples that are far apart, at even distances."""
    gaps = np.diff(knots)
    parts = np.maximum(1.0, np.ceil(gaps / longest - 1e-9))
    if parts.sum() >= MAX_TIMES:
        raise MotionError(
            f"The motion lasts {knots[-1] - knots[0]:g} s and would be judged at "
            f"{parts.sum() + 1:.0f} times; {MAX_TIMES} are possible. Judge a part of "
            "it, or set a larger longest_interval."
        )
    if (parts == 1).all():
        return np.asarray(knots, dtype=float)
    parts = parts.astype(int)
    starts = np.repeat(knots[:-1], parts)
    number = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    between = starts + number * np.repeat(gaps / parts, parts)
    return np.append(between, knots[-1])


def _base_of(found: Sample, n_times: int) -> tuple[np.ndarray, np.ndarray]:
    """Return poses and twists of the base, at rest at the origin if there is none."""
    if found.base_poses is None or found.base_twists is None:
        return np.tile(IDENTITY, (n_times, 1)), np.zeros((n_times, 6))
    return found.base_poses, found.base_twists


def rotation_vectors(begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Find the shorter turns from rotations to others.

    Args:
        begin: Unit quaternions (x, y, z, w) in the map, shape (m, 4).
        end: Likewise.

    Returns:
        Axis times angle in the map, in [rad], shape (m, 3).
    """
    axis, half = shorter_turn(begin, end)
    return rotate(begin, 2.0 * half * axis)


def _step(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Return the way and the rotation vector from poses to others, shape (m, 6)."""
    turns = rotation_vectors(before[:, 3:], after[:, 3:])
    return np.concatenate([after[:, :3] - before[:, :3], turns], axis=1)
