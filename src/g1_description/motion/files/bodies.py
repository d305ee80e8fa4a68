"""Bodies in a file, by which the base and the order of quaternions are found.

A format says which body is the base, and how quaternions are written; not all files
follow it. The places of the other bodies follow from the base and the joints, so they
say how a file has to be read, also where the robot lies.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from g1_description.motion.files.arrays import Arrays
from g1_description.motion.files.conventions import (
    OTHER_ORDER,
    base_of,
    of_robot,
)
from g1_description.motion.files.source import MotionSource
from g1_description.robot.description import Description
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.load import read_description
from g1_description.robot.profile import package_profiles
from g1_description.robot.transform import IDENTITY, compose

BODY_MISMATCH = 0.002
"""Larger distances of bodies from the robot's are reported, in [m]."""

CLEARLY = 4.0
"""How many times as far off bodies are if a file is not read as another robot's is:
in the wrong order of quaternions they are off by lengths of limbs."""

N_COMPARED = 5
"""Samples whose bodies are compared with the robot's."""

MAX_OTHERS = 20
"""Most bodies without names beside the robot's."""

KEYS = ("body_pos_w", "body_positions", "rigid_body_pos", "body_pos", "xpos")
"""Arrays of places of bodies."""

ORDER_FITS = "Base quaternions are read as {}: only then do the bodies in the file fit."

BODY_FITS = (
    "The base is body {} in the file, counted from 0: only then do the bodies fit."
)

FITS = ", and fit {0}: the motion is made for it; use --model {0} or robot:={0}."

OTHER_ROBOT = ": the motion may be for another robot or version."

WORLD = (
    "The first body in the file stays at the origin: it is read as the base, but is "
    "perhaps the world. Name the bodies in body_names, or remove it."
)


@dataclass(frozen=True, eq=False)
class Bodies:
    """Places of bodies in a file."""

    places: np.ndarray
    """In [m], shape (n_samples, n_bodies, 3)."""

    turns: np.ndarray | None = None
    """Quaternions, shape (n_samples, n_bodies, 4)."""

    links: Sequence[str] | None = None
    """Names of links, empty where unknown; None: the file has no names."""


@dataclass(frozen=True, eq=False)
class FoundBase:
    """The base of a file, and the evidence of its bodies."""

    poses: np.ndarray
    """T_map_base, shape (n_samples, 7)."""

    joint_names: tuple[str, ...]
    """The possible names that fit best."""

    joints_are_known: bool
    """Whether the order of the joints follows from the bodies."""

    notes: tuple[str, ...]
    """Messages on refuted assumptions, and on bodies that do not fit."""


@dataclass(frozen=True, eq=False)
class _Reading:
    """A way to read a file."""

    order: str
    names: tuple[str, ...]
    root: int
    links: Sequence[str]


def find_base(
    source: MotionSource,
    robot: Description,
    bodies: Bodies,
    positions: np.ndarray,
    names: Sequence[tuple[str, ...]],
    order: str,
    base: tuple[np.ndarray, np.ndarray] | None = None,
) -> FoundBase:
    """Find how a file has to be read so that its bodies fit the robot.

    Whether they settle the order of quaternions is noted in the source.

    Args:
        source: The file.
        robot: The robot.
        bodies: Bodies of the file.
        positions: Positions of the joints, shape (n_samples, n_joints).
        names: Possible names of the joints, the likeliest first.
        order: The format's order of quaternions, xyzw or wxyz.
        base: Places and quaternions of the base, if no body is taken for it.

    Returns:
        The base as the format says, unless the bodies fit only if it is another one.
    """
    orders = (
        [source.options.order] if source.options.order else [order, OTHER_ORDER[order]]
    )
    readings = [
        _Reading(one, own, *layout)
        for one in orders
        for own in names
        for layout in _layouts(robot, bodies, own)
    ]
    n_samples = len(positions)
    compared = np.linspace(0, n_samples - 1, N_COMPARED).astype(int)

    def poses(reading: _Reading, rows: np.ndarray) -> np.ndarray:
        """Return poses of the base as they are read."""
        if base is None:
            assert bodies.turns is not None
            places, turns = (
                bodies.places[:, reading.root],
                bodies.turns[:, reading.root],
            )
        else:
            places, turns = base
        return base_of(places[rows], turns[rows], reading.order)

    still = np.tile(IDENTITY, (len(compared), 1))

    def deviation(reading: _Reading, kinematics: Kinematics, of: Description) -> float:
        """Return how far bodies are off a robot's links, in [m]."""
        joints = of_robot(reading.names, positions[compared], of)
        T_base_links = kinematics.link_poses(still, joints)
        links = compose(poses(reading, compared)[:, np.newaxis], T_base_links)
        return _deviation(reading, links, bodies.places[compared], of)

    kinematics = Kinematics(robot)
    errors = [deviation(reading, kinematics, robot) for reading in readings]
    first = readings[0]
    usual = [
        number
        for number, reading in enumerate(readings)
        if (reading.order, reading.root) == (first.order, first.root)
    ]
    best = min(usual, key=errors.__getitem__)
    other = min(range(len(readings)), key=errors.__getitem__)
    may_differ = _is_whole(bodies, positions) or errors[other] <= BODY_MISMATCH
    if may_differ and errors[best] > max(BODY_MISMATCH, CLEARLY * errors[other]):
        best = other
    chosen, error = readings[best], errors[best]
    fits = error <= BODY_MISMATCH
    others = (e for e, r in zip(errors, readings) if r.order != chosen.order)
    source.is_settled = CLEARLY * error < min(others, default=0.0)
    notes = []
    if chosen.order != first.order:
        notes.append(ORDER_FITS.format(" ".join(chosen.order)))
    if chosen.root != first.root and base is None:
        notes.append(BODY_FITS.format(chosen.root))
    own = {joint.name for joint in robot.movable_joints}
    is_known = fits or (_is_whole(bodies, positions) and error < np.inf)
    is_known &= {*chosen.names} <= own
    if is_known and not fits:
        fitting = [
            other.name
            for other, kinematics in _package_robots(frozenset(chosen.names))
            for root, links in _layouts(other, bodies, chosen.names)
            if root == chosen.root
            and deviation(replace(chosen, links=links), kinematics, other)
            <= BODY_MISMATCH
        ]
        off = (
            f"The bodies in the file are up to {error:.3f} m off those of {robot.name}"
        )
        notes.append(f"{off}{FITS.format(*fitting) if fitting else OTHER_ROBOT}")
    found = poses(chosen, np.arange(n_samples))
    if not fits and bodies.places.any() and not found[:, :3].any():
        notes.append(WORLD)
    return FoundBase(found, chosen.names, is_known, tuple(notes))


@lru_cache(maxsize=8)
def _package_robots(names: frozenset[str]) -> list[tuple[Description, Kinematics]]:
    """Read the robots of the package that have these joints."""
    robots = [read_description(folder) for folder in package_profiles()]
    return [
        (robot, Kinematics(robot))
        for robot in robots
        if names <= {joint.name for joint in robot.movable_joints}
    ]


def _is_whole(bodies: Bodies, positions: np.ndarray) -> bool:
    """Return whether bodies have names, or are the base and a link for each joint."""
    n_bodies, n_joints = bodies.places.shape[1], positions.shape[1]
    return bodies.links is not None or n_bodies == n_joints + 1


def _layouts(
    robot: Description, bodies: Bodies, names: Sequence[str]
) -> Iterator[tuple[int, Sequence[str]]]:
    """Yield which body is possibly the base, and the links of all bodies.

    Bodies without names are the base and the joints' child links, one after another;
    others, as the world and objects, are before or behind them.
    """
    n_bodies = bodies.places.shape[1]
    if bodies.links is not None:
        links = bodies.links
        yield (links.index(robot.root) if robot.root in links else 0), links
        return
    moved = links_of(robot, names)
    n_others = n_bodies - len(moved)
    if not 0 <= n_others <= MAX_OTHERS:
        yield 0, [""] * n_bodies
    else:
        for before in range(n_others + 1):
            yield before, [*[""] * before, *moved, *[""] * (n_others - before)]


def _deviation(
    reading: _Reading, links: np.ndarray, places: np.ndarray, robot: Description
) -> float:
    """Return the largest distance of bodies from a robot's links, in [m].

    Args:
        reading: Which bodies are which links.
        links: Poses of all links of the robot, shape (n, n_links, 7).
        places: Places of the bodies, shape (n, n_bodies, 3).
        robot: The robot.

    Returns:
        Infinity if no body but the base is known, or all places are zero.
    """
    rows = {link: row for row, link in enumerate(robot.link_names)}
    own = [column for column, link in enumerate(reading.links) if link in rows]
    if not {reading.links[column] for column in own} - {robot.root}:
        return np.inf
    if not places.any():  # a file without places
        return np.inf
    placed = links[:, [rows[reading.links[column]] for column in own], :3]
    return float(np.linalg.norm(placed - places[:, own], axis=-1).max())


def links_of(robot: Description, names: Sequence[str]) -> list[str]:
    """Name the base and the child links of joints, empty for unknown joints."""
    child = {joint.name: joint.child for joint in robot.movable_joints}
    return [robot.root, *(child.get(name, "") for name in names)]


def bodies_in(arrays: Arrays, n_samples: int) -> Bodies | None:
    """Return the bodies that a file has beside its base; None: it has none."""
    for key in KEYS:
        shape = np.shape(arrays[key]) if key in arrays else ()
        if shape[:1] + shape[2:] != (n_samples, 3):
            continue
        links = arrays.names("body_names") if "body_names" in arrays else None
        if links is None or len(links) == shape[1]:
            return Bodies(arrays.numbers(key, n_samples, None, 3), None, links)
    return None
