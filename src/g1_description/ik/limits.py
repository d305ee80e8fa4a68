"""Limits of inverse kinematics: distances that must not get smaller, and speeds.

A limit has quantities, such as the distance of the centre of mass from an edge. Steps
of the solver let each shrink by no more than there is of it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Callable, NamedTuple, Protocol, Tuple

import numpy as np

from g1_description.checks.support import Corners
from g1_description.collisions.self_collisions import SelfCollisions
from g1_description.errors import InvalidValueError
from g1_description.ik.targets import is_number
from g1_description.robot.assembly import WORLD
from g1_description.robot.description import Description, Link
from g1_description.robot.dynamics import Masses
from g1_description.robot.jacobians import Jacobians
from g1_description.robot.rotation import rotate, to_axes
from g1_description.sim.standing import outlines

INFLUENCE = 0.03
"""Distance from which on links slow down towards the floor and each other, in [m]."""

Approach = Tuple[np.ndarray, np.ndarray]
"""Rates of quantities towards their limits by the velocities of the root, along and
about the world's axes, and of joints, shape (n, 6 + n_joints), and by how much they may
still go, in [m], negative beyond the limit, shape (n,)."""

SampledApproach = Tuple[np.ndarray, Approach]
"""Indices of configurations, shape (n,), and the approach of one quantity of each."""


class Limit(Protocol):
    """A limit that configurations keep, as far as other limits allow."""

    def approach(self, jacobians: Jacobians) -> Approach:
        """Linearize the quantities at a configuration; any number of them."""

    def excess_message(self, excess: float) -> str:
        """Describe how far a configuration is beyond the limit, given in [m]."""


def checked_approach(limit: Limit, jacobians: Jacobians, n_columns: int) -> Approach:
    """Linearize a limit; the solver takes any numbers for granted.

    Raises:
        InvalidValueError: If it does not return what ``Approach`` says.
    """
    found = limit.approach(jacobians)
    if not (isinstance(found, tuple) and len(found) == 2):
        raise InvalidValueError(
            f"{type(limit).__name__}.approach must return rates and room (got "
            f"{str(found)[:80]})."
        )
    rates, room = (np.asarray(part, dtype=float) for part in found)
    fits = room.ndim == 1 and rates.shape == (len(room), n_columns)
    if not fits or not (np.isfinite(rates).all() and np.isfinite(room).all()):
        raise InvalidValueError(
            f"{type(limit).__name__}.approach must return finite rates of shape (n, "
            f"{n_columns}) and room of shape (n,) (got shapes {rates.shape} and "
            f"{room.shape})."
        )
    return rates, room


def limit_name(limit: Limit) -> str:
    """Describe that a limit is reached."""
    return getattr(limit, "reached", f"{type(limit).__name__} is reached")


class Course(NamedTuple):
    """The course of a motion, as far as it is known."""

    times: np.ndarray
    """In [s], increasing, shape (n,)."""

    link_poses: np.ndarray
    """Poses of all links in the world, shape (n, n_links, 7)."""


Loaded = Callable[[Masses, np.ndarray, Course], Masses]
"""Adds what links carry to the masses of a robot, in configurations given by their
rows in the course of a motion."""


class BatchLimit(ABC):
    """A limit that is linearized at many configurations at once."""

    reached: str
    """Describes that it is reached."""

    changes = np.zeros(0, dtype=int)
    """Rows of configurations that need attention, as much changes there."""

    def at(self, rows: np.ndarray, course: Course) -> BatchLimit:
        """Return the limit of some configurations of a motion."""
        return self

    @abstractmethod
    def approaches(self, jacobians: Jacobians) -> SampledApproach:
        """Linearize the quantities at the configurations of a batch.

        Returns:
            Indices of the configurations, increasing, one for each quantity, and the
            approach.
        """

    def approach(self, jacobians: Jacobians) -> Approach:
        """Linearize the quantities at a configuration."""
        _, approach = self.approaches(jacobians.batched())
        return approach

    @abstractmethod
    def excess_message(self, excess: float) -> str:
        """Describe how far a configuration is beyond the limit, given in [m]."""


class BalanceLimit(BatchLimit):
    """Keeps the centre of mass above polygons, a margin from their edges."""

    def __init__(
        self,
        masses: Masses,
        supports: Sequence[Corners],
        margin: float,
        share: float = np.inf,
        floors: Sequence[float] = (0.0,),
        is_of_zmp: bool = False,
        loaded: Loaded | None = None,
    ) -> None:
        """Prepare polygons, one for each configuration of a batch, or one for all.

        Args:
            masses: Masses of the robot.
            supports: Their corners, counterclockwise, in the world, in [m].
            margin: Least distance from their edges, in [m].
            share: Most of the distance of a middle from its edges that the margin is.
            floors: Heights of the polygons, in [m].
            is_of_zmp: Whether the zero-moment point keeps the margin instead.
            loaded: Adds the masses of what links carry; None: they carry nothing.
        """
        subject = "zero-moment point" if is_of_zmp else "centre of mass"
        self._subject, self.is_of_zmp = subject, is_of_zmp
        self.reached = f"the {subject} is at its margin from the edge"
        self.floors = np.array(floors)
        """Heights of the polygons, in [m], shape (n,)."""
        self.masses, self._loaded = masses, loaded
        most = max(map(len, supports))
        filled = [[*one, *[one[-1]] * (most - len(one))] for one in supports]
        self._corners = np.array(filled)
        edges = np.roll(self._corners, -1, axis=1) - self._corners
        lengths = np.linalg.norm(edges, axis=-1)
        normals = np.stack([edges[..., 1], -edges[..., 0]], axis=-1)
        self._normals = normals / np.maximum(lengths, 1e-9)[..., np.newaxis]
        self._is_edge = lengths > 0.0
        middles = np.array([np.mean(one, axis=0) for one in supports])
        inside = np.where(self._is_edge, self._distances(middles), np.inf).min(axis=1)
        self.margins = np.minimum(margin, share * inside)
        """Least distances from the edges, in [m], shape (n,)."""

    def at(self, rows: np.ndarray, course: Course) -> BalanceLimit:
        """Return the limit of some configurations of the batch."""
        found = copy(self)
        if self._loaded is not None:
            found.masses = self._loaded(self.masses, rows, course)
        if len(self._corners) == 1:
            return found
        for name in ("floors", "margins", "_corners", "_normals", "_is_edge"):
            setattr(found, name, getattr(self, name)[rows])
        return found

    @property
    def changes(self) -> np.ndarray:  # type: ignore[override]
        """Rows of configurations whose polygon differs from the one before or after."""
        differs = (np.diff(self._corners, axis=0) != 0.0).any(axis=(1, 2))
        before = np.flatnonzero(differs)
        return np.union1d(before, before + 1)

    def _distances(self, places: np.ndarray) -> np.ndarray:
        """Return the distances of places from the edges, shape (n, n_edges)."""
        away = self._corners - places[:, np.newaxis]
        return np.asarray((away * self._normals).sum(axis=-1))

    def approaches(
        self, jacobians: Jacobians, places: np.ndarray | None = None
    ) -> SampledApproach:
        """Linearize the distances of the centres of mass from the edges.

        Args:
            jacobians: Those of n configurations.
            places: Places that move as the centres of mass do, and count instead, in
                the world, in [m], shape (n, 2).
        """
        if places is None:
            places = self.masses.robot_center(jacobians.link_poses)[:, :2]
        moves = jacobians.of_center_of_mass(self.masses)[:, :2]
        rates = self._normals @ moves
        room = self._distances(places) - self.margins[:, np.newaxis]
        is_edge = np.broadcast_to(self._is_edge, room.shape)
        return np.nonzero(is_edge)[0], (rates[is_edge], room[is_edge])

    def excess_message(self, excess: float) -> str:
        """Describe where it is and must be, for an excess in [m]."""
        margin = float(self.margins[0])
        inside = 1e3 * (margin - excess)
        place = f"{abs(inside):.0f} mm {'inside' if inside > 0.0 else 'outside'} of"
        needed = f", not at least {1e3 * margin:.0f} mm inside"
        return f"the {self._subject} is {place} what supports the robot{needed}"


class LinkPart(NamedTuple):
    """Points of a link that a floor meets, in its frame."""

    row: int
    """Row of the link, as in ``Jacobians``."""

    points: np.ndarray
    """In [m], shape (n, 3)."""

    radii: np.ndarray
    """Around the points, in [m], shape (n,)."""


def link_parts(links: Iterable[Link]) -> list[LinkPart]:
    """Split the outline of each link by octants.

    With only the lowest point of a link, steps would rock a foot from heel to toe.
    """
    parts = []
    for row, link in enumerate(links):
        points, radii = outlines(link)
        octants = (points > points.mean(axis=0)) @ [1, 2, 4]
        each = [octants == number for number in np.unique(octants)]
        parts += [LinkPart(row, points[one], radii[one]) for one in each]
    return parts


class FloorLimit(BatchLimit):
    """Keeps links above the floor."""

    reached = "a link is at the floor"

    def __init__(
        self, parts: Sequence[LinkPart], floor: float, but_for: Collection[int] = ()
    ) -> None:
        """Prepare the points of a robot's links.

        Args:
            parts: Result of ``link_parts``.
            floor: Height of the floor in the world, in [m].
            but_for: Rows of links that may be below it.
        """
        self._floor = floor
        parts = [part for part in parts if part.row not in but_for]
        counts = [len(part.points) for part in parts]
        self._begins = np.cumsum([0, *counts[:-1]]) if parts else np.zeros(0, dtype=int)
        self._rows = np.repeat([part.row for part in parts], counts).astype(int)
        nothing = [np.zeros((0, 3))], [np.zeros(0)]
        self._points = np.concatenate([part.points for part in parts] or nothing[0])
        self._radii = np.concatenate([part.radii for part in parts] or nothing[1])

    def approaches(self, jacobians: Jacobians) -> SampledApproach:
        """Linearize the heights of the lowest points near the floor."""
        samples, rows, lowest, room = self._near(jacobians.link_poses)
        return samples, (-jacobians.of_each(samples, rows, lowest)[:, 2], room)

    def _near(self, poses: np.ndarray) -> tuple[np.ndarray, ...]:
        """Find the lowest points of parts near the floor.

        Returns:
            Their samples and the rows of their links, shape (n,), their places, shape
            (n, 3), and their heights above the floor, shape (n,).
        """
        up = to_axes(poses[..., 3:])[..., 2, :]
        heights = poses[:, self._rows, 2] - self._radii
        heights += (up[:, self._rows] * self._points).sum(axis=-1)
        if not len(self._begins):
            heights = np.zeros((len(poses), 0))
        lowest = np.minimum.reduceat(heights, self._begins, axis=1)
        samples, parts = np.nonzero(lowest < self._floor + INFLUENCE)
        ends = np.append(self._begins[1:], len(self._rows))[parts]
        points = np.array(
            [
                begin + np.argmin(heights[sample, begin:end])
                for sample, begin, end in zip(samples, self._begins[parts], ends)
            ],
            dtype=int,
        )
        rows = self._rows[points]
        near = poses[samples, rows]
        places = near[:, :3] + rotate(near[:, 3:], self._points[points])
        return samples, rows, places, lowest[samples, parts] - self._floor

    def excess_message(self, excess: float) -> str:
        """Describe the depth of the lowest link, in [m]."""
        return f"a link is {1e3 * excess:.0f} mm below the floor"


class DistanceLimit(BatchLimit):
    """Keeps links away from each other."""

    reached = "links are near to each other"

    def __init__(
        self, description: Description, collisions: SelfCollisions, distance: float
    ) -> None:
        """Prepare the pairs of links.

        Args:
            description: The robot.
            collisions: Its self-collisions.
            distance: Least distance of links that may collide, in [m].
        """
        self._collisions, self._distance = collisions, distance
        names = [name for name in description.link_names if name != WORLD]
        rows = [[names.index(name) for name in pair] for pair in collisions.pairs]
        self._pairs = np.array(rows, dtype=int).reshape(-1, 2)

    def approaches(self, jacobians: Jacobians) -> SampledApproach:
        """Linearize the distances of near links."""
        reach = self._distance + INFLUENCE
        found = self._collisions.contacts(jacobians.link_poses, reach)
        first, second = self._pairs[found.pair].T
        rates = jacobians.of_each(found.sample, first, found.points_a)
        rates -= jacobians.of_each(found.sample, second, found.points_b)
        rates = (found.normal[:, np.newaxis] @ rates)[:, 0]
        return found.sample, (rates, found.distance - self._distance)

    def excess_message(self, excess: float) -> str:
        """Describe by how much the nearest links are too near, in [m]."""
        return f"links are {1e3 * excess:.0f} mm too near to each other"


@dataclass(frozen=True)
class TrajectoryBounds:
    """Largest velocities and accelerations of a trajectory."""

    base_speed: float = 1.0
    """Of the root link along each of the world's axes, in [m/s]."""

    base_acceleration: float = 3.0
    """Likewise, in [m/s^2]."""

    base_turn_rate: float = 2.0
    """Of the root link about each of the world's axes, in [rad/s]."""

    base_turn_acceleration: float = 10.0
    """Likewise, in [rad/s^2]."""

    joint_acceleration: float = 20.0
    """Of each joint, in [rad/s^2] or [m/s^2]; its velocity is that of the robot's file
    at most."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: If one is not greater than 0.
        """
        for name, value in vars(self).items():
            if not is_number(value) or not value > 0.0:
                raise InvalidValueError(
                    f"{name} must be a number greater than 0 (got {str(value)[:80]})."
                )
