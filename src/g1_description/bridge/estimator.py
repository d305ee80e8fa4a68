"""Joint states of several robots from one LinkStates message."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Optional, Tuple

import numpy as np

from g1_description.bounds import all_usable, usable_rows
from g1_description.robot.assembly import SCOPE, base_of, reference_links
from g1_description.robot.description import Description
from g1_description.robot.joint_angles import (
    MeasuredJoints,
    measure,
    measured_joints,
)
from g1_description.robot.state import RobotState
from g1_description.robot.transform import IDENTITY, compose

MAX_CACHED = 64
"""Largest number of sets of links, per robot, whose joints are cached. Links may come
and go with every message, and finding the joints of a humanoid takes milliseconds."""


class LinkProblems(NamedTuple):
    """Problems of the links of one robot; the same object until they change."""

    is_present: bool
    """Whether the message has any link of the robot."""

    missing: tuple[str, ...]
    """Links that are unknown, so that their joints are ignored."""

    invalid: tuple[str, ...]
    """Links with invalid poses or twists; they count as missing."""

    axis_residual: Mapping[str, float] = {}
    """Rotations off a joint's axis above ``MAX_RESIDUAL`` for ``LASTING``, in [rad], by
    joint name, the largest first."""

    @property
    def are_any(self) -> bool:
        """Whether anything is wrong."""
        return self[:3] != (True, (), ()) or bool(self.axis_residual)


MAX_RESIDUAL = 0.1
"""Largest rotation in [rad] off a joint's axis that is not reported. In Gazebo, joints
of a robot on the floor are 0.01 to 0.02 rad off their axes, and those of one that has
just fallen 0.056 rad. With the robot_description of another robot a bent joint is off
by about its angle."""

LASTING = 2.0
"""Simulated time in [s] after which such a rotation is reported. In Gazebo, joints of a
robot that falls after its start or a reset are up to 1.3 rad off for up to 0.5 s.
While time is paused, nothing is reported."""

_MAX_SINE = np.sin(0.5 * MAX_RESIDUAL) ** 2

MAX_AGE = 1.0
"""Oldest measurement in [s] that angles are unwrapped from."""

DEFAULT_INTERVAL = 0.001
"""Time between two messages in [s] while it is unknown."""

MAX_LATE = 20
"""Largest gap between two messages, in mean intervals, that a slow clock explains.
After a longer one the messages had stopped."""


_Structure = Tuple[MeasuredJoints, Optional[Tuple[int, np.ndarray]]]
"""Joints between links, and the base: its link's row and its pose in that, shape (7,).
"""


@dataclass(frozen=True)
class _Layout:
    """Places of a robot's links and joints in arrays of all robots."""

    joints: MeasuredJoints
    """Joints, which index the robot's own valid links."""

    links: tuple[str, ...]
    """Names of the valid links."""

    problems: LinkProblems
    first_link: int
    """Row of its first link among the valid links of all robots."""

    span: slice
    """Rows of its joints in arrays of all robots."""

    base: tuple[int, np.ndarray] | None
    """Row of the base's reference link among the valid links of all robots, and the
    base's pose in the frame of that link, shape (7,). None if it is unknown."""

    def base_of(
        self, poses: np.ndarray, twists: np.ndarray
    ) -> tuple[np.ndarray | None, np.ndarray | None]:
        """Compute pose and twist of the base from all links."""
        if self.base is None:
            return None, None
        row, T_link_base = self.base
        pose, twist = poses[row].copy(), twists[row].copy()
        if T_link_base is not IDENTITY:
            base = compose(pose, T_link_base)
            twist[:3] += np.cross(twist[3:], base[:3] - pose[:3])
            pose = base
        return pose, twist


class JointStateEstimator:
    """Measures the joints of several robots in consecutive messages.

    Robots are given by the scoped names of their models in the simulated world.
    """

    def __init__(self, robots: Mapping[str, Description]) -> None:
        self._robots = list(robots.items())
        keys = [
            (model, joint.name)
            for model, robot in self._robots
            for joint in robot.movable_joints
        ]
        self._number = {key: number for number, key in enumerate(keys)}
        self._structures: dict[tuple[int, tuple[str, ...]], _Structure] = {}
        self._names: Sequence[str] | None = None
        self._available: list[list[str]] = []
        """Links of each robot in the message."""
        self._rows: slice | np.ndarray = slice(0, 0)
        """Rows of the robots' links in the message, one robot after the other."""
        self._arranged_for: bytes | None = None
        self._layouts: list[_Layout] = []
        self.duplicates: tuple[str, ...] = ()
        """Scoped names of the robots' links that the last message had repeatedly."""
        self.problems: list[LinkProblems] = []
        """Problems of the links of each robot in the last message."""
        self.reset()

    def reset(self) -> None:
        """Forget the measurements that angles are unwrapped from."""
        self._last = np.full((3, len(self._number)), np.nan)
        """Position, velocity and time in [s] of each joint of all robots."""
        self._time = np.nan
        self._interval = 0.0
        self._off_since = np.full(len(self._number), np.inf)
        """Since when each joint of all robots has been off its axis, in [s]."""
        self._was_off = True  # so that earlier findings are cleared, too

    def update(
        self, names: Sequence[str], poses: np.ndarray, twists: np.ndarray, stamp: int
    ) -> list[RobotState]:
        """Measure the joints in one message.

        Args:
            names: Scoped names of the links. They are compared by identity with those
                of the previous message. The first of equal names is used.
            poses: Poses in the world, shape (n, 7). A link with a quaternion that is
                not of unit length within 1e-3, or with an implausible number, counts
                as missing.
            twists: Twists along the world's axes, shape (n, 6).
            stamp: Time of the message in [ns].

        Returns:
            The state of each robot, without joints and base where the message has no
            link of it. The names of the joints are the same object until the links
            change.
        """
        if names is not self._names:
            self._find_links(names)
            self._names, self._arranged_for = names, None
        poses, twists = poses[self._rows].copy(), twists[self._rows]
        lengths = np.sqrt(np.einsum("ij,ij->i", poses[:, 3:], poses[:, 3:]))
        valid = None
        if not all_usable(lengths, poses, twists):
            valid = usable_rows(lengths, poses, twists)
            poses, twists, lengths = poses[valid], twists[valid], lengths[valid]
        poses[:, 3:] /= lengths[:, np.newaxis]
        key = b"" if valid is None else valid.tobytes()
        if key != self._arranged_for:
            self._arrange(valid)
            self._arranged_for = key
        time, previous = 1e-9 * stamp, None
        if self._joints.any_needs_unwrapping:
            previous = self._previous(time)
        position, velocity, residual = measure(poses, twists, self._joints, previous)
        if previous is not None:
            self._last[:, self._which] = (
                position,
                velocity,
                np.full_like(position, time),
            )
        self._find_rotated_joints(residual, time)
        return [
            RobotState(
                stamp,
                layout.joints.names,
                position[layout.span],
                velocity[layout.span],
                *layout.base_of(poses, twists),
            )
            for layout in self._layouts
        ]

    def _find_rotated_joints(self, residual: np.ndarray, time: float) -> None:
        """Find the joints of each robot that stay rotated off their axes."""
        is_off = len(residual) > 0 and not residual.max() <= _MAX_SINE
        if not is_off and not self._was_off:
            return
        since = np.minimum(self._off_since[self._which], time)
        since[residual <= _MAX_SINE] = np.inf
        self._off_since.fill(np.inf)
        self._off_since[self._which], self._was_off = since, is_off
        angles = 2.0 * np.arcsin(np.sqrt(np.clip(residual, 0.0, 1.0)))
        angles[time - since < LASTING] = 0.0
        for number, layout in enumerate(self._layouts):
            pairs = zip(layout.joints.names, angles[layout.span].tolist())
            found = {name: angle for name, angle in pairs if angle > MAX_RESIDUAL}
            if found or self.problems[number].axis_residual:
                found = dict(sorted(found.items(), key=lambda item: -item[1]))
                self.problems[number] = layout.problems._replace(axis_residual=found)

    def _find_links(self, names: Sequence[str]) -> None:
        """Find the robots' links among the scoped names of a message."""
        index: dict[str, int] = {}
        for row, name in enumerate(names):
            index.setdefault(name, row)
        self._available = [
            [link for link in robot.link_names if f"{model}{SCOPE}{link}" in index]
            for model, robot in self._robots
        ]
        scoped = [
            f"{model}{SCOPE}{link}"
            for (model, _), links in zip(self._robots, self._available)
            for link in links
        ]
        rows = np.array([index[name] for name in scoped], dtype=int)
        first = int(rows[0]) if len(rows) else 0
        block = slice(first, first + len(rows))  # numpy takes it faster than an array
        is_block = np.array_equal(rows, np.arange(block.start, block.stop))
        self._rows = block if is_block else rows
        counts = Counter(names) if len(index) < len(names) else {}
        self.duplicates = tuple(name for name in scoped if counts.get(name, 1) > 1)

    def _structure(self, robot: Description, links: tuple[str, ...]) -> _Structure:
        """Find a robot's joints, and its base as index and pose; both are cached."""
        key = (id(robot), links)
        if key not in self._structures:
            if len(self._structures) >= MAX_CACHED * len(self._robots):
                self._structures.clear()
            base = None
            root, _ = base_of(robot)
            if root in (references := reference_links(robot, links)):
                link, T_link_root = references[root]
                base = (links.index(link), T_link_root)
            self._structures[key] = (measured_joints(robot, links), base)
        return self._structures[key]

    def _arrange(self, valid: np.ndarray | None) -> None:
        """Lay out the links with usable numbers, and the joints between them.

        Args:
            valid: True for each link found whose numbers are usable, shape (n_found,);
                None if all are.
        """
        layouts: list[_Layout] = []
        row = first_link = first_joint = 0
        for (_, robot), available in zip(self._robots, self._available):
            end = row + len(available)
            mask = [True] * len(available) if valid is None else valid[row:end].tolist()
            row = end
            links = tuple(link for link, good in zip(available, mask) if good)
            invalid = tuple(link for link, good in zip(available, mask) if not good)
            joints, base = self._structure(robot, links)
            span = slice(first_joint, first_joint + len(joints.names))
            base = base and (first_link + base[0], base[1])
            problems = LinkProblems(bool(available), joints.missing, invalid)
            layouts.append(_Layout(joints, links, problems, first_link, span, base))
            first_link += len(links)
            first_joint = span.stop
        self.problems = [
            last
            if (new.links, new.problems) == (before.links, before.problems)
            else new.problems
            for new, before, last in zip(layouts, self._layouts, self.problems)
        ] or [layout.problems for layout in layouts]
        self._layouts = layouts
        self._joints = MeasuredJoints.joined(
            [layout.joints for layout in layouts],
            [layout.first_link for layout in layouts],
        )
        self._which = np.array(
            [
                self._number[model, name]
                for (model, _), layout in zip(self._robots, layouts)
                for name in layout.joints.names
            ],
            dtype=int,
        )
        absent = {
            model
            for (model, _), new in zip(self._robots, layouts)
            if not new.problems.is_present
        }
        if absent:  # a later model of the same name is another robot
            gone = [n for (model, _), n in self._number.items() if model in absent]
            self._last[0, gone] = np.nan

    def _previous(self, time: float) -> np.ndarray:
        """Return the previous measurement of the joints in the message.

        If the clock is slower than the messages, several have the same time and the
        next one is late. The mean interval is then the better estimate.

        Returns:
            Position, velocity and estimated time since then in [s], shape
            (3, n_joints); NaN stands for no measurement.
        """
        seen = self._last[2]
        with np.errstate(invalid="ignore"):
            self._last[0, time - seen > MAX_AGE] = np.nan
        dt = time - seen
        since, self._time = time - self._time, time
        if since > MAX_LATE * self._interval:
            self._interval = self._interval or since
        elif not np.isnan(since):
            self._interval += 0.05 * (since - self._interval)
            dt[seen == time - since] = self._interval or DEFAULT_INTERVAL
        return np.stack([*self._last[:2], dt])[:, self._which]
