"""Measurements of a motion at the times of the checks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, Callable, TypeVar, Union

import numpy as np

from g1_description.checks.ground_contacts import Ground
from g1_description.checks.ground_samples import GroundSamples
from g1_description.checks.support import (
    Balance,
)
from g1_description.checks.surroundings import Surroundings
from g1_description.checks.thresholds import Thresholds
from g1_description.collisions.contacts import Contacts
from g1_description.collisions.obstacles import Obstacles
from g1_description.collisions.outlines import edges_of, outlines_of, with_soles
from g1_description.collisions.self_collisions import SelfCollisions
from g1_description.errors import MotionError
from g1_description.motion.motion import Motion, Sample, sample
from g1_description.robot.assembly import WORLD, base_of, root_in_base
from g1_description.robot.description import Description, Joint
from g1_description.robot.dynamics import (
    Masses,
    RobotMotion,
)
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.rotation import cross, rotate, shorter_turn
from g1_description.robot.transform import IDENTITY, compose
from g1_description.sim.rollout import Rollout

MAX_TIMES = 200_000
"""Largest number of times of a motion: 55 minutes at 60 Hz."""

SLOW = 1.0
"""Mean interval between samples that may be in ms instead, in [s]."""

CHUNK = 512
"""Samples per chunk, with about 20 MB of intermediate results."""

NO_BASE = "the motion has no base"
"""Reason for which checks of the floor are skipped."""

NO_PLACE = "without a base, the place of the robot among the objects is not known"
"""Reason for which checks among objects are skipped."""

Value = TypeVar("Value")


class CheckedRobot:
    """A robot, with everything that does not depend on a motion."""

    def __init__(
        self,
        description: Description,
        thresholds: Thresholds,
        collisions: SelfCollisions,
        fixed_base: bool,
        obstacles: Obstacles | None = None,
    ) -> None:
        self.description, self.thresholds = description, thresholds
        self.collisions, self.obstacles = collisions, obstacles
        self.joints = description.movable_joints
        self.kinematics, self.masses = Kinematics(description), Masses(description)
        self.is_fixed = fixed_base or base_of(description)[0] == WORLD
        """Whether the base is fixed."""
        self.T_base_root = root_in_base(description)
        """The root link in the base link, shape (7,); they differ if the root is the
        world."""
        shapes = collisions.shapes
        self.ground = Ground(
            outlines_of(shapes),
            self.kinematics.end_links(),
            thresholds,
            edges_of(with_soles(shapes)) if obstacles else (),
        )
        self.links = tuple(name for name in description.link_names if name != WORLD)
        """Links in the order of their poses."""

    def lacks(self, need: str, motion: Motion) -> str:
        """Return why a need of a rule is not met by a motion; empty if it is.

        Args:
            need: One of ``Rule.needs``.
            motion: The motion.
        """
        on_floor = need in ("base", "ground", "balance", "forces")
        on_floor |= need == "efforts" and not self.is_fixed
        is_moving = need == "neighbours"
        if need == "velocities":
            is_moving = motion.velocities is None
        reasons = {
            "no scene is given": need == "objects" and self.obstacles is None,
            "the base is fixed": self.is_fixed and (on_floor or need == "free base"),
            NO_BASE: on_floor and motion.base_poses is None,
            NO_PLACE: need == "objects"
            and not self.is_fixed
            and motion.base_poses is None,
            "the robot has no shapes": on_floor
            and need != "base"
            and not len(self.ground.rows),
            "the robot has no mass": need in ("balance", "forces", "efforts")
            and not self.masses.total > 0.0,
            "no pair of links needs checking": need == "pairs"
            and not self.collisions.pairs,
            "there is only one configuration": is_moving and len(motion.times) == 1,
        }
        return next((why for why, holds in reasons.items() if holds), "")


Measure = Callable[[CheckedRobot, np.ndarray], Union[np.ndarray, Contacts]]
"""Computes contacts or an array of shape (n, ...) from poses of all links, in the order
of ``CheckedRobot.links``, shape (n, n_links, 7)."""


class Measured:
    """A motion, with arrays over the times of the checks.

    Arrays that no check needs are None.
    """

    def __init__(self, robot: CheckedRobot, motion: Motion) -> None:
        """Sample the motion's joints at all times, in chunks to save memory.

        Raises:
            MotionError: If the motion is too long.
        """
        self.robot, self.motion = robot, motion
        self.times = _refined(motion.times, robot.thresholds.longest_interval)
        """In [s], increasing, shape (n,): the times of the samples, and more between
        samples that are far apart."""
        names = [joint.name for joint in robot.joints]
        columns = [names.index(name) for name in motion.joint_names]
        self.joints: list[Joint] = [robot.joints[column] for column in columns]
        """The joints of the motion."""
        self._columns = np.array(columns, dtype=int)
        shape = (len(self.times), len(columns))
        self.positions, self.velocities = np.empty(shape), np.empty(shape)
        """Values of its joints in [rad] or [m], and per second, shape (n, k)."""
        for piece in self.chunks():
            found = sample(motion, self.times[piece])
            self.positions[piece] = found.positions
            self.velocities[piece] = found.velocities
        self.own: dict[str, Any] = {}
        """Results of the rules' own measurements, by name of the rule."""
        self.ground: GroundSamples | None = None
        """Heights, contacts and support."""
        self.surroundings: Surroundings | None = None
        """The objects of the scene."""
        self.near_objects: Contacts | None = None
        """What is near objects, but for supports; ``sample`` is the row of the time."""
        self.balance: Balance | None = None
        """None if the motion has no base or the robot no mass."""
        self.efforts: np.ndarray | None = None
        """Efforts of all joints without contacts, as of a fixed base, in [N m] or [N],
        shape (n, n_joints)."""
        self.wrench: np.ndarray | None = None
        """What the motion needs at the root: force, and moment about the map's origin,
        in [N] and [N m], shape (n, 6)."""
        self.weight: np.ndarray | None = None
        """Weight of the robot and of what it carries, in [N], shape (n,)."""
        self.power: np.ndarray | None = None
        """Change of the robot's kinetic and potential energy in [W], shape (n,); with a
        fixed base, the power of all joints."""
        self.played: Rollout | None = None
        """The simulated motion."""
        self.unlimited: Rollout | None = None
        """The motion simulated without limits of motors, if they were saturated."""
        self._once: dict[Callable[[Measured], Any], Any] = {}

    def once(self, function: Callable[[Measured], Value]) -> Value:
        """Call a function with this motion once, and return its cached result."""
        if function not in self._once:
            self._once[function] = function(self)
        found: Value = self._once[function]
        return found

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Joints of the motion."""
        return self.motion.joint_names

    @property
    def contacts(self) -> Contacts | None:
        """Self-collisions; ``sample`` is the row of the time."""
        return self.own.get("self_collision")

    @property
    def ground_links(self) -> tuple[str, ...]:
        """Links that are near the floor, or the lowest ones, at any time.

        They are the columns of ``heights`` and ``in_contact``.
        """
        if self.ground is None:
            return ()
        rows = self.robot.ground.rows[self.ground.columns]
        return tuple(self.robot.links[row] for row in rows)

    @property
    def heights(self) -> np.ndarray | None:
        """Heights of links' lowest points in [m], shape (n, n_ground_links).

        Infinite for a link that is neither the lowest one nor near the floor.
        """
        return None if self.ground is None else self.ground.heights

    @property
    def in_contact(self) -> np.ndarray | None:
        """Which links are in contact with the floor, shape (n, n_ground_links)."""
        return None if self.ground is None else self.ground.in_contact

    @property
    def support(self) -> Sequence[np.ndarray]:
        """Points of contact along the map's x and y, in [m], shape (k, 2) per time."""
        return () if self.ground is None else self.ground.support

    @property
    def floor(self) -> float | np.ndarray:
        """Mean height of what the robot stands on, in [m], shape (n,) with objects."""
        height = self.robot.thresholds.floor_height
        level = None if self.ground is None else self.ground.level
        return height if level is None else height + level

    @cached_property
    def depth(self) -> np.ndarray:
        """Depth of the deepest self-collision in [m], zero without one, shape (n,).

        NaN if collisions were not checked.
        """
        if self.contacts is None:
            return np.full(len(self.times), np.nan)
        depth = np.zeros(len(self.times))
        np.maximum.at(depth, self.contacts.sample, -self.contacts.distance)
        return depth

    def spread(self, values: np.ndarray, fill: float) -> np.ndarray:
        """Expand values at the motion's samples to all times.

        Args:
            values: Shape (n_samples, ...).
            fill: The value at other times.

        Returns:
            Shape (n, ...).
        """
        found = np.full((len(self.times), *values.shape[1:]), fill)
        found[np.searchsorted(self.times, self.motion.times)] = values
        return found

    def chunks(self) -> Iterator[slice]:
        """Split the times into chunks that fit into memory."""
        for first in range(0, len(self.times), CHUNK):
            yield slice(first, min(first + CHUNK, len(self.times)))

    def at(
        self, times: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Sample the whole robot.

        Args:
            times: In [s], shape (m,).

        Returns:
            Root poses, shape (m, 7), all joints' positions, shape (m, n_joints), root
            twists, shape (m, 6), and all joints' velocities, shape (m, n_joints), both
            means to the next sample. Joints missing from the motion are at zero, a
            missing base is at the map's origin.
        """
        found = sample(self.motion, times)
        means = found.velocities
        if self.motion.velocities is not None:
            means = sample(replace(self.motion, velocities=None), times).velocities
        positions = np.zeros((2, len(times), len(self.robot.joints)))
        positions[0][:, self._columns] = found.positions
        positions[1][:, self._columns] = means
        poses, twists = _base_of(found, len(times))
        if self.robot.T_base_root is not IDENTITY:
            roots = compose(poses, self.robot.T_base_root)
            lever = roots[:, :3] - poses[:, :3]
            twists = twists.copy()
            twists[:, :3] += cross(twists[:, 3:], lever)
            poses = roots
        return poses, positions[0], twists, positions[1]

    def link_poses(self, link: str, times: np.ndarray) -> np.ndarray:
        """Find the poses of a link at times in [s], in the map, shape (m, 7)."""
        within = np.clip(times, self.times[0], self.times[-1])
        base, positions = self.at(within)[:2]
        row = self.robot.links.index(link)
        return np.asarray(self.robot.kinematics.link_poses(base, positions)[:, row])

    def base_poses(self) -> np.ndarray:
        """Find the poses of the base at all times, shape (n, 7)."""
        return _base_of(sample(self.motion, self.times), len(self.times))[0]

    def dynamics(self, times: np.ndarray) -> RobotMotion:
        """Find the robot's motion at times in [s], shape (m,), by differences.

        Velocities are means over the window of the thresholds on both sides,
        accelerations are differences between those of both sides.
        """
        window = self.robot.thresholds.window
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


def _refined(knots: np.ndarray, longest: float) -> np.ndarray:
    """Insert evenly spaced times between samples that are far apart."""
    gaps = np.diff(knots)
    parts = np.maximum(1.0, np.ceil(gaps / longest - 1e-9))
    if parts.sum() >= MAX_TIMES:
        hint = " Are its times in ms?" if gaps.mean() >= SLOW else ""
        raise MotionError(
            f"The motion lasts {knots[-1] - knots[0]:g} s and would be checked at "
            f"{parts.sum() + 1:.0f} times; {MAX_TIMES} is the limit. Check a part of "
            f"it, or increase longest_interval.{hint}"
        )
    if (parts == 1).all():
        return np.asarray(knots, dtype=float)
    parts = parts.astype(int)
    starts = np.repeat(knots[:-1], parts)
    number = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    between = starts + number * np.repeat(gaps / parts, parts)
    return np.append(between, knots[-1])


def _base_of(found: Sample, n_times: int) -> tuple[np.ndarray, np.ndarray]:
    """Return poses and twists of the base; a missing one is at rest at the origin."""
    if found.base_poses is None or found.base_twists is None:
        return np.tile(IDENTITY, (n_times, 1)), np.zeros((n_times, 6))
    return found.base_poses, found.base_twists


def rotation_vectors(begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Find the shorter turns from rotations to others.

    Args:
        begin: Unit quaternions (x, y, z, w) in the map, shape (m, 4).
        end: Unit quaternions, shape (m, 4).

    Returns:
        Axis times angle in the map, in [rad], shape (m, 3).
    """
    axis, half = shorter_turn(begin, end)
    return rotate(begin, 2.0 * half * axis)


def _step(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Return translations and rotation vectors between poses, shape (m, 6)."""
    turns = rotation_vectors(before[:, 3:], after[:, 3:])
    return np.concatenate([after[:, :3] - before[:, :3], turns], axis=1)
