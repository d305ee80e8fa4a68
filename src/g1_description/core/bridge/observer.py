"""What one message of link states tells of some robots, all in one pass."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from g1_description.core.robot.assembly import SCOPE, base_of
from g1_description.core.robot.description import Description
from g1_description.core.robot.rigid import reference_links
from g1_description.core.transform import IDENTITY, compose
from g1_description.core.usable import all_usable, usable_rows

from .joints import MeasuredJoints, measured_joints
from .measurement import Measured, Previous, measure

OFF_AXIS = 0.05
"""A rotation left over off a joint's axis that is worth telling, in [rad].

Gazebo's engine lets the joints of a robot that lies on the floor come 0.01 to 0.02
rad off their axes; a robot_description of another robot is off by far more."""

FORGOTTEN = 1.0
"""Turns do not go on from a position that is older than this, in [s]."""

_LARGEST = np.sin(0.5 * OFF_AXIS) ** 2
_KEPT = 64
"""Sets of links at hand, for each robot at most, whose joints are kept."""

_USUAL = 0.001
"""Time between two messages while it is not known, in [s]."""

_LONG = 20
"""A gap of more than this many messages is a gap; a shorter one may be the clock's."""


@dataclass(frozen=True)
class Share:
    """What one robot has of the links of a message."""

    joints: MeasuredJoints
    """Its joints; they index the robot's own links at hand."""

    links: slice
    """Its links among those of all robots."""

    span: slice
    """Its joints among those of all robots."""

    base: tuple[int, np.ndarray] | None
    """The link at hand that its root, or what floats in the world, is seen through,
    among those of all robots, and the pose of that in the link's frame, shape (7,).
    None if it is not known."""

    broken: tuple[str, ...]
    """Its links whose numbers cannot be used, which count as missing."""

    @property
    def is_there(self) -> bool:
        """Whether the message has any link of the robot."""
        return self.links.stop > self.links.start or bool(self.broken)


@dataclass(frozen=True)
class Sight:
    """What one message tells: arrays over the joints of all robots."""

    shares: Sequence[Share]
    """In the order of the robots; the same object while nothing comes or goes."""

    poses: np.ndarray
    """Poses of the links at hand in the world, shape (n_links, 7)."""

    measured: Measured

    def base_pose(self, share: Share) -> np.ndarray | None:
        """Find a robot's root link in the world, shape (7,); None if not known."""
        if share.base is None:
            return None
        row, T_link_root = share.base
        pose = self.poses[row]
        return pose if T_link_root is IDENTITY else compose(pose, T_link_root)

    @property
    def off_axis(self) -> bool:
        """Whether rotation is left over off any joint's axis."""
        residual = self.measured.axis_residual
        return len(residual) > 0 and not residual.max() <= _LARGEST

    def off_axis_joints(self, share: Share) -> dict[str, float]:
        """List a robot's joints that do not keep to their axes.

        Returns:
            The rotation left over in [rad] by joint name, the largest first.
        """
        residual = np.clip(self.measured.axis_residual[share.span], 0.0, 1.0)
        left_over = 2.0 * np.arcsin(np.sqrt(residual))
        found = {
            name: float(angle)
            for name, angle in zip(share.joints.names, left_over)
            if angle > OFF_AXIS
        }
        return dict(sorted(found.items(), key=lambda item: -item[1]))


class Observer:
    """Robots by the names of their models, and what was seen of them last."""

    def __init__(self, robots: Mapping[str, Description]) -> None:
        """Begin without having seen them.

        Args:
            robots: The robots as their files tell them, by the names that their
                models have in the simulated world. A model inside another has the
                other's name, ``::`` and its own.
        """
        self._robots = list(robots.items())
        joints = [len(robot.movable_joints) for _, robot in self._robots]
        self._first = np.concatenate([[0], np.cumsum(joints)])
        self._number = {
            (robot, joint.name): row
            for robot, (_, description) in enumerate(self._robots)
            for row, joint in enumerate(
                description.movable_joints, int(self._first[robot])
            )
        }
        self._kept: dict = {}
        self._names: Sequence[str] | None = None
        self._arranged_for: bytes | None = None
        self.twice: tuple[str, ...] = ()
        """Names of the robots' links that the last message had more than once."""
        self.reset()

    def reset(self) -> None:
        """Forget the last positions, which joints go on from."""
        self._position, self._velocity, self._seen = np.full(
            (3, int(self._first[-1])), np.nan
        )
        self._time = np.nan
        self._interval = 0.0

    def see(
        self, names: Sequence[str], poses: np.ndarray, twists: np.ndarray, time: float
    ) -> Sight:
        """Take in one message.

        Args:
            names: Scoped names of the links. The same object as last time costs
                nothing. Of equal names the first counts.
            poses: Poses in the world, shape (n, 7). A quaternion that is not of unit
                length within 1e-3, and a number that no robot can have, makes
                its link count as missing.
            twists: Twists along the world's axes, shape (n, 6).
            time: When it was so, in [s].

        Returns:
            What it tells of the robots.
        """
        if names is not self._names:
            self._find(names)
        poses, twists = poses[self._rows].copy(), twists[self._rows]
        lengths = np.sqrt(np.einsum("ij,ij->i", poses[:, 3:], poses[:, 3:]))
        usable = (
            None
            if all_usable(lengths, poses, twists)
            else usable_rows(lengths, poses, twists)
        )
        key = b"" if usable is None else usable.tobytes()
        if key != self._arranged_for:
            self._arrange(usable)
            self._arranged_for = key
        if usable is not None:
            poses, twists, lengths = poses[usable], twists[usable], lengths[usable]
        poses[:, 3:] /= lengths[:, np.newaxis]
        measured = self._measure(poses, twists, time)
        return Sight(self._shares, poses, measured)

    def _measure(self, poses: np.ndarray, twists: np.ndarray, time: float) -> Measured:
        """Measure the joints, going on from the last positions where need be."""
        if not self._joints.any_needs_unwrapping:
            return measure(poses, twists, self._joints)
        which = self._which
        with np.errstate(invalid="ignore"):  # NaN stands for what was never seen
            self._position[time - self._seen > FORGOTTEN] = np.nan
            previous = Previous(
                self._position[which],
                self._velocity[which],
                self._passed(time)[which],
            )
            measured = measure(poses, twists, self._joints, previous)
        self._position[which], self._velocity[which] = measured[:2]
        self._seen[which] = time
        return measured

    def _passed(self, time: float) -> np.ndarray:
        """Estimate how long ago each joint was seen, in [s], shape (n_joints,).

        Where the clock is slower than the messages several have the same time, and
        the next is late: the mean between two messages is nearer to what has passed.
        """
        passed = time - self._seen
        since = time - self._time
        self._time = time
        if np.isnan(since):
            return passed
        if since > _LONG * self._interval:
            self._interval = self._interval or since
            return passed
        self._interval += 0.05 * (since - self._interval)
        passed[self._seen == time - since] = self._interval or _USUAL
        return passed

    def _find(self, names: Sequence[str]) -> None:
        """Find the robots' links among the names of a message."""
        self._names = names
        index: dict[str, int] = {}
        for row, name in enumerate(names):
            index.setdefault(name, row)
        self._present = [
            [link for link in robot.link_names if f"{model}{SCOPE}{link}" in index]
            for model, robot in self._robots
        ]
        scoped = [
            f"{model}{SCOPE}{link}"
            for (model, _), links in zip(self._robots, self._present)
            for link in links
        ]
        rows = np.array([index[name] for name in scoped], dtype=int)
        first = int(rows[0]) if len(rows) else 0
        block = slice(first, first + len(rows))
        is_block = np.array_equal(rows, np.arange(block.start, block.stop))
        # One robot's links stand together: a slice is taken faster than rows are.
        self._rows: slice | np.ndarray = block if is_block else rows
        self._n_links = len(rows)
        self._arranged_for = None
        twice = len(index) < len(names)
        counts = Counter(names) if twice else {}
        self.twice = tuple(name for name in scoped if counts.get(name, 1) > 1)

    def _arrange(self, usable: np.ndarray | None) -> None:
        """Find what can be measured from the usable ones of the links at hand."""
        if usable is None:
            usable = np.ones(self._n_links, dtype=bool)
        shares = []
        row = first_link = first_joint = 0
        for (_, robot), present in zip(self._robots, self._present):
            good = usable[row : row + len(present)]
            row += len(present)
            links = tuple(link for link, is_good in zip(present, good) if is_good)
            broken = tuple(link for link, is_good in zip(present, good) if not is_good)
            joints, base = self._structure(robot, links)
            shares.append(
                Share(
                    joints,
                    slice(first_link, first_link + len(links)),
                    slice(first_joint, first_joint + len(joints.names)),
                    base and (first_link + base[0], base[1]),
                    broken,
                )
            )
            first_link += len(links)
            first_joint += len(joints.names)
        self._shares = shares
        for first, last, share in zip(self._first, self._first[1:], shares):
            if not share.is_there:  # it is another one that comes under its name
                self._position[first:last] = np.nan
        self._joints = MeasuredJoints.joined(
            [share.joints for share in shares], [share.links.start for share in shares]
        )
        self._which = np.array(
            [
                self._number[robot, name]
                for robot, share in enumerate(shares)
                for name in share.joints.names
            ],
            dtype=int,
        )

    def _structure(
        self, robot: Description, links: tuple[str, ...]
    ) -> tuple[MeasuredJoints, tuple[int, np.ndarray] | None]:
        """Give a robot's joints and base for the links at hand, made only once."""
        key = (id(robot), links)
        if key not in self._kept:
            if len(self._kept) >= _KEPT * len(self._robots):
                self._kept.clear()
            base = None
            root, _ = base_of(robot)
            if root in (seen := reference_links(robot, links)):
                link, T_link_root = seen[root]
                base = (links.index(link), T_link_root)
            self._kept[key] = (measured_joints(robot, links), base)
        return self._kept[key]
