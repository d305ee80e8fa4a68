"""Configurations that reach targets: steps until nothing improves, from many starts."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Tuple, TypeVar

import numpy as np

from g1_description.ik.solver import (
    Configuration,
    IkConstraints,
    IkSolver,
    Linearization,
    LinkTask,
)

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


Found = Tuple[Linearization, int]
"""The best configuration so far, and the number of steps."""


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
    for begin in _starts(best, start, starts - 1):
        if best.badness <= 1.0:
            return
        view = solver.view(begin, tasks, bounds)
        for found, more in descend(solver, view, posture):
            yield min(best, found, key=_cost), steps + more
        best, steps = min(best, found, key=_cost), steps + more
    if best.badness > 1.0:
        for settled, more in _settle(solver, best, posture):
            yield settled, steps + more


Item = TypeVar("Item")


def last(items: Iterable[Item]) -> Item:
    """Return the last item; there is one."""
    return deque(items, maxlen=1).pop()


def descend(
    solver: IkSolver, view: Linearization, posture: np.ndarray, most: int = MAX_STEPS
) -> Iterator[Found]:
    """Step from one configuration until nothing improves.

    The cost may rise for some steps: links that are held move on an arc at first.

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
        best = min(best, view, key=_cost)
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


def _cost(view: Linearization) -> float:
    return view.cost


def _starts(
    view: Linearization, start: Configuration, count: int
) -> Iterator[Configuration]:
    """Vary a start; the same ones each time."""
    random, bounds = np.random.default_rng(0), view.bounds
    lower = np.maximum(bounds.lower, start.position - np.pi)
    upper = np.minimum(bounds.upper, start.position + np.pi)
    for number in range(1, count + 1):
        spread = min(1.0, 2.0 * number / count)
        drawn = random.uniform(lower, upper) - start.position
        yield Configuration(start.root, start.position + spread * drawn)
