"""Steps of whole-body inverse kinematics: a small quadratic program each.

The velocities of root and joints that a step takes minimize the squared errors of
tasks, weighted, with limits of joints, balance and distances as bounds. Sources:
Nakamura and Hanafusa, J. Dyn. Sys. Meas. Control, 1986 (damping); Sugihara, IEEE Trans.
Robotics, 2011 (damping by the error); Kanoun et al., IEEE Trans. Robotics, 2011
(inequalities).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import daqp
import numpy as np

from g1_description.checks.support import Corners
from g1_description.collisions.self_collisions import SelfCollisions
from g1_description.robot.assembly import WORLD
from g1_description.robot.description import Description
from g1_description.robot.dynamics import Masses
from g1_description.robot.jacobians import Jacobians
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.rotation import (
    conjugate,
    from_rotation_vector,
    multiply,
    normalized,
    rotate,
    to_rotation_vector,
)
from g1_description.sim.standing import outlines

TOLERANCE = np.array([1e-3, np.radians(0.5)])
"""Errors of a task that is reached, in [m] and [rad]."""

HARD = 100.0
"""Weight of what others must not disturb, but by a ten-thousandth of their errors."""

LARGEST_STEP = 0.3
"""Change of a joint or the root in a step, in [rad] or [m]."""

LEAST_DAMPING = 1e-5
"""Of all steps: where tasks leave a choice, steps are small enough not to overshoot."""

POSTURE = 3e-4
"""Weight of the posture, against those of tasks."""

INFLUENCE = 0.03
"""Distance from which on links slow down towards each other, in [m]."""

UNBOUNDED = 1e30
"""As the solver wants infinity."""

SOFT = 8
"""Mark of the solver for constraints that are kept as far as others allow."""


class Configuration(NamedTuple):
    """Where a robot is."""

    root: np.ndarray
    """Pose of the root link in the world, shape (7,)."""

    position: np.ndarray
    """Of the movable joints in [rad] or [m], shape (n_joints,)."""


class LinkTask(NamedTuple):
    """Where a link should be."""

    link: int
    """Its row."""

    pose: np.ndarray
    """In the world, shape (7,)."""

    weights: np.ndarray
    """Of its position along the world's axes and of its rotation about them, shape
    (6,); 0: any will do."""

    point: np.ndarray = np.zeros(3)
    """Which of its points should be there, in its frame, in [m], shape (3,)."""

    @property
    def link_pose(self) -> np.ndarray:
        """Pose of the link itself in the world, shape (7,)."""
        origin = self.pose[:3] - rotate(self.pose[3:], self.point)
        return np.concatenate([origin, self.pose[3:]])


@dataclass(frozen=True, eq=False)
class IkConstraints:
    """What a configuration must keep to."""

    lower: np.ndarray
    """Lower limits of joints, shape (n_joints,)."""

    upper: np.ndarray
    """Upper limits of joints, shape (n_joints,)."""

    base: np.ndarray = field(default_factory=lambda: np.ones(6))
    """1 where the root may move along and turn about the world's axes, shape (6,)."""

    support: Corners | None = None
    """Polygon in which the centre of mass must be; None: anywhere."""

    margin: float = 0.0
    """Least distance of the centre of mass from its edges, in [m]."""

    floor: float | None = None
    """Height of the floor, in [m]; None: there is none."""

    above_floor: Sequence[int] = ()
    """Rows of the links that must be above it."""

    distance: float | None = None
    """Least distance of links from each other, in [m]; None: any."""


@dataclass(frozen=True, eq=False)
class Linearization:
    """A configuration with its errors, and how they change with its velocities."""

    configuration: Configuration
    tasks: Sequence[LinkTask]
    bounds: IkConstraints
    jacobians: Jacobians

    points: np.ndarray
    """Those of tasks in the world, in [m], shape (n_tasks, 3)."""

    displacements: np.ndarray
    """By how much the links of tasks must move and turn along the world's axes, in [m]
    and [rad], shape (n_tasks, 6); 0 where free."""

    rates: np.ndarray
    """Of the centre of mass towards edges of its polygon, of links towards the floor
    and towards each other, by the velocities, shape (n, 6 + n_joints)."""

    room: np.ndarray
    """By how much these may approach, in [m], negative beyond, shape (n,)."""

    n_edges: int
    """Number of edges of the polygon, which come first."""

    n_low: int
    """Number of links near the floor, which come next."""

    is_stuck: bool = False
    """Whether the solver found no step from here."""

    @property
    def errors(self) -> np.ndarray:
        """Distances from the tasks, in [m] and [rad], shape (n_tasks, 2)."""
        parts = self.displacements.reshape(-1, 2, 3)
        return np.asarray(np.linalg.norm(parts, axis=-1))

    @property
    def imbalance(self) -> float:
        """By how much the centre of mass is outside of its polygon, in [m]."""
        return float(max(0.0, -self.room[: self.n_edges].min(initial=0.0)))

    @property
    def depth(self) -> float:
        """By how much links are below the floor, in [m]."""
        room = self.room[self.n_edges : self.n_edges + self.n_low]
        return float(max(0.0, -room.min(initial=0.0)))

    @property
    def overlap(self) -> float:
        """By how much links are too near to each other, in [m]."""
        room = self.room[self.n_edges + self.n_low :]
        return float(max(0.0, -room.min(initial=0.0)))

    @property
    def cost(self) -> float:
        """Sum of squared errors, which steps reduce."""
        weights = np.array([task.weights for task in self.tasks]).reshape(-1, 6)
        squares = (weights * self.displacements) ** 2
        excess = self.imbalance**2 + self.depth**2 + self.overlap**2
        return float(squares.sum()) + HARD**2 * excess

    @property
    def badness(self) -> float:
        """Largest error as a multiple of the tolerance; 1 or less: all is reached."""
        beyond = max(self.imbalance, self.depth, self.overlap) / TOLERANCE[0]
        return max(float((self.errors / TOLERANCE).max(initial=0.0)), beyond)


class IkSolver:
    """Steps of a robot with one tree towards tasks."""

    def __init__(
        self, description: Description, collisions: SelfCollisions | None = None
    ) -> None:
        """Prepare a robot.

        Args:
            description: The robot.
            collisions: Its self-collisions, where distances are to be kept.
        """
        self.kinematics = Kinematics(description)
        self.masses = Masses(description)
        self._links = [link for link in description.links if link.name != WORLD]
        self._collisions = collisions
        if collisions is not None:
            names = [name for name in description.link_names if name != WORLD]
            rows = [[names.index(name) for name in pair] for pair in collisions.pairs]
            self._pairs = np.array(rows, dtype=int).reshape(-1, 2)

    def view(
        self, now: Configuration, tasks: Sequence[LinkTask], bounds: IkConstraints
    ) -> Linearization:
        """Compare a configuration with tasks and bounds."""
        jacobians = Jacobians(self.kinematics, *now)
        poses = jacobians.link_poses[[task.link for task in tasks]].reshape(-1, 7)
        offsets = np.array([task.point for task in tasks]).reshape(-1, 3)
        points = poses[:, :3] + rotate(poses[:, 3:], offsets)
        wanted = np.array([task.pose for task in tasks]).reshape(-1, 7)
        turns = multiply(wanted[:, 3:], conjugate(poses[:, 3:]))
        moves = [wanted[:, :3] - points, to_rotation_vector(turns)]
        free = np.array([task.weights for task in tasks]).reshape(-1, 6) == 0.0
        displacements = np.where(free, 0.0, np.concatenate(moves, axis=-1))
        n_columns = 6 + len(now.position)
        parts = [(np.zeros((0, n_columns)), np.zeros(0))]
        if bounds.support is not None:
            parts.append(self._balance(bounds.support, bounds.margin, jacobians))
        n_edges = sum(len(room) for _, room in parts)
        if bounds.floor is not None:
            parts.append(self._heights(bounds.floor, bounds.above_floor, jacobians))
        n_low = sum(len(room) for _, room in parts) - n_edges
        if bounds.distance is not None:
            parts.append(self._approaches(bounds.distance, jacobians))
        rates, room = (np.concatenate(part) for part in zip(*parts))
        return Linearization(
            now,
            tasks,
            bounds,
            jacobians,
            points,
            displacements,
            rates,
            room,
            n_edges,
            n_low,
        )

    def _balance(
        self, support: Corners, margin: float, jacobians: Jacobians
    ) -> tuple[np.ndarray, np.ndarray]:
        """Compute rates and room of the centre of mass towards the edges."""
        corners = np.array(support)
        edges = np.roll(corners, -1, axis=0) - corners
        normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1)
        normals /= np.linalg.norm(normals, axis=1)[:, np.newaxis]
        center = self.masses.robot_center(jacobians.link_poses)[:2]
        rates = normals @ jacobians.of_center_of_mass(self.masses)[:2]
        return rates, ((corners - center) * normals).sum(axis=1) - margin

    @cached_property
    def _outlines(self) -> list[list[tuple[np.ndarray, np.ndarray]]]:
        """Points around each link in its frame, and the radii around them, by octant.

        With only the lowest point of all, steps would rock a foot from heel to toe.
        """
        found = []
        for link in self._links:
            points, radii = outlines(link)
            octants = (points > points.mean(axis=0)) @ [1, 2, 4]
            each = [octants == number for number in np.unique(octants)]
            found.append([(points[one], radii[one]) for one in each])
        return found

    def _heights(
        self, floor: float, links: Sequence[int], jacobians: Jacobians
    ) -> tuple[np.ndarray, np.ndarray]:
        """Compute rates and room of links towards the floor."""
        rows, lowest, room = [], [], []
        for row in links:
            pose = jacobians.link_poses[row]
            up = rotate(conjugate(pose[3:]), np.array([0.0, 0.0, 1.0]))
            for points, radii in self._outlines[row]:
                heights = pose[2] + points @ up - radii
                point = int(np.argmin(heights))
                if heights[point] < floor + INFLUENCE:
                    rows.append(row)
                    lowest.append(pose[:3] + rotate(pose[3:], points[point]))
                    room.append(heights[point] - floor)
        places = np.array(lowest).reshape(-1, 3)
        rates = -jacobians.of_points(np.array(rows, dtype=int), places)[:, 2]
        return rates, np.array(room)

    def _approaches(
        self, distance: float, jacobians: Jacobians
    ) -> tuple[np.ndarray, np.ndarray]:
        """Compute rates and room of links towards each other."""
        assert self._collisions is not None
        poses = jacobians.link_poses[np.newaxis]
        found = self._collisions.contacts(poses, distance + INFLUENCE)
        first, second = self._pairs[found.pair].T
        rates = jacobians.of_points(first, found.points_a)
        rates -= jacobians.of_points(second, found.points_b)
        rates = (found.normal[:, np.newaxis] @ rates)[:, 0]
        return rates, found.distance - distance

    def step(
        self, view: Linearization, posture: np.ndarray, damping: float
    ) -> Configuration | None:
        """Make a step towards the tasks of a view.

        Args:
            view: The present configuration, inside the limits of joints.
            posture: Positions to prefer where tasks leave a choice, shape (n_joints,).
            damping: Of the step; large: a small one along the gradient of the cost.

        Returns:
            The next configuration, inside the limits of joints; None if the solver
            finds none, as numbers of very different sizes exceed its precision.
        """
        now, bounds, tasks = view.configuration, view.bounds, view.tasks
        weights = np.array([task.weights for task in tasks]).reshape(-1, 6)
        wanted = (weights * view.displacements).ravel()
        matrix = view.jacobians.of_links([task.link for task in tasks], view.points)
        matrix = (weights[..., np.newaxis] * matrix).reshape(len(wanted), -1)
        hessian, gradient = matrix.T @ matrix, -matrix.T @ wanted
        every = np.arange(len(gradient))
        joints = every[6:]
        gradient[6:] -= POSTURE**2 * (posture - now.position)
        hessian[joints, joints] += POSTURE**2
        hessian[every, every] += damping + LEAST_DAMPING
        root = LARGEST_STEP * bounds.base
        lower = np.maximum(bounds.lower - now.position, -LARGEST_STEP)
        upper = np.minimum(bounds.upper - now.position, LARGEST_STEP)
        least = np.full(len(view.room), -UNBOUNDED)
        sense = np.zeros(len(gradient) + len(least), dtype=np.int32)
        sense[len(gradient) :] = SOFT
        step, _, flag, _ = daqp.solve(
            hessian,
            gradient,
            view.rates,
            np.concatenate([root, upper, view.room]),
            np.concatenate([-root, lower, least]),
            sense,
        )
        if flag <= 0 or not np.isfinite(step).all():
            return None
        position = np.clip(now.position + step[6:], bounds.lower, bounds.upper)
        if not bounds.base.any():
            return Configuration(now.root, position)
        moved = now.root[:3] + bounds.base[:3] * step[:3]
        turn = from_rotation_vector(bounds.base[3:] * step[3:6])
        rotation = normalized(multiply(turn, now.root[3:]))
        return Configuration(np.concatenate([moved, rotation]), position)
