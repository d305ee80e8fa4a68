"""Whole-body inverse kinematics: steps until nothing improves, from many starts.

Each step is a small quadratic program. The velocities of root and joints that a step
takes minimize the squared errors of tasks, weighted, with limits of joints, balance and
distances as bounds. Sources: Nakamura and Hanafusa, J. Dyn. Sys. Meas. Control, 1986
(damping); Sugihara, IEEE Trans. Robotics, 2011 (damping by the error); Kanoun et al.,
IEEE Trans. Robotics, 2011 (inequalities).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from operator import attrgetter
from typing import NamedTuple, Tuple, TypeVar

import daqp
import numpy as np

from g1_description.ik.limits import (
    Approach,
    BatchLimit,
    Course,
    Limit,
    checked_approach,
)
from g1_description.ik.tasks import (
    LinkTask,
    displaced,
    errors_of,
    matrix_of,
    weights_of,
)
from g1_description.robot.description import Description
from g1_description.robot.dynamics import Masses
from g1_description.robot.jacobians import Jacobians
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.rotation import from_rotation_vector, multiply, normalized

TOLERANCE = np.array([1e-3, np.radians(0.5)])
"""Errors of a task that is reached, in [m] and [rad]."""

HARD = 100.0
"""Weight of tasks that others disturb by a ten-thousandth of their errors at most."""

LARGEST_STEP = 0.3
"""Change of a joint or the root in a step, in [rad] or [m]."""

LEAST_DAMPING = 1e-5
"""Damping of all steps: where tasks leave a choice, they are too short to overshoot."""

POSTURE = 3e-4
"""Weight of the posture, against weights of tasks."""

UNBOUNDED = 1e30
"""Infinity, for the solver."""

SOFT = 8
"""Mark of the solver for constraints that are kept as far as others allow."""

FINE = 0.1
"""Fraction of the tolerance at which a search ends."""

DAMPING = 1e-3
"""Damping of a step, relative to the cost."""

PROGRESS = 0.999
"""Cost after a step, relative to the best one, from which on it is no progress."""

PATIENCE = 12
"""Steps without progress after which the search from one start ends."""

MAX_STEPS = 100
"""Most steps from one start."""

STARTS = 16
"""Number of starts: the given one, then random ones, farther from it each time."""


class Configuration(NamedTuple):
    """Where a robot is."""

    root: np.ndarray
    """Pose of the root link in the world, shape (7,)."""

    position: np.ndarray
    """Positions of movable joints in [rad] or [m], shape (n_joints,)."""


@dataclass(frozen=True, eq=False)
class IkConstraints:
    """Constraints on a configuration."""

    lower: np.ndarray
    """Lower limits of joints, shape (n_joints,)."""

    upper: np.ndarray
    """Upper limits of joints, shape (n_joints,)."""

    base: np.ndarray
    """1 where the root may move along and turn about the world's axes, shape (6,)."""

    limits: Sequence[Limit]
    """Distances to keep, such as that of the centre of mass from an edge."""

    largest_step: float = LARGEST_STEP
    """Largest change of a joint or the root in a step, in [rad] or [m]."""

    def at(self, row: int, course: Course) -> IkConstraints:
        """Return the constraints on one configuration of a motion."""
        limits = [
            one.at(np.array([row]), course) if isinstance(one, BatchLimit) else one
            for one in self.limits
        ]
        return replace(self, limits=limits)


@dataclass(frozen=True, eq=False)
class Linearization:
    """A configuration with its errors, and how they change with its velocities."""

    configuration: Configuration
    tasks: Sequence[LinkTask]
    bounds: IkConstraints
    jacobians: Jacobians

    points: np.ndarray
    """Points of tasks in the world, in [m], shape (n_tasks, 3)."""

    displacements: np.ndarray
    """By how much the links of tasks must move and turn along the world's axes, in [m]
    and [rad], shape (n_rows,); 0 where free."""

    approaches: Sequence[Approach]
    """Rates and room of each limit."""

    is_stuck: bool = False
    """Whether the solver found no step from here."""

    @property
    def errors(self) -> np.ndarray:
        """Distances from the tasks, in [m] and [rad], shape (n_tasks, 2)."""
        return errors_of(self.displacements)

    @cached_property
    def excesses(self) -> list[float]:
        """By how much each limit is exceeded, in [m]."""
        return [float(-room.min(initial=0.0)) for _, room in self.approaches]

    @property
    def cost(self) -> float:
        """Sum of squared errors, which steps reduce."""
        squares = (weights_of(self.tasks) * self.displacements) ** 2
        excess = sum(one**2 for one in self.excesses)
        return float(squares.sum()) + HARD**2 * excess

    @property
    def badness(self) -> float:
        """Largest error as a multiple of the tolerance; 1 or less: all is reached."""
        beyond = max(self.excesses, default=0.0) / TOLERANCE[0]
        return max(float((self.errors / TOLERANCE).max(initial=0.0)), beyond)


Found = Tuple[Linearization, int]
"""The best configuration so far, and the number of steps."""

Item = TypeVar("Item")


class IkSolver:
    """Steps of a robot with one tree towards tasks."""

    def __init__(self, description: Description) -> None:
        """Prepare a robot."""
        self.kinematics = Kinematics(description)
        self.masses = Masses(description)

    def view(
        self, now: Configuration, tasks: Sequence[LinkTask], bounds: IkConstraints
    ) -> Linearization:
        """Compare a configuration with tasks and bounds."""
        jacobians = Jacobians(self.kinematics, *now)
        points, displacements = displaced(tasks, jacobians)
        approaches = [
            checked_approach(limit, jacobians, 6 + len(now.position))
            for limit in bounds.limits
        ]
        return Linearization(
            now, tasks, bounds, jacobians, points, displacements, approaches
        )

    def step(
        self, view: Linearization, posture: np.ndarray, damping: float
    ) -> Configuration | None:
        """Make a step towards the tasks of a view.

        Args:
            view: The present configuration, inside the limits of joints.
            posture: Positions to prefer where tasks leave a choice, shape (n_joints,).
            damping: Damping; large: a small one along the gradient of the cost.

        Returns:
            The next configuration, inside the limits of joints; None if the solver
            finds none, as numbers of very different sizes exceed its precision.
        """
        now, bounds, tasks = view.configuration, view.bounds, view.tasks
        weights = weights_of(tasks)
        desired = weights * view.displacements
        matrix = matrix_of(tasks, view.jacobians, view.points)
        matrix *= weights[:, np.newaxis]
        hessian, gradient = matrix.T @ matrix, -matrix.T @ desired
        every = np.arange(len(gradient))
        joints = every[6:]
        gradient[6:] -= POSTURE**2 * (posture - now.position)
        hessian[joints, joints] += POSTURE**2
        hessian[every, every] += damping + LEAST_DAMPING
        root = bounds.largest_step * bounds.base
        lower = np.maximum(bounds.lower - now.position, -bounds.largest_step)
        upper = np.minimum(bounds.upper - now.position, bounds.largest_step)
        approaches = [(np.zeros((0, len(gradient))), np.zeros(0)), *view.approaches]
        rates, room = (np.concatenate(part) for part in zip(*approaches))
        least = np.full(len(room), -UNBOUNDED)
        sense = np.zeros(len(gradient) + len(least), dtype=np.int32)
        sense[len(gradient) :] = SOFT
        step, _, flag, _ = daqp.solve(
            hessian,
            gradient,
            rates,
            np.concatenate([root, upper, room]),
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


def search(
    solver: IkSolver,
    start: Configuration,
    tasks: Sequence[LinkTask],
    bounds: IkConstraints,
    posture: np.ndarray,
    starts: int = STARTS,
) -> Iterator[Found]:
    """Search a configuration that reaches tasks.

    Args:
        solver: Solver of the robot.
        start: Where the search begins, inside the limits of joints.
        tasks: The tasks.
        bounds: Constraints on the configuration.
        posture: Positions to prefer where tasks leave a choice, shape (n_joints,).
        starts: Most starts; 1: only the given one.

    Yields:
        After each step, the best configuration so far; at last the first one within the
        tolerance, or else the best one.
    """
    for best, steps in descend(solver, solver.view(start, tasks, bounds), posture):
        yield best, steps
    random = np.random.default_rng(0)  # the same starts each time
    lower = np.maximum(bounds.lower, start.position - np.pi)
    upper = np.minimum(bounds.upper, start.position + np.pi)
    for number in range(1, starts):
        if best.badness <= 1.0:
            return
        spread = min(1.0, 2.0 * number / (starts - 1))
        drawn = spread * (random.uniform(lower, upper) - start.position)
        begin = Configuration(start.root, start.position + drawn)
        view = solver.view(begin, tasks, bounds)
        for found, more in descend(solver, view, posture):
            yield min(best, found, key=attrgetter("cost")), steps + more
        best, steps = min(best, found, key=attrgetter("cost")), steps + more
    if best.badness > 1.0:
        for settled, more in _settle(solver, best, posture):
            yield settled, steps + more


def last(items: Iterable[Item]) -> Item:
    """Return the last item; there is one."""
    return deque(items, maxlen=1).pop()


def descend(
    solver: IkSolver, view: Linearization, posture: np.ndarray, most: int = MAX_STEPS
) -> Iterator[Found]:
    """Step from one configuration until nothing improves.

    The cost may rise for some steps: fixed links move on an arc at first.

    Args:
        solver: Solver of the robot.
        view: View of the configuration.
        posture: As for ``search``.
        most: Most steps.

    Yields:
        At the beginning and after each step, the best configuration so far, and the
        number of steps.
    """
    best, steps, since = view, 0, 0
    yield best, steps
    while best.badness > FINE and since < PATIENCE and steps < most:
        now = solver.step(view, posture, DAMPING * view.cost)
        if now is None:
            yield replace(best, is_stuck=True), steps
            return
        view, steps = solver.view(now, view.tasks, view.bounds), steps + 1
        since = 0 if view.cost < PROGRESS * best.cost else since + 1
        best = min(best, view, key=attrgetter("cost"))
        yield best, steps


def _settle(
    solver: IkSolver, view: Linearization, posture: np.ndarray
) -> Iterator[Found]:
    """Step down to the least cost, where targets cannot be reached."""
    damping, steps = DAMPING * view.cost, 0
    while damping < view.cost and steps < MAX_STEPS:
        now = solver.step(view, posture, damping)
        if now is None:
            yield replace(view, is_stuck=True), steps
            return
        tried, steps = solver.view(now, view.tasks, view.bounds), steps + 1
        is_better = tried.cost < view.cost
        damping *= 0.3 if is_better else 5.0
        view = tried if is_better else view
        yield view, steps
