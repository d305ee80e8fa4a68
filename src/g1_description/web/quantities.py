"""Quantities to plot: of a robot's joints, of its base, and of its links."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from g1_description.collisions.convex_shapes import posed_links
from g1_description.collisions.self_collisions import SelfCollisions
from g1_description.errors import InvalidValueError
from g1_description.motion.files.conventions import of_robot
from g1_description.motion.history_chunks import Stretch
from g1_description.motion.motion import Motion, sample
from g1_description.robot.assembly import root_in_base
from g1_description.robot.description import Description
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.rotation import axes_to_rpy, to_axes
from g1_description.robot.transform import IDENTITY, compose

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

STRIDE = 50_000_000
"""Least time between measured distances, in [ns]: each takes 0.2 ms."""

CHUNK = 4000
"""States whose links are placed at once."""


def label_of(name: str) -> str:
    """Remove the usual suffix of a joint's name."""
    return name[: -len("_joint")] if name.endswith("_joint") else name


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

    def __init__(self, description: Description) -> None:
        """Prepare the kinematics."""
        self._description = description
        self._collisions: SelfCollisions | None = None
        self._kinematics = Kinematics(description)
        self._links = tuple(link.name for link in posed_links(description))
        self._joints = {j.name: j for j in description.movable_joints}

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

        Raises:
            InvalidValueError: If two links have no distance.
        """
        kind, subjects = quantity
        unknown = np.full(len(stretch.stamps), np.nan)
        if kind in OF_JOINTS:
            return self._of_joint(kind, subjects[0], stretch, unknown)
        if kind == SPEED:
            return self._speed(subjects[0], stretch, unknown), unknown
        if kind == DISTANCE:
            return self._distance(subjects, stretch, unknown), unknown
        if subjects[0] == "speed":
            return _speed(stretch, stretch.base_poses, unknown), unknown
        measured, commanded = (
            unknown if poses is None else _coordinate(poses, subjects[0])
            for poses in (stretch.base_poses, stretch.commanded_bases)
        )
        return measured, commanded

    def _of_joint(
        self, kind: str, joint: str, stretch: Stretch, unknown: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        array = stretch.efforts if kind == EFFORT else stretch.positions
        measured, commanded = unknown, unknown
        if array is not None and joint in stretch.names:
            measured = array[:, stretch.names.index(joint)]
            if kind == VELOCITY:
                measured = _slope(stretch, measured)
        if stretch.commanded is not None and joint in stretch.commanded_names:
            commanded = stretch.commanded[:, stretch.commanded_names.index(joint)]
        if kind == ERROR:
            return commanded - measured, unknown
        return measured, commanded if kind == POSITION else unknown

    def _link_poses(self, stretch: Stretch, bases: np.ndarray) -> np.ndarray:
        """Place all links, for bases of shape (n, 7); unknown joints are at zero."""
        positions = of_robot(stretch.names, stretch.positions, self._description)
        roots = compose(bases, root_in_base(self._description))
        return self._kinematics.link_poses(roots, positions)

    def _speed(self, link: str, stretch: Stretch, unknown: np.ndarray) -> np.ndarray:
        """Differentiate the place of a link's origin in the map."""
        if stretch.base_poses is None:
            return unknown
        row, places = self._links.index(link), np.empty((len(unknown), 3))
        for first in range(0, len(unknown), CHUNK):
            part = slice(first, first + CHUNK)
            poses = self._link_poses(stretch.rows(part), stretch.base_poses[part])
            places[part] = poses[:, row, :3]
        return _speed(stretch, places, unknown)

    def _distance(
        self, links: tuple[str, ...], stretch: Stretch, unknown: np.ndarray
    ) -> np.ndarray:
        """Measure between the shapes of two links."""
        if self._collisions is None:
            self._collisions = SelfCollisions(self._description, ())
        pairs = [
            number
            for number, pair in enumerate(self._collisions.pairs)
            if set(pair) == set(links)
        ]
        if not pairs:
            raise InvalidValueError(
                f"There is no distance of {links[0]} and {links[1]}: they are one "
                "rigid body, or one of them has no shape."
            )
        strides = (stretch.stamps - stretch.stamps[0]) // STRIDE
        kept = np.unique(strides, return_index=True)[1]
        some = stretch.rows(kept)
        still = np.tile(IDENTITY, (len(kept), 1))
        found = self._collisions.contacts(self._link_poses(some, still), FAR, pairs)
        distance = unknown.copy()
        distance[kept[found.sample]] = found.distance
        is_known = ~np.isnan(distance)
        if is_known.any():
            rows = np.arange(len(distance))
            known = rows[is_known]
            distance = np.interp(rows, known, distance[known])
        return distance


def _slope(stretch: Stretch, values: np.ndarray) -> np.ndarray:
    """Differentiate values at the times of a stretch, shape (n, ...), by time."""
    if len(values) < 2:
        return np.full(values.shape, np.nan)
    return np.gradient(values, 1e-9 * (stretch.stamps - stretch.stamps[0]), axis=0)


def _speed(
    stretch: Stretch, places: np.ndarray | None, unknown: np.ndarray
) -> np.ndarray:
    """Differentiate places, shape (n, 3 or more), by time."""
    if places is None:
        return unknown
    return np.linalg.norm(_slope(stretch, places[:, :3]), axis=1)


def _coordinate(poses: np.ndarray, name: str) -> np.ndarray:
    """Return a coordinate of poses of the base; angles do not jump."""
    number = OF_BASE.index(name)
    if number < 3:
        return poses[:, number]
    known = ~np.isnan(poses).any(axis=1)
    angle = np.full(len(poses), np.nan)
    angles = axes_to_rpy(to_axes(poses[known, 3:]))[:, number - 3]
    angle[known] = np.unwrap(angles)
    return angle


def motion_stretch(motion: Motion) -> Stretch:
    """Return a motion as it is played, at the times of its samples."""
    found = sample(motion, motion.times)
    return Stretch(
        0,
        np.round(1e9 * motion.times).astype(np.int64),
        motion.joint_names,
        (),
        found.positions,
        base_poses=found.base_poses,
    )
