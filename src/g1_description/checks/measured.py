"""What is measured of a motion, at the times that checks look at."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from g1_description.checks.balance import (
    Balance,
    long_still,
    margins,
    zero_moment_points,
)
from g1_description.checks.ground import Ground, GroundFrames
from g1_description.checks.thresholds import Thresholds
from g1_description.collisions.distances import Contacts
from g1_description.collisions.self_collisions import SelfCollisions
from g1_description.errors import MotionError
from g1_description.motion.trajectory import Sample, Trajectory, sample
from g1_description.robot.assembly import root_in_base
from g1_description.robot.description import Description, Joint
from g1_description.robot.dynamics import (
    GRAVITY,
    Dynamics,
    Masses,
    RobotMotion,
    inverse_dynamics,
)
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.rotation import cross, rotate, shorter_turn
from g1_description.robot.transform import IDENTITY, compose

MAX_TIMES = 200_000
"""At how many times a motion can be checked: 55 minutes at 60 Hz."""

CHUNK = 512
"""Samples that are worked on at once: some 20 MB of intermediate results."""


@dataclass(frozen=True)
class Parts:
    """What is known of a robot before any motion."""

    description: Description

    joints: tuple[Joint, ...]
    """The movable ones."""

    ground_links: tuple[str, ...]
    """Links with an outline."""

    kinematics: Kinematics
    masses: Masses
    ground: Ground
    collisions: SelfCollisions
    thresholds: Thresholds


@dataclass(eq=False)
class Measured:
    """A motion, and arrays over the times that checks look at.

    What no check needs is None.
    """

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

    positions: np.ndarray = field(init=False)
    """Of the motion's joints in [rad] or [m], shape (n, k)."""

    velocities: np.ndarray = field(init=False)
    """In [rad/s] or [m/s], shape (n, k)."""

    contacts: Contacts | None = None
    """Self-collisions; ``frame`` is the row of the time."""

    ground: GroundFrames | None = None
    """How the robot stands."""

    ground_links: tuple[str, ...] = ()
    """Links that are ever low enough to bear, or lower than all others: the columns of
    ``heights`` and ``bearing``."""

    balance: Balance | None = None
    """Where the weight acts; None where the motion has no base, or the robot no mass.
    """

    efforts: np.ndarray | None = None
    """Of the joints of a robot that is fixed, in [N m] or [N], shape (n, n_joints)."""

    def __post_init__(self) -> None:
        """Find the motion's joints at all times, piece by piece to save memory."""
        shape = (len(self.times), len(self.columns))
        self.positions, self.velocities = np.empty(shape), np.empty(shape)
        for piece in self.chunks():
            found = sample(self.trajectory, self.times[piece])
            self.positions[piece] = found.positions
            self.velocities[piece] = found.velocities

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Joints of the motion."""
        return self.trajectory.joint_names

    @property
    def heights(self) -> np.ndarray | None:
        """Of lowest points of links above the floor in [m], shape (n, n_ground_links).

        Infinite for a link that is neither the lowest one nor near the floor.
        """
        return None if self.ground is None else self.ground.heights

    @property
    def bearing(self) -> np.ndarray | None:
        """Which links are in contact with the floor, shape (n, n_ground_links)."""
        return None if self.ground is None else self.ground.bears

    @property
    def support(self) -> Sequence[np.ndarray]:
        """Points of contact along the map's x and y, in [m], shape (k, 2) per time."""
        return () if self.ground is None else self.ground.support

    @cached_property
    def depth(self) -> np.ndarray:
        """Of the deepest self-collision in [m], zero where there is none, shape (n,).

        NaN where collisions were not looked for.
        """
        if self.contacts is None:
            return np.full(len(self.times), np.nan)
        depth = np.zeros(len(self.times))
        np.maximum.at(depth, self.contacts.frame, -self.contacts.distance)
        return depth

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

    def base_poses(self) -> np.ndarray:
        """Find the poses of the base at all times, shape (n, 7)."""
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


def measured_motion(
    trajectory: Trajectory, parts: Parts, needed: Collection[str]
) -> Measured:
    """Measure a motion.

    Args:
        trajectory: Of joints that the robot has.
        parts: The robot.
        needed: ``contacts``, ``ground``, ``balance``, ``efforts``.

    Raises:
        MotionError: If there are more times than fit into memory.
    """
    names = [joint.name for joint in parts.joints]
    columns = [names.index(name) for name in trajectory.joint_names]
    found = Measured(
        trajectory,
        _refined(trajectory.times, parts.thresholds.longest_interval),
        np.array(columns, dtype=int),
        len(names),
        root_in_base(parts.description),
    )
    pieces = [_piece(found, piece, parts, needed) for piece in found.chunks()]

    def joined(name: str) -> np.ndarray | None:
        known = [piece[name] for piece in pieces if name in piece]
        return np.concatenate(known) if known else None

    if "contacts" in needed:
        found.contacts = _joined_contacts([piece["contacts"] for piece in pieces])
    found.efforts = joined("efforts")
    if "ground" in needed:
        grounds = [piece["ground"] for piece in pieces]
        found.ground = parts.ground.frames(grounds, found.times)
        columns = found.ground.columns.tolist()
        found.ground_links = tuple(parts.ground_links[column] for column in columns)
    center, zmp, is_still = joined("center"), joined("zmp"), joined("is_still")
    if not (found.ground is None or center is None or zmp is None or is_still is None):
        of_center, of_zmp = margins(found.ground.support, center[:, :2], zmp)
        still = long_still(found.times, is_still)
        found.balance = Balance(center, of_center, of_zmp, still)
    return found


def _piece(
    motion: Measured, piece: slice, parts: Parts, needed: Collection[str]
) -> dict[str, Any]:
    """Measure some samples."""
    times = motion.times[piece]
    base, positions, twists, velocities = motion.at(times)
    poses, moves = parts.kinematics.link_states(base, positions, twists, velocities)
    found: dict[str, Any] = {}
    if "contacts" in needed:
        found["contacts"] = parts.collisions.contacts(poses)
        found["contacts"].frame[:] += piece.start
    if "ground" in needed:
        found["ground"] = parts.ground.piece(poses, moves)
    has_mass = parts.masses.total > 0.0
    if not (has_mass and {"balance", "efforts"} & set(needed)):
        return found
    dynamics = inverse_dynamics(
        parts.kinematics,
        parts.masses,
        motion.dynamics(times, parts.thresholds.window),
    )
    if "efforts" in needed:
        found["efforts"] = dynamics.efforts
    if "balance" in needed:
        weight, floor = parts.masses.total * GRAVITY, parts.thresholds.floor_height
        speed = parts.masses.robot_velocity(poses, moves)
        found["center"] = dynamics.center_of_mass
        found["zmp"] = zero_moment_points(dynamics, weight, floor)
        found["is_still"] = _is_still(dynamics, speed, parts)
    return found


def _is_still(dynamics: Dynamics, velocity: np.ndarray, parts: Parts) -> np.ndarray:
    """Tell where the centre of mass is still.

    Args:
        dynamics: Of the motion.
        velocity: Of the centre of mass in [m/s], shape (n, 3).
        parts: The robot.
    """
    acceleration = dynamics.root_wrench[:, :3] / parts.masses.total
    acceleration[:, 2] -= GRAVITY
    is_slow = np.linalg.norm(velocity, axis=1) < parts.thresholds.still_speed
    most = parts.thresholds.still_acceleration
    return is_slow & (np.linalg.norm(acceleration, axis=1) < most)


def _joined_contacts(found: Sequence[Contacts]) -> Contacts:
    """Chain contacts of successive samples."""
    names = ("frame", "pair", "distance", "points_a", "points_b", "normal")
    return Contacts(
        *(np.concatenate([getattr(part, name) for part in found]) for name in names)
    )


def _refined(knots: np.ndarray, longest: float) -> np.ndarray:
    """Put times between samples that are far apart, at even distances."""
    gaps = np.diff(knots)
    parts = np.maximum(1.0, np.ceil(gaps / longest - 1e-9))
    if parts.sum() >= MAX_TIMES:
        raise MotionError(
            f"The motion lasts {knots[-1] - knots[0]:g} s and would be checked at "
            f"{parts.sum() + 1:.0f} times; {MAX_TIMES} are possible. Check a part of "
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
