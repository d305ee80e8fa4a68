"""Trajectories in which links follow targets: smooth, within bounds, found as a whole.

Base and joints are cubic splines. Each step of a sequence minimizes the linearized
errors of all samples, with bounds of velocities and accelerations, balance, floor and
distances as soft limits that are much stronger than targets. Source: Nocedal and
Wright, Numerical Optimization, 2006, chapters 10 and 18.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from scipy import sparse

from g1_description.errors import InvalidValueError
from g1_description.ik.limits import (
    BalanceLimit,
    DistanceLimit,
    FloorLimit,
    Limit,
    checked_approach,
)
from g1_description.ik.solver import (
    HARD,
    POSTURE,
    TOLERANCE,
    Configuration,
    IkConstraints,
    IkSolver,
    Linearization,
    descend,
    last,
    search,
)
from g1_description.ik.splines import (
    Bounds,
    Quadratic,
    Rows,
    basis,
    excess,
    minimized,
)
from g1_description.ik.tasks import (
    LinkTask,
    displaced,
    errors_of,
    matrix_of,
    weights_of,
)
from g1_description.robot.dynamics import GRAVITY, RobotMotion, inverse_dynamics
from g1_description.robot.jacobians import Jacobians
from g1_description.robot.rotation import (
    conjugate,
    from_rotation_vector,
    multiply,
    normalized,
    to_rotation_vector,
)

PERIOD = 0.1
"""Time between the knots of splines in [s]: motions of up to 3 Hz are followed."""

GUESS_PERIOD = 0.3
"""Time between the configurations that are searched first, in [s]."""

GUESS_STEPS = 5
"""Most steps of these searches."""

FAR = np.array([0.05, 0.2])
"""Errors from which on they pull with a constant force, in [m] and [rad]."""

MAX_SMOOTHINGS = 1000
"""Most averages of a first guess."""

AT_BOUND = 0.01
"""Distance from a bound, as a share of the range, at which something is there."""

SHARE = 0.98
"""Share of the bounds that splines use, as limits are soft."""

BOUND_WEIGHT = 1e5
"""Weight of squared excesses over bounds, in units of control points' differences."""

SMOOTHNESS = 1e-8
"""Weight of squared accelerations, in [rad/s^2] or [m/s^2]: where targets leave a
choice."""

DAMPING = 1e-4
"""Damping of steps."""

SHORTER = 0.3
"""Factor of the largest change after a step that does not help."""

LEAST_STEP = 1e-3
"""Largest change, in [rad] or [m], at which steps end."""

LARGEST_STEP = 0.1
"""Change of a control point in a step, in [rad] or [m]."""

MAX_STEPS = 15
"""Most steps."""

TRIES = 3
"""Random starts at which other configurations for the first sample are searched."""

SPREAD = 1.0
"""Largest distance of these from the start, in [rad] or [m]."""

DIFFERENT = 0.3
"""Difference in a joint from which on a configuration is another one, likewise."""

FINE = 0.3
"""Fraction of the tolerance at which steps end."""

LEAST_GAIN = 0.03
"""Relative decrease of the cost at which steps end."""


@dataclass(frozen=True)
class TrajectoryBounds:
    """Largest velocities and accelerations of a trajectory."""

    base_speed: float = 1.0
    """Of the root link along each of the world's axes, in [m/s]."""

    base_acceleration: float = 3.0
    """Likewise, in [m/s^2]."""

    base_turn_rate: float = 2.0
    """Of the root link about each axis, in [rad/s]."""

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
            is_number = isinstance(value, (int, float, np.number))
            if isinstance(value, bool) or not is_number or not value > 0.0:
                raise InvalidValueError(
                    f"{name} must be a number greater than 0 (got {str(value)[:80]})."
                )


class Problem(NamedTuple):
    """What a trajectory should do."""

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

    balances_zmp: bool = False
    """Whether balance is that of the zero-moment point, not of the centre of mass."""


class View(NamedTuple):
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


class Found(NamedTuple):
    """A trajectory with its limits and cost."""

    view: View
    rows: list[Rows]
    """Limits at some samples."""

    regular: Quadratic
    """Cost of accelerations and of other postures."""

    cost: float
    badness: float
    """Largest error as a multiple of the tolerance."""

    steps: int = 0
    """Number of steps."""


class _Approached(NamedTuple):
    """A limit at samples."""

    rows: np.ndarray
    """Of the samples, shape (n,)."""

    rates: np.ndarray
    """By columns, shape (n, n_columns)."""

    room: np.ndarray
    """In [m], shape (n,)."""

    weights: sparse.csr_matrix
    """How much all samples see of control points, shape (n_samples, count)."""


class Trajectory:
    """The search of one trajectory."""

    def __init__(self, solver: IkSolver, problem: Problem) -> None:
        """Prepare it."""
        self._solver, self._problem = solver, problem
        times, start = problem.times, problem.start
        duration = float(times[-1] - times[0])
        knots = max(1, math.ceil(duration / PERIOD - 1e-9))
        self._period, self._count = duration / knots, knots + 3
        given = times, float(times[0]), self._period, self._count
        self._basis, *self._rates = (basis(*given, order).tocsr() for order in range(3))
        self._share = self._count / len(times)
        self._weights = weights_of(problem.tasks)
        self._reference = start.root[3:]
        self._moves = np.append(problem.constraints.base, np.ones(len(start.position)))
        self._limited = self._rows(PERIOD)
        self._choose_bounds()

    def _rows(self, period: float) -> np.ndarray:
        """Return the rows of samples a period apart, the first and last ones too."""
        times = self._problem.times
        count = max(2, math.ceil((times[-1] - times[0]) / period) + 1)
        ideal = np.linspace(times[0], times[-1], count)
        nearest = np.searchsorted(times, ideal - 1e-9)
        return np.unique(np.minimum(nearest, len(times) - 1))

    def _choose_bounds(self) -> None:
        """Set bounds of differences of control points, shape (n_columns,)."""
        given, speeds = self._problem.bounds, self._problem.speeds
        turning = given.base_turn_rate, given.base_turn_acceleration
        fastest = np.repeat([given.base_speed, turning[0]], 3)
        quickest = np.repeat([given.base_acceleration, turning[1]], 3)
        joints = np.full(len(speeds), given.joint_acceleration)
        self._fastest = SHARE * np.append(fastest, speeds)
        self._quickest = SHARE * np.append(quickest, joints)

    # --- from control points to samples ---

    def view(self, control: np.ndarray) -> View:
        """Compare a trajectory with its tasks.

        Args:
            control: Control points, shape (count, n_columns).
        """
        columns = self._basis @ control
        turns = from_rotation_vector(columns[:, 3:6])
        reference = np.broadcast_to(self._reference, turns.shape)
        rotations = normalized(multiply(turns, reference))
        roots = np.concatenate([columns[:, :3], rotations], axis=1)
        jacobians = Jacobians(self._solver.kinematics, roots, columns[:, 6:])
        points, displacements = displaced(self._problem.tasks, jacobians)
        return View(control, columns, roots, jacobians, points, displacements)

    def _approach(self, limit: Limit, view: View, rows: np.ndarray) -> _Approached:
        """Linearize a limit at samples given by their rows."""
        placed = view.roots[rows], view.columns[rows, 6:]
        some = Jacobians(self._solver.kinematics, *placed)
        weights = self._basis
        if self._problem.balances_zmp and isinstance(limit, BalanceLimit):
            points, levers = self._zero_moment_points(view, rows, limit.floor)
            samples, (rates, room) = limit.approaches(some, points)
            lever = sparse.diags(np.bincount(rows, levers, weights.shape[0]))
            weights = (weights - lever @ self._rates[1]).tocsr()
        elif isinstance(limit, (BalanceLimit, DistanceLimit, FloorLimit)):
            samples, (rates, room) = limit.approaches(some)
        else:
            each = (Jacobians(self._solver.kinematics, *one) for one in zip(*placed))
            width = view.columns.shape[1]
            found = [checked_approach(limit, one, width) for one in each]
            samples = np.repeat(np.arange(len(rows)), [len(room) for _, room in found])
            rates, room = (np.concatenate(part) for part in zip(*found))
        rows = rows[samples]
        rates = self._in_columns(rates[:, np.newaxis], view.columns[rows])[:, 0]
        return _Approached(rows, rates, room, weights)

    def _zero_moment_points(
        self, view: View, rows: np.ndarray, floor: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Compute the zero-moment points on a floor of a height in [m].

        Returns:
            In the world, in [m], shape (n, 2), and how far they are moved by an
            acceleration of the centre of mass, in [s^2], shape (n,).
        """
        columns, rates, changes = (
            view.columns[rows],
            *(one[rows] @ view.control for one in self._rates),
        )
        turning = _left_jacobian(columns[:, 3:6])
        for part in (rates, changes):
            part[:, 3:6] = (turning @ part[:, 3:6, np.newaxis])[..., 0]
        motion = RobotMotion(
            view.roots[rows],
            columns[:, 6:],
            rates[:, :6],
            rates[:, 6:],
            changes[:, :6],
            changes[:, 6:],
        )
        found = inverse_dynamics(self._solver.kinematics, self._solver.masses, motion)
        force, moment = np.split(found.root_wrench, 2, axis=1)
        upward = np.maximum(force[:, 2:], 1e-3 * GRAVITY * self._solver.masses.total)
        places = np.stack([-moment[:, 1], moment[:, 0]], axis=1)
        places = (places + floor * force[:, :2]) / upward
        return places, (found.center_of_mass[:, 2] - floor) / GRAVITY

    def _in_columns(self, rates: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Turn rates by the root's twist, shape (n, m, n_columns), into ours."""
        found = self._moves * rates
        found[..., 3:6] = found[..., 3:6] @ _left_jacobian(columns[:, 3:6])
        return found

    # --- search ---

    def solve(self) -> Found:
        """Search from the nearest configuration, and from another one if that misses.

        Of the others that is improved which promises most.
        """
        start, given = self._problem.start, self._problem.constraints
        tasks = [task.at(0) for task in self._problem.tasks]
        first, _ = last(search(self._solver, start, tasks, given, start.position))
        best = self.improved(self._state(self.guess(first.configuration)))
        if best.badness <= 1.0:
            return best
        others = [self._state(self.guess(one)) for one in self._others(first)]
        if others:
            promising = min(others, key=attrgetter("cost"))
            best = min(best, self.improved(promising), key=attrgetter("cost"))
        return best

    def _others(self, first: Linearization) -> Iterator[Configuration]:
        """Search configurations for the first sample that differ from one."""
        start, random = self._problem.start, np.random.default_rng(0)
        given, position = first.bounds, first.configuration.position
        for _ in range(TRIES):
            drawn = start.position + random.uniform(-SPREAD, SPREAD, len(position))
            begin = start._replace(position=np.clip(drawn, given.lower, given.upper))
            view = self._solver.view(begin, first.tasks, given)
            found, _ = last(descend(self._solver, view, start.position))
            apart = np.abs(found.configuration.position - position).max()
            if apart > DIFFERENT and found.badness <= max(1.0, first.badness):
                yield found.configuration

    def guess(self, first: Configuration) -> np.ndarray:
        """Search configurations one after the other; return control points.

        Args:
            first: That of the first sample.
        """
        problem, now = self._problem, first
        # Targets may be out of reach: then links that stay must not follow them.
        tasks = [
            task._replace(weights=np.minimum(task.weights, 1.0))
            if task.weights.max() < HARD
            else task
            for task in problem.tasks
        ]
        rows = self._rows(GUESS_PERIOD)
        found = [now]
        for row, duration in zip(rows[1:], np.diff(problem.times[rows])):
            reach = self._fastest[6:] * duration
            bounds = replace(
                problem.constraints,
                lower=np.maximum(problem.constraints.lower, now.position - reach),
                upper=np.minimum(problem.constraints.upper, now.position + reach),
            )
            view = self._solver.view(now, [task.at(row) for task in tasks], bounds)
            posture = problem.start.position
            now = last(descend(self._solver, view, posture, GUESS_STEPS))[
                0
            ].configuration
            found.append(now)
        roots = np.array([one.root for one in found])
        turns = to_rotation_vector(multiply(roots[:, 3:], conjugate(self._reference)))
        for before, turn in zip(turns, turns[1:]):
            angle = float(np.linalg.norm(turn))
            other = turn * (1.0 - 2.0 * np.pi / max(angle, 1e-9))
            if np.linalg.norm(other - before) < np.linalg.norm(turn - before):
                turn[:] = other  # the same rotation, beyond half a turn
        parts = roots[:, :3], turns, [one.position for one in found]
        columns = np.concatenate(parts, axis=1)
        begin = problem.times[0]
        centers = begin + self._period * (np.arange(self._count) - 1)
        each = [np.interp(centers, problem.times[rows], column) for column in columns.T]
        return self._smoothed(np.stack(each, axis=1))

    def _smoothed(self, control: np.ndarray) -> np.ndarray:
        """Average control points with their neighbours until they are within bounds.

        Otherwise bounds would pull first, and throw everything else over.
        """
        bounds = self._soft_bounds()[1:]
        for _ in range(MAX_SMOOTHINGS):
            if not any(excess(one, one.values(control)).any() for one in bounds):
                break
            padded = np.pad(control, ((1, 1), (0, 0)), mode="edge")
            control = 0.25 * padded[:-2] + 0.5 * control + 0.25 * padded[2:]
        return control

    def improved(self, state: Found) -> Found:
        """Improve control points step by step, until that does not help."""
        largest = LARGEST_STEP
        for number in range(1, MAX_STEPS + 1):
            step = self._step(state, largest)
            after = self._state(state.view.control + step)
            if after.cost >= state.cost:
                largest = SHORTER * min(largest, float(np.abs(step).max()))
                if largest < LEAST_STEP:
                    break
                continue
            is_little = after.cost > (1.0 - LEAST_GAIN) * state.cost
            after = after._replace(steps=number)
            state, largest = after, min(largest / SHORTER, LARGEST_STEP)
            if state.badness < FINE or is_little:
                break
        return state

    def _state(self, control: np.ndarray) -> Found:
        """Compute the cost of control points, and what a step needs."""
        view = self.view(control)
        factors = self._factors(view)
        squares = (self._weights * view.displacements) ** 2 * factors
        # Half as steep as a square, from FAR on.
        cost = self._share * float((squares * (2.0 - factors)).sum())
        rows = []
        for limit in self._problem.constraints.limits:
            near = self._approach(limit, view, self._limited)
            cost += HARD**2 * float((np.minimum(near.room, 0.0) ** 2).sum())
            if len(near.room):
                seen, which = np.unique(near.rows, return_inverse=True)
                seen = near.weights[seen]
                rows.append(Rows(seen, which, near.rates, near.room, HARD**2))
        for each in self._soft_bounds():
            squares = excess(each, each.values(control)) ** 2
            cost += each.weight * float(squares.sum())
        regular = self._regular()
        pulled = control - self._posture()
        cost += float((pulled * regular.product(pulled)).sum())
        beyond = max([0.0, *(float(-row.upper.min(initial=0.0)) for row in rows)])
        errors = errors_of(view.displacements) / TOLERANCE
        badness = max(float(errors.max(initial=0.0)), beyond / TOLERANCE[0])
        return Found(view, rows, regular, cost, badness)

    def at_bounds(self, found: Found, row: int) -> list[tuple[int, int]]:
        """Find what is at its bounds around a sample.

        Returns:
            Pairs of an order, from 0 of positions to 2 of accelerations, and a column.
        """
        seen, reached = self._basis[row].indices, []
        for each in self._soft_bounds():
            values = each.values(found.view.control)[
                seen[0] : seen[-1] + 1 - each.order
            ]
            room = np.minimum(each.upper - values, values - each.lower)[...]
            near = AT_BOUND * np.minimum(each.upper - each.lower, 1.0)
            columns = np.flatnonzero((room < near).any(axis=0) & (self._moves > 0.0))
            reached += [(each.order, column) for column in columns.tolist()]
        return reached

    def linearizations(self, found: Found) -> list[Linearization]:
        """Compare each sample with its tasks and limits, without rates."""
        view, given = found.view, self._problem.constraints
        every = np.arange(len(view.roots))
        parts = []
        for limit in given.limits:
            near = self._approach(limit, view, every)
            ends = np.searchsorted(near.rows, np.append(every, len(every)))
            parts.append([near.room[a:b] for a, b in zip(ends, ends[1:])])
        none = np.zeros((0, 0))
        return [
            Linearization(
                Configuration(view.roots[row], view.columns[row, 6:]),
                [task.at(row) for task in self._problem.tasks],
                given,
                view.jacobians,
                view.points[row],
                view.displacements[row],
                [(none, part[row]) for part in parts],
            )
            for row in every.tolist()
        ]

    def _factors(self, view: View) -> np.ndarray:
        """Weaken errors that are large, so that they pull with a constant force.

        Source: Huber, Annals of Mathematical Statistics 35, 1964.

        Returns:
            Factors of their squares, shape (n, n_rows).
        """
        errors = np.maximum(errors_of(view.displacements), FAR)
        return np.repeat((FAR / errors).reshape(len(errors), -1), 3, axis=1)

    def _soft_bounds(self) -> list[Bounds]:
        """Return the bounds of control points and their differences."""
        given, free = self._problem.constraints, np.full(6, np.inf)
        low, high = np.append(-free, given.lower), np.append(free, given.upper)
        fastest = self._period * self._fastest
        quickest = self._period**2 * self._quickest
        return [
            Bounds(0, low, high, BOUND_WEIGHT),
            Bounds(1, -fastest, fastest, BOUND_WEIGHT),
            Bounds(2, -quickest, quickest, BOUND_WEIGHT),
        ]

    def _posture(self) -> np.ndarray:
        """Return the columns to prefer."""
        start = self._problem.start
        return np.concatenate([start.root[:3], np.zeros(3), start.position])

    def _regular(self) -> Quadratic:
        """Return the cost of accelerations and of other postures."""
        width = len(self._moves)
        found = Quadratic(self._count, width)
        posture = np.append(np.zeros(6), np.full(width - 6, POSTURE**2))
        found.add_differences(0, np.tile(posture, (self._count, 1)))
        smooth = np.full((self._count - 2, width), SMOOTHNESS / self._period**4)
        found.add_differences(2, smooth)
        return found

    def _step(self, state: Found, largest: float) -> np.ndarray:
        """Minimize the linearized cost; return the change of control points."""
        view, control = state.view, state.view.control
        matrix = matrix_of(self._problem.tasks, view.jacobians, view.points)
        weights = self._weights * np.sqrt(self._factors(view))
        matrix = self._in_columns(weights[..., np.newaxis] * matrix, view.columns)
        turned = np.swapaxes(matrix, 1, 2)
        desired = (weights * view.displacements)[..., np.newaxis]
        quadratic = Quadratic(*control.shape)
        quadratic.add_samples(self._basis, self._share * (turned @ matrix))
        quadratic.blocks += state.regular.blocks
        quadratic.add_differences(0, np.full(control.shape, DAMPING))
        pulls = (turned @ desired)[..., 0]
        quadratic.gradient[:] = -self._share * (self._basis.T @ pulls)
        quadratic.gradient += state.regular.product(control - self._posture())
        moved = [
            replace(each, lower=each.lower - now, upper=each.upper - now)
            for each in self._soft_bounds()
            for now in [each.values(control)]
        ]
        moved[0] = replace(
            moved[0],
            lower=np.clip(moved[0].lower, -largest, 0.0),
            upper=np.clip(moved[0].upper, 0.0, largest),
        )
        return self._moves * minimized(quadratic, [*moved, *state.rows])


def _left_jacobian(vectors: np.ndarray) -> np.ndarray:
    """Compute what turns rates of rotation vectors into angular velocities.

    Args:
        vectors: Shape (n, 3), in [rad].

    Returns:
        Shape (n, 3, 3). Source: Barfoot, State Estimation for Robotics, 2017, 7.77.
    """
    angle = np.maximum(np.linalg.norm(vectors, axis=-1), 1e-6)[
        :, np.newaxis, np.newaxis
    ]
    cross = np.cross(np.eye(3), vectors[:, np.newaxis])
    first = (1.0 - np.cos(angle)) / angle**2
    second = (angle - np.sin(angle)) / angle**3
    return np.eye(3) + first * cross + second * (cross @ cross)
