"""What can be plotted of a robot: of joints, of its base, and of links."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from g1_description.collisions.convex_shapes import posed_links
from g1_description.collisions.self_collisions import SelfCollisions
from g1_description.motion.history_chunks import Stretch
from g1_description.motion.motion import Motion, sample
from g1_description.robot.assembly import root_in_base
from g1_description.robot.description import Description
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.rotation import axes_to_rpy, to_axes
from g1_description.robot.transform import compose

POSITION, VELOCITY, EFFORT, ERROR, BASE, SPEED, DISTANCE = KINDS = (
    "position",
    "velocity",
    "effort",
    "tracking error",
    "base",
    "speed of a link",
    "distance of links",
)

OF_JOINTS = {POSITION: "{}", VELOCITY: "{}/s", EFFORT: "N m", ERROR: "{}"}
"""Units of quantities of joints, with the joint's own, rad or m."""

OF_BASE = ("x", "y", "z", "roll", "pitch", "yaw", "speed")

FAR = 10.0
"""Distances are measured up to this one, in [m]."""


class Quantity(NamedTuple):
    """One thing that is plotted."""

    kind: str
    """One of ``KINDS``."""

    subjects: tuple[str, ...]
    """A joint, one of ``OF_BASE``, a link or two links."""

    @property
    def is_commanded(self) -> bool:
        """Whether there may be commanded values, too."""
        return self.kind in (POSITION, BASE) and self.subjects[0] != "speed"


class Quantities:
    """Computes quantities of one robot."""

    def __init__(
        self, description: Description, collisions: Callable[[], SelfCollisions]
    ) -> None:
        """Prepare the kinematics.

        Args:
            description: The robot.
            collisions: Prepares distances of links, when the first is wanted.
        """
        self._description, self._prepare = description, collisions
        self._collisions: SelfCollisions | None = None
        self._kinematics = Kinematics(description)
        self._links = tuple(link.name for link in posed_links(description))
        self._joints = {j.name: j for j in description.movable_joints}
        self._columns = {name: column for column, name in enumerate(self._joints)}

    def choices(self, kind: str) -> tuple[str, ...]:
        """List the subjects of a kind."""
        if kind in OF_JOINTS:
            return tuple(self._joints)
        return OF_BASE if kind == BASE else self._links

    def unit(self, quantity: Quantity) -> str:
        """Return the unit."""
        kind, (subject, *_) = quantity
        if kind in OF_JOINTS:
            slides = self._joints[subject].kind == "prismatic"
            unit = OF_JOINTS[kind].format("m" if slides else "rad")
            return "N" if slides and kind == EFFORT else unit
        if kind == SPEED or subject == "speed":
            return "m/s"
        return "rad" if subject in ("roll", "pitch", "yaw") else "m"

    def lines(
        self, quantity: Quantity, stretch: Stretch
    ) -> tuple[np.ndarray, np.ndarray]:
        """Compute a quantity at the times of a stretch.

        Returns:
            Measured, and commanded values, NaN where they are unknown, shape (n,).
        """
        kind, subjects = quantity
        unknown = np.full(len(stretch.stamps), np.nan)
        if kind in OF_JOINTS:
            return self._of_joint(kind, subjects[0], stretch, unknown)
        if kind == BASE:
            poses, twists = stretch.base_poses, stretch.base_twists
            if subjects[0] == "speed":
                if twists is None:
                    return unknown, unknown
                return np.linalg.norm(twists[:, :3], axis=1), unknown
            commanded = _coordinate(stretch.commanded_bases, subjects[0])
            measured = _coordinate(poses, subjects[0])
            return (
                unknown if measured is None else measured,
                unknown if commanded is None else commanded,
            )
        if kind == SPEED:
            return self._speed(subjects[0], stretch, unknown), unknown
        return self._distance(subjects, stretch, unknown), unknown

    def _of_joint(
        self, kind: str, joint: str, stretch: Stretch, unknown: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        arrays = {VELOCITY: stretch.velocities, EFFORT: stretch.efforts}
        array = arrays.get(kind, stretch.positions)
        measured, commanded = unknown, unknown
        if array is not None and joint in stretch.names:
            measured = array[:, stretch.names.index(joint)]
        if stretch.commanded is not None and joint in stretch.commanded_names:
            commanded = stretch.commanded[:, stretch.commanded_names.index(joint)]
        if kind == ERROR:
            return commanded - measured, unknown
        return measured, commanded if kind == POSITION else unknown

    def _link_poses(self, stretch: Stretch, bases: np.ndarray) -> np.ndarray:
        """Place all links, for bases of shape (n, 7); unknown joints are at zero."""
        known = [name for name in stretch.names if name in self._columns]
        positions = np.zeros((len(stretch.stamps), len(self._joints)))
        positions[:, [self._columns[name] for name in known]] = stretch.positions[
            :, [stretch.names.index(name) for name in known]
        ]
        roots = compose(bases, root_in_base(self._description))
        return self._kinematics.link_poses(roots, positions)

    def _speed(self, link: str, stretch: Stretch, unknown: np.ndarray) -> np.ndarray:
        """Differentiate the place of a link's origin in the map."""
        if stretch.base_poses is None or len(unknown) < 2:
            return unknown
        poses = self._link_poses(stretch, stretch.base_poses)
        places = poses[:, self._links.index(link), :3]
        return np.linalg.norm(
            np.gradient(places, 1e-9 * stretch.stamps, axis=0), axis=1
        )

    def _distance(
        self, links: tuple[str, ...], stretch: Stretch, unknown: np.ndarray
    ) -> np.ndarray:
        """Measure between the shapes of two links."""
        if self._collisions is None:
            self._collisions = self._prepare()
        pairs = [
            number
            for number, pair in enumerate(self._collisions.pairs)
            if set(pair) == set(links)
        ]
        still = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (len(unknown), 1))
        poses = self._link_poses(stretch, still)
        found = self._collisions.contacts(poses, FAR, pairs)
        distance = unknown.copy()
        distance[found.frame] = found.distance
        return distance


def _coordinate(poses: np.ndarray | None, name: str) -> np.ndarray | None:
    """Return a coordinate of poses of the base; angles do not jump."""
    if poses is None:
        return None
    number = OF_BASE.index(name)
    if number < 3:
        return poses[:, number]
    known = ~np.isnan(poses).any(axis=1)
    angle = np.full(len(poses), np.nan)
    angles = axes_to_rpy(to_axes(poses[known, 3:]))[:, number - 3]
    angle[known] = np.unwrap(angles)
    return angle


def motion_stretch(motion: Motion, most: int) -> Stretch:
    """Return a motion as it is played, at no more than some times."""
    times = motion.times[:: max(1, -(-len(motion.times) // most))]
    found = sample(motion, times)
    return Stretch(
        0,
        np.round(1e9 * times).astype(np.int64),
        motion.joint_names,
        (),
        found.positions,
        found.velocities,
        found.base_poses,
        found.base_twists,
    )
