"""Trajectories in which links follow targets: smooth, within bounds, found as a whole.

Base and joints are cubic splines. Each step of a sequence minimizes the linearized
errors of all samples, with bounds of velocities and accelerations, balance, floor and
distances as soft limits that are much stronger than targets. Source: Nocedal and
Wright, Numerical Optimization, 2006, chapters 10 and 18.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np

from g1_description.errors import InvalidValueError
from g1_description.ik.limits import BatchLimit, Course
from g1_description.ik.sampled import (
    PERIOD,
    Problem,
    SampledSplines,
    SampledView,
    left_jacobian,
    steady_acceleration,
)
from g1_description.ik.solver import (
    HARD,
    POSTURE,
    TOLERANCE,
    Configuration,
    IkSolver,
    Linearization,
    descend,
    last,
    search,
)
from g1_description.ik.splines import ControlBounds, Quadratic, Rows, excess, minimized
from g1_description.ik.tasks import errors_of, factors_of, matrix_of, weights_of
from g1_description.robot.rotation import conjugate, multiply, to_rotation_vector

GUESS_PERIOD = 0.3
"""Time between the configurations that are searched first, in [s]."""

GUESS_STEPS = 5
"""Most steps of these searches."""

MAX_SMOOTHINGS = 1000
"""Most averages of a first guess."""

AT_BOUND = 0.01
"""Distance from a bound, as a share of the range, at which something is there."""

SINGULAR = 0.1
"""Relative singular value up to which turns do not follow rotation vectors."""

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

LONGER = 1.5
"""Factor after a step that helps."""

LEAST_STEP = 1e-3
"""Largest change, in [rad] or [m], at which steps end."""

LARGEST_STEP = 0.1
"""Change of a control point in a step, in [rad] or [m]."""

MAX_STEPS, ALL_STEPS, LAST_STEPS = 15, 18, 5
"""Most steps of a search, of all searches but for the last one, and of this one, as of
repeats where targets are out of reach."""

TRIES = 3
"""Random starts at which other configurations for the first sample are searched."""

PROMISING = 0.5
"""Cost of another guess, relative to the first one, up to which it is improved."""

SPREAD = 1.0
"""Largest distance of these from the start, in [rad] or [m]."""

DIFFERENT = 0.3
"""Difference in a joint from which on a configuration is another one, likewise."""

REPEATS = 4
"""Most repeats with limits where they were exceeded. The last one begins within them;
if that does not help, one more begins at rest, and the better one is taken."""

DEEP = 5e-3
"""Excess over a limit that makes the last repeat necessary, in [m]."""

NEARER = (0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1)
"""Shares of a trajectory, to standing still, with which the last repeat may begin."""

FINE = 0.3
"""Fraction of the tolerance at which steps end."""

LEAST_GAIN = 0.03
"""Relative decrease of the cost at which steps end."""


class Candidate(NamedTuple):
    """A trajectory with its limits and cost."""

    view: SampledView
    bounds: list[ControlBounds]
    rows: list[Rows]
    """Limits at some samples."""

    cost: float
    badness: float
    """Largest error as a multiple of the tolerance."""

    steps: int = 0
    """Number of steps."""


class Trajectory:
    """The search of one trajectory."""

    def __init__(self, solver: IkSolver, problem: Problem) -> None:
        """Prepare it."""
        self._solver, self._problem = solver, problem
        self._splines = SampledSplines(solver, problem)
        self._share = self._splines.count / len(problem.times)
        self._weights = weights_of(problem.tasks)
        changes = [
            limit.changes
            for limit in problem.constraints.limits
            if isinstance(limit, BatchLimit)
        ]
        rows = [self._splines.rows(PERIOD), *changes]
        self._limited = np.unique(np.concatenate(rows))
        start = problem.start
        self._posture = np.concatenate([start.root[:3], np.zeros(3), start.position])
        self._still = np.tile(self._posture, (self._splines.count, 1))
        self._reach = SHARE * problem.speeds
        self._regular = self._regular_cost()
        self._steps_left = ALL_STEPS

    def _bounds(self, control: np.ndarray) -> list[ControlBounds]:
        """Bound control points and their differences of both orders.

        Rotation vectors change so little that turns about the axes are within bounds.
        """
        limits, given = self._problem.constraints, self._problem.bounds
        period, free = self._splines.period, np.full(6, np.inf)
        low, high = np.append(-free, limits.lower), np.append(free, limits.upper)
        joints = np.full(len(self._reach), given.joint_acceleration)
        fastest = np.append(np.full(6, given.base_speed), self._problem.speeds)
        fastest = np.tile(fastest, (len(control) - 1, 1))
        quickest = np.append(np.full(6, given.base_acceleration), joints)
        quickest = np.tile(quickest, (len(control) - 2, 1))
        turns = control[:, 3:6]
        turning = left_jacobian(turns) * self._splines.moves[3:6]
        largest = np.abs(turning).sum(axis=-1).max(axis=-1, keepdims=True)
        largest = np.maximum(largest, 1.0)
        fastest[:, 3:6] = given.base_turn_rate / np.maximum(largest[1:], largest[:-1])
        quickest[:, 3:6] = given.base_turn_acceleration / largest[1:-1]
        middles = np.zeros(quickest.shape)
        steady = steady_acceleration(turns[1:-1], (turns[2:] - turns[:-2]) / 2.0)
        undone = np.linalg.pinv(turning[1:-1], SINGULAR) @ steady[..., np.newaxis]
        middles[:, 3:6] = -undone[..., 0]
        steps, changes = SHARE * period * fastest, SHARE * period**2 * quickest
        return [
            ControlBounds(0, low, high, BOUND_WEIGHT),
            ControlBounds(1, -steps, steps, BOUND_WEIGHT),
            ControlBounds(2, middles - changes, middles + changes, BOUND_WEIGHT),
        ]

    def solve(self) -> tuple[Candidate, list[Linearization]]:
        """Search a trajectory; limits count at some samples, then around excesses, too.

        Bounds of turns are then those of the rotations that were found.

        Returns:
            The trajectory, and each sample of it without rates.
        """
        times, found = self._problem.times, self._best()
        periods = np.floor((times - times[0]) / PERIOD)
        if found.badness > 1.0:
            self._steps_left = min(self._steps_left, LAST_STEPS)
        begins: list[np.ndarray] | None = None
        for repeat in range(REPEATS + 2):
            samples = self._linearizations(found)
            excesses = np.array([sample.excesses for sample in samples])
            is_late = repeat >= REPEATS - 1 or not self._steps_left
            least = DEEP if is_late else TOLERANCE[0]
            beyond = np.flatnonzero((excesses > least).any(axis=1))
            is_within = not len(beyond) and not self._splines.turns_too_fast(found.view)
            if is_within or begins == []:
                break
            near = np.flatnonzero(np.isin(periods, periods[beyond]))
            begin, before, is_again = found.view.control, found, begins is not None
            if is_late:
                self._steps_left = LAST_STEPS
                if begins is None:
                    begins = [self._still, self._within(begin)] if len(beyond) else []
                if begins:
                    near, begin = self._splines.rows(0.5 * PERIOD), begins.pop()
            self._limited = np.union1d(self._limited, near)
            found = self.improved(self._state(begin))
            if is_again:
                self._limited = np.arange(len(times))
                costs = [self._state(one.view.control).cost for one in (before, found)]
                found = before if costs[0] < costs[1] else found
        return found, samples

    def _within(self, control: np.ndarray) -> np.ndarray:
        """Move control points towards standing still, until limits are kept."""
        for share in NEARER:
            moved = self._still + share * (control - self._still)
            samples = self._linearizations(self._state(moved))
            if max(max(sample.excesses, default=0.0) for sample in samples) < DEEP:
                return moved
        return self._still

    def _best(self) -> Candidate:
        """Search from the nearest configuration, and from another one if that misses.

        The one that promises most is improved, and standing still, where better.
        """
        start = self._problem.start
        given = self._problem.constraints.at(0, self._course([start]))
        tasks = [task.at(0) for task in self._problem.tasks]
        first, _ = last(search(self._solver, start, tasks, given, start.position))
        guess = self._state(self.guess(first.configuration))
        best = self.improved(guess)
        if best.badness <= 1.0:
            return best
        others = [self._state(self.guess(one)) for one in self._others(first)]
        promising = min([guess, *others], key=attrgetter("cost"))
        if promising.cost < PROMISING * guess.cost:
            best = min(best, self.improved(promising), key=attrgetter("cost"))
        still = self._state(self._still)
        return self.improved(still) if still.cost < best.cost else best

    def _others(self, first: Linearization) -> Iterator[Configuration]:
        """Search configurations for the first sample that differ from one."""
        start, random = self._problem.start, np.random.default_rng(0)
        given, position = first.bounds, first.configuration.position
        for _ in range(TRIES):
            drawn = start.position + random.uniform(-SPREAD, SPREAD, len(position))
            begin = start._replace(position=np.clip(drawn, given.lower, given.upper))
            view = self._solver.view(begin, first.tasks, given)
            found, _ = last(descend(self._solver, view, start.position))
            apart = np.abs(found.configuration.position - position).max(initial=0.0)
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
        rows = self._splines.rows(GUESS_PERIOD)
        found = [now]
        for row, duration in zip(rows[1:], np.diff(problem.times[rows])):
            reach = self._reach * duration
            bounds = replace(
                problem.constraints.at(row, self._course(found, rows)),
                lower=np.maximum(problem.constraints.lower, now.position - reach),
                upper=np.minimum(problem.constraints.upper, now.position + reach),
            )
            view = self._solver.view(now, [task.at(row) for task in tasks], bounds)
            posture = problem.start.position
            best, _ = last(descend(self._solver, view, posture, GUESS_STEPS))
            now = best.configuration
            found.append(now)
        roots = np.array([one.root for one in found])
        turns = to_rotation_vector(
            multiply(roots[:, 3:], conjugate(problem.start.root[3:]))
        )
        for before, turn in zip(turns, turns[1:]):
            angle = float(np.linalg.norm(turn))
            other = turn * (1.0 - 2.0 * np.pi / max(angle, 1e-9))
            if np.linalg.norm(other - before) < np.linalg.norm(turn - before):
                turn[:] = other  # the same rotation, beyond half a turn
            if np.linalg.norm(turn - before) > np.pi:  # such vectors end there
                raise InvalidValueError(
                    "The base turns by more than 360 degrees from its start: split the "
                    "trajectory, or give smooth=False."
                )
        parts = roots[:, :3], turns, [one.position for one in found]
        columns = np.concatenate(parts, axis=1)
        centers = self._splines.centers
        each = [np.interp(centers, problem.times[rows], column) for column in columns.T]
        return self._smoothed(np.stack(each, axis=1))

    def _course(self, found: Sequence[Configuration], rows: Any = (0,)) -> Course:
        """Return the course of the first configurations of samples by their rows."""
        roots, positions = (np.array(part) for part in zip(*found))
        poses = self._solver.kinematics.link_poses(roots, positions)
        return Course(self._problem.times[[*rows[: len(found)]]], poses)

    def _smoothed(self, control: np.ndarray) -> np.ndarray:
        """Average control points with their neighbours until they are within bounds.

        Otherwise bounds would pull first, and throw everything else over.
        """
        bounds = self._bounds(np.zeros(control.shape))[1:]
        for _ in range(MAX_SMOOTHINGS):
            if not any(excess(one, one.values(control)).any() for one in bounds):
                break
            padded = np.pad(control, ((1, 1), (0, 0)), mode="edge")
            control = 0.25 * padded[:-2] + 0.5 * control + 0.25 * padded[2:]
        return control

    def improved(self, state: Candidate) -> Candidate:
        """Improve control points step by step, until that does not help."""
        largest = LARGEST_STEP
        for number in range(1, min(MAX_STEPS, self._steps_left) + 1):
            self._steps_left -= 1
            step = self._step(state, largest)
            after = self._state(state.view.control + step, state.bounds)
            if after.cost >= state.cost:
                largest = SHORTER * min(largest, float(np.abs(step).max()))
                if largest < LEAST_STEP:
                    break
                continue
            is_little = after.cost > (1.0 - LEAST_GAIN) * state.cost
            after = after._replace(steps=number)
            state, largest = after, min(LONGER * largest, LARGEST_STEP)
            if state.badness < FINE or is_little:
                break
        return state

    def _state(
        self, control: np.ndarray, bounds: list[ControlBounds] | None = None
    ) -> Candidate:
        """Compute the cost of control points, and what a step needs.

        Args:
            control: The control points.
            bounds: Theirs; None: those of rotations that stay as they are.
        """
        view = self._splines.view(control)
        factors = factors_of(view.displacements)
        squares = (self._weights * view.displacements) ** 2 * factors
        # Half as steep as a square, from FAR on.
        cost = self._share * float((squares * (2.0 - factors)).sum())
        rows = []
        for limit in self._problem.constraints.limits:
            near = self._splines.approach(limit, view, self._limited)
            cost += HARD**2 * float((np.minimum(near.room, 0.0) ** 2).sum())
            if len(near.room):
                seen, which = np.unique(near.rows, return_inverse=True)
                seen = near.weights[seen]
                rows.append(Rows(seen, which, near.rates, near.room, HARD**2))
        bounds = bounds or self._bounds(control)
        for each in bounds:
            squares = excess(each, each.values(control)) ** 2
            cost += each.weight * float(squares.sum())
        pulled = control - self._posture
        cost += float((pulled * self._regular.product(pulled)).sum())
        beyond = max([0.0, *(float(-row.upper.min(initial=0.0)) for row in rows)])
        errors = errors_of(view.displacements) / TOLERANCE
        badness = max(float(errors.max(initial=0.0)), beyond / TOLERANCE[0])
        return Candidate(view, bounds, rows, cost, badness)

    def at_bounds(self, found: Candidate, rows: np.ndarray) -> list[tuple[int, int]]:
        """Find what is at its bounds around successive samples.

        Returns:
            Pairs of an order, from 0 of positions to 2 of accelerations, and a column.
        """
        seen, reached = self._splines.weights[rows].indices, []
        for each in found.bounds:
            values = each.values(found.view.control)
            room = np.minimum(each.upper - values, values - each.lower)
            is_near = room < AT_BOUND * np.minimum(each.upper - each.lower, 1.0)
            is_near = is_near[seen.min() : seen.max() + 1 - each.order].any(axis=0)
            columns = np.flatnonzero(is_near & (self._splines.moves > 0.0))
            reached += [(each.order, column) for column in columns.tolist()]
        return reached

    def _linearizations(self, found: Candidate) -> list[Linearization]:
        """Compare each sample with its tasks and limits, without rates."""
        view, given = found.view, self._problem.constraints
        every = np.arange(len(view.roots))
        course = self._splines.course(view)
        parts = []
        for limit in given.limits:
            near = self._splines.approach(limit, view, every)
            ends = np.searchsorted(near.rows, np.append(every, len(every)))
            parts.append([near.room[a:b] for a, b in zip(ends, ends[1:])])
        none = np.zeros((0, 0))
        # Limits are soft: joints may be beyond theirs by 1e-5 rad.
        positions = np.clip(view.columns[:, 6:], given.lower, given.upper)
        return [
            Linearization(
                Configuration(view.roots[row], positions[row]),
                [task.at(row) for task in self._problem.tasks],
                given.at(row, course),
                view.jacobians,
                view.points[row],
                view.displacements[row],
                [(none, part[row]) for part in parts],
            )
            for row in every.tolist()
        ]

    def _regular_cost(self) -> Quadratic:
        """Return the cost of accelerations and of other postures."""
        width = len(self._splines.moves)
        found = Quadratic(self._splines.count, width)
        posture = np.append(np.zeros(6), np.full(width - 6, POSTURE**2))
        found.add_differences(0, np.tile(posture, (self._splines.count, 1)))
        smooth = np.full(
            (self._splines.count - 2, width), SMOOTHNESS / self._splines.period**4
        )
        found.add_differences(2, smooth)
        return found

    def _step(self, state: Candidate, largest: float) -> np.ndarray:
        """Minimize the linearized cost; return the change of control points."""
        view, control = state.view, state.view.control
        matrix = matrix_of(self._problem.tasks, view.jacobians, view.points)
        weights = self._weights * np.sqrt(factors_of(view.displacements))
        matrix = self._splines.in_columns(
            weights[..., np.newaxis] * matrix, view.columns
        )
        turned = np.swapaxes(matrix, 1, 2)
        desired = (weights * view.displacements)[..., np.newaxis]
        quadratic = Quadratic(*control.shape)
        squares = self._share * (turned @ matrix)
        quadratic.add_samples(self._splines.products, squares)
        quadratic.blocks += self._regular.blocks
        quadratic.add_differences(0, np.full(control.shape, DAMPING))
        pulls = (turned @ desired)[..., 0]
        quadratic.gradient[:] = -self._share * (self._splines.weights.T @ pulls)
        quadratic.gradient += self._regular.product(control - self._posture)
        moved = [
            replace(each, lower=each.lower - now, upper=each.upper - now)
            for each in state.bounds
            for now in [each.values(control)]
        ]
        moved[0] = replace(
            moved[0],
            lower=np.clip(moved[0].lower, -largest, 0.0),
            upper=np.clip(moved[0].upper, 0.0, largest),
        )
        return self._splines.moves * minimized(quadratic, [*moved, *state.rows])
