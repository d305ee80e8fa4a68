"""Splines of base and joints at samples, and how tasks and limits see them there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import sparse

from g1_description.ik.limits import (
    BalanceLimit,
    BatchLimit,
    Course,
    Limit,
    TrajectoryBounds,
    checked_approach,
)
from g1_description.ik.solver import Configuration, IkConstraints, IkSolver
from g1_description.ik.splines import basis, products_of
from g1_description.ik.tasks import LinkTask, displaced
from g1_description.robot.dynamics import GRAVITY, RobotMotion, inverse_dynamics
from g1_description.robot.jacobians import Jacobians
from g1_description.robot.rotation import from_rotation_vector, multiply, normalized

PERIOD = 0.1
"""Time between the knots of splines in [s]: motions of up to 3 Hz are followed."""


class Problem(NamedTuple):
    """Tasks, constraints and bounds of a trajectory."""

    times: np.ndarray
    """In [s], increasing, at least two, shape (n,)."""

    tasks: Sequence[LinkTask]
    """With the axis of the samples."""

    constraints: IkConstraints
    start: Configuration
    """Where the search begins, and the posture to prefer."""

    bounds: TrajectoryBounds
    speeds: np.ndarray
    """Largest velocities of joints in [rad/s] or [m/s], shape (n_joints,)."""


class SampledView(NamedTuple):
    """A trajectory at its samples."""

    control: np.ndarray
    """Control points, shape (count, n_columns)."""

    columns: np.ndarray
    """Positions of the root, rotation vectors from its first rotation, and joints,
    shape (n, n_columns)."""

    roots: np.ndarray
    """Poses of the root link in the world, shape (n, 7)."""

    jacobians: Jacobians
    points: np.ndarray
    """Points of tasks in the world, shape (n, n_tasks, 3)."""

    displacements: np.ndarray
    """From the tasks, shape (n, n_rows)."""


class Approached(NamedTuple):
    """A limit at samples, linearized."""

    rows: np.ndarray
    """Of the samples, shape (n,)."""

    rates: np.ndarray
    """By columns, shape (n, n_columns)."""

    room: np.ndarray
    """In [m], shape (n,)."""

    weights: sparse.csr_matrix
    """How much all samples see of control points, shape (n_samples, count)."""


class SampledSplines:
    """Maps control points of base and joints to samples.

    Columns are positions of the root link, a rotation vector from its rotation at the
    start, and positions of joints.
    """

    def __init__(self, solver: IkSolver, problem: Problem) -> None:
        """Place the knots."""
        self._solver, self._problem = solver, problem
        times = problem.times
        duration = float(times[-1] - times[0])
        knots = max(1, math.ceil(duration / PERIOD - 1e-9))
        self.period = duration / knots
        """Time between knots, in [s]."""
        self.count = knots + 3
        """Number of control points."""
        knots_at = times, float(times[0]), self.period, self.count
        self.weights, *self._rates = (
            basis(*knots_at, order).tocsr() for order in range(3)
        )
        self.products = products_of(self.weights)
        """Those of the weights."""
        given = problem.constraints
        self.moves = np.append(given.base, 1.0 * (given.lower < given.upper))
        """1 where a column may change, shape (n_columns,)."""

    @property
    def centers(self) -> np.ndarray:
        """Return the times at which control points count most, shape (count,)."""
        return self._problem.times[0] + self.period * (np.arange(self.count) - 1)

    def rows(self, period: float) -> np.ndarray:
        """Return the rows of samples a period apart, the first and last ones too."""
        times = self._problem.times
        count = max(2, math.ceil((times[-1] - times[0]) / period) + 1)
        ideal = np.linspace(times[0], times[-1], count)
        nearest = np.searchsorted(times, ideal - 1e-9)
        return np.unique(np.minimum(nearest, len(times) - 1))

    def view(self, control: np.ndarray) -> SampledView:
        """Compare a trajectory with its tasks.

        Args:
            control: Control points, shape (count, n_columns).
        """
        columns = self.weights @ control
        turns = from_rotation_vector(columns[:, 3:6])
        reference = np.broadcast_to(self._problem.start.root[3:], turns.shape)
        rotations = normalized(multiply(turns, reference))
        roots = np.concatenate([columns[:, :3], rotations], axis=1)
        jacobians = Jacobians(self._solver.kinematics, roots, columns[:, 6:])
        points, displacements = displaced(self._problem.tasks, jacobians)
        return SampledView(control, columns, roots, jacobians, points, displacements)

    def course(self, view: SampledView) -> Course:
        """Return where links are in a trajectory."""
        return Course(self._problem.times, view.jacobians.link_poses)

    def approach(self, limit: Limit, view: SampledView, rows: np.ndarray) -> Approached:
        """Linearize a limit at samples given by their rows."""
        placed = view.roots[rows], view.columns[rows, 6:]
        some = Jacobians(self._solver.kinematics, *placed)
        weights = self.weights
        if isinstance(limit, BatchLimit):
            limit = limit.at(rows, self.course(view))
        if isinstance(limit, BalanceLimit) and limit.is_of_zmp:
            points, levers = self._zero_moment_points(view, rows, limit)
            samples, (rates, room) = limit.approaches(some, points)
            lever = sparse.diags(np.bincount(rows, levers, weights.shape[0]))
            weights = (weights - lever @ self._rates[1]).tocsr()
        elif isinstance(limit, BatchLimit):
            samples, (rates, room) = limit.approaches(some)
        else:
            each = (Jacobians(self._solver.kinematics, *one) for one in zip(*placed))
            width = view.columns.shape[1]
            found = [checked_approach(limit, one, width) for one in each]
            samples = np.repeat(np.arange(len(rows)), [len(room) for _, room in found])
            rates, room = (np.concatenate(part) for part in zip(*found))
        rows = rows[samples]
        rates = self.in_columns(rates[:, np.newaxis], view.columns[rows])[:, 0]
        return Approached(rows, rates, room, weights)

    def _zero_moment_points(
        self, view: SampledView, rows: np.ndarray, limit: BalanceLimit
    ) -> tuple[np.ndarray, np.ndarray]:
        """Compute the zero-moment points on the floors of a limit.

        Returns:
            In the world, in [m], shape (n, 2), and how far they are moved by an
            acceleration of the centre of mass, in [s^2], shape (n,).
        """
        columns = view.columns[rows]
        rates, changes = self.rates(view, rows)
        motion = RobotMotion(
            view.roots[rows],
            columns[:, 6:],
            rates[:, :6],
            rates[:, 6:],
            changes[:, :6],
            changes[:, 6:],
        )
        masses, floors = limit.masses, limit.floors
        found = inverse_dynamics(self._solver.kinematics, masses, motion)
        force, moment = np.split(found.root_wrench, 2, axis=1)
        least = 1e-3 * GRAVITY * masses.total[..., np.newaxis]
        upward = np.maximum(force[:, 2:], least)
        places = np.stack([-moment[:, 1], moment[:, 0]], axis=1)
        places = (places + floors[:, np.newaxis] * force[:, :2]) / upward
        return places, (found.center_of_mass[:, 2] - floors) / GRAVITY

    def rates(
        self, view: SampledView, rows: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Compute velocities and accelerations of root and joints, shape (n, ...)."""
        turns = view.columns[rows, 3:6]
        rates, changes = (one[rows] @ view.control for one in self._rates)
        spun = steady_acceleration(turns, rates[:, 3:6])
        turning = left_jacobian(turns)
        for part in (rates, changes):
            part[:, 3:6] = (turning @ part[:, 3:6, np.newaxis])[..., 0]
        changes[:, 3:6] += spun
        return rates, changes

    def turns_too_fast(self, view: SampledView) -> bool:
        """Return whether turns exceed bounds, as rotations have changed since these."""
        given, every = self._problem.bounds, np.arange(len(view.roots))
        rates, changes = np.abs(self.rates(view, every))[..., 3:6]
        most = given.base_turn_rate, given.base_turn_acceleration
        return bool(rates.max() > most[0] or changes.max() > most[1])

    def in_columns(self, rates: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Turn rates by the root's twist, shape (n, m, n_columns), into ours."""
        found = self.moves * rates
        found[..., 3:6] = found[..., 3:6] @ left_jacobian(columns[:, 3:6])
        return found


def left_jacobian(vectors: np.ndarray) -> np.ndarray:
    """Compute what turns rates of rotation vectors into angular velocities.

    Args:
        vectors: Shape (n, 3), in [rad].

    Returns:
        Shape (n, 3, 3). Source: Barfoot, State Estimation for Robotics, 2017, 7.77.
    """
    angle = np.maximum(np.linalg.norm(vectors, axis=-1), 1e-6)[:, None, None]
    cross = np.cross(np.eye(3), vectors[:, np.newaxis])
    first = (1.0 - np.cos(angle)) / angle**2
    second = (angle - np.sin(angle)) / angle**3
    return np.eye(3) + first * cross + second * (cross @ cross)


def steady_acceleration(vectors: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """Compute angular accelerations while rates of rotation vectors do not change.

    Args:
        vectors: In [rad], shape (n, 3).
        rates: In [rad/s], shape (n, 3).

    Returns:
        Derivative of the left Jacobian by time, times the rates, in [rad/s^2], shape
        (n, 3).
    """
    angle = np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-3)
    grows = (vectors * rates).sum(axis=-1, keepdims=True) / angle
    above, beyond = 1.0 - np.cos(angle), angle - np.sin(angle)
    first = (angle * np.sin(angle) - 2.0 * above) / angle**3
    second = (angle * above - 3.0 * beyond) / angle**4
    across = np.cross(vectors, rates)
    found = grows * (first * across + second * np.cross(vectors, across))
    return np.asarray(found + beyond / angle**3 * np.cross(rates, across))
