"""Cubic splines of many columns that keep to soft limits, as least squares.

The control points of uniform cubic B-splines minimize squared errors of samples, which
see a linear combination of the columns each, and squared excesses over limits. All of
it couples four successive control points, so the matrices of an interior-point method
are banded. Sources: de Boor, A Practical Guide to Splines, 2001 (bounds of control
points bound the spline and its derivatives); Nocedal and Wright, Numerical
Optimization, 2006, section 16.6 (predictor and corrector).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import Callable, Sequence, Union

import numpy as np
from scipy import sparse
from scipy.linalg import cho_solve_banded, cholesky_banded

ORDER = 4
"""Number of control points that a sample sees."""

CUBICS = np.array([[1, -3, 3, -1], [4, 0, -6, 3], [1, 3, 3, -3], [0, 0, 0, 1]]) / 6.0
"""Weights of four successive control points: coefficients of powers of the time since
the knot, in periods."""

MAX_ITERATIONS = 40
"""Most iterations of a minimization."""

FIRST_ROOM, FIRST_GAP = 1e-2, 1e-2
"""Least room of a limit at the first iteration, and its product with the force."""

SHORTEN = 0.99
"""Share of the longest step, so that forces and rooms stay positive."""

LEAST_GAP, RELATIVE_GAP = 1e-6, 1e-2
"""Gaps to the least cost at which iterations end: in units of the cost, and relative to
the decrease."""

UNBOUNDED = 1e3
"""Infinity."""


def basis(
    times: np.ndarray, begin: float, period: float, count: int, order: int = 0
) -> sparse.csc_matrix:
    """Compute how much samples see of control points.

    Args:
        times: In [s], shape (n,).
        begin: Beginning of the spline, in [s].
        period: Time between knots, in [s].
        count: Number of control points.
        order: Of the derivative that the samples see, from 0 to 2.

    Returns:
        Shape (n, count).
    """
    at = (times - begin) / period
    first = np.clip(np.floor(at).astype(int), 0, count - ORDER)
    powers = np.polynomial.polynomial.polyval(
        at - first, np.polynomial.polynomial.polyder(CUBICS, order, axis=1).T
    )
    weights = (powers / period**order).T
    columns = first[:, np.newaxis] + np.arange(ORDER)
    rows = np.repeat(np.arange(len(times)), ORDER)
    shape = len(times), count
    return sparse.csc_matrix((weights.ravel(), (rows, columns.ravel())), shape)


def products_of(weights: sparse.spmatrix) -> list[sparse.csr_matrix]:
    """Multiply how much samples see of control points that are 0 to 3 apart.

    Args:
        weights: Shape (n, count).

    Returns:
        Shapes (count, n) to (count - 3, n).
    """
    weights = weights.tocsc()
    count = weights.shape[1]
    return [
        weights[:, : count - apart].multiply(weights[:, apart:]).T.tocsr()
        for apart in range(min(ORDER, count))
    ]


class Quadratic:
    """A quadratic function of control points: ``p @ H @ p / 2 + gradient @ p``.

    ``blocks[o, k]``, n_columns squared, couples the control points k and k + o in H.
    """

    def __init__(self, count: int, columns: int) -> None:
        self.blocks = np.zeros((ORDER, count, columns, columns))
        self.gradient = np.zeros((count, columns))

    def add_samples(
        self, products: Sequence[sparse.spmatrix], squares: np.ndarray
    ) -> None:
        """Add squares of samples.

        Args:
            products: Those of how much each sees of control points.
            squares: Their quadratic forms, shape (n, n_columns, n_columns).
        """
        flat, columns = squares.reshape(len(squares), -1), self.gradient.shape[1]
        for blocks, both in zip(self.blocks, products):
            blocks[: both.shape[0]] += (both @ flat).reshape(-1, columns, columns)

    def add_differences(self, order: int, weights: np.ndarray) -> None:
        """Add squares of differences of control points.

        Args:
            order: Of the differences, from 0 to 3.
            weights: Shape (count - order, n_columns).
        """
        stencil = np.diff(np.eye(order + 1), n=order, axis=0)[0]
        diagonal = np.einsum("okii->oki", self.blocks)
        for first, one in enumerate(stencil):
            for second in range(first, order + 1):
                part = slice(first, first + len(weights))
                diagonal[second - first, part] += one * stencil[second] * weights

    def product(self, points: np.ndarray) -> np.ndarray:
        """Return ``H @ points``, shape (count, n_columns)."""
        found = np.einsum("kij,kj->ki", self.blocks[0], points)
        for apart in range(1, min(ORDER, len(points))):
            block = self.blocks[apart, :-apart]
            found[:-apart] += np.einsum("kij,kj->ki", block, points[apart:])
            found[apart:] += np.einsum("kij,ki->kj", block, points[:-apart])
        return found


@dataclass(frozen=True, eq=False)
class ControlBounds:
    """Limits of control points, or of their differences: of speeds, accelerations."""

    order: int
    """Of the differences, from 0 to 2."""

    lower: np.ndarray
    upper: np.ndarray
    """Shape (count - order, n_columns), or one that fits."""

    weight: float
    """Weight of squared excesses."""

    def values(self, points: np.ndarray) -> np.ndarray:
        """Return what is limited."""
        return np.diff(points, n=self.order, axis=0)

    def add_squares(self, quadratic: Quadratic, weights: np.ndarray) -> None:
        """Add the weighted squares of values."""
        quadratic.add_differences(self.order, weights)

    def pulls(self, forces: np.ndarray) -> np.ndarray:
        """Return what forces on the values do to control points."""
        for _ in range(self.order):
            forces = -np.diff(np.pad(forces, ((1, 1), (0, 0))), axis=0)
        return forces


@dataclass(frozen=True, eq=False)
class Rows:
    """Limits of samples: ``rates @ (weights @ points) <= upper``."""

    weights: sparse.csr_matrix
    """How much samples see of control points, shape (n_samples, count)."""

    samples: np.ndarray
    """Which of these each limit is of, sorted, each at least once, shape (n,)."""

    rates: np.ndarray
    """Shape (n, n_columns)."""

    upper: np.ndarray
    """Shape (n,)."""

    weight: float
    """Weight of squared excesses."""

    lower = -np.inf

    @cached_property
    def _products(self) -> list[sparse.csr_matrix]:
        return products_of(self.weights)

    @cached_property
    def _ends(self) -> np.ndarray:
        """Rows of the first limit of each sample, and the number of all, (n + 1,)."""
        return np.searchsorted(self.samples, np.arange(self.weights.shape[0] + 1))

    def values(self, points: np.ndarray) -> np.ndarray:
        """Return what is limited."""
        found: np.ndarray = (self.rates * (self.weights @ points)[self.samples]).sum(-1)
        return found

    def add_squares(self, quadratic: Quadratic, weights: np.ndarray) -> None:
        """Add the weighted squares of values."""
        scaled = weights[:, np.newaxis] * self.rates
        squares = [
            self.rates[begin:end].T @ scaled[begin:end]
            for begin, end in zip(self._ends, self._ends[1:])
        ]
        quadratic.add_samples(self._products, np.array(squares))

    def pulls(self, forces: np.ndarray) -> np.ndarray:
        """Return what forces on the values do to control points."""
        pulls = forces[:, np.newaxis] * self.rates
        each = np.add.reduceat(pulls, self._ends[:-1], axis=0)
        found: np.ndarray = self.weights.T @ each
        return found


SoftLimit = Union[ControlBounds, Rows]


def excess(limit: SoftLimit, values: np.ndarray) -> np.ndarray:
    """Return by how much values are beyond a limit, with their direction."""
    return values - np.minimum(np.maximum(values, limit.lower), limit.upper)


class _Side:
    """One side of a limit: ``values - force / weight + room = bound``.

    Force and room are positive, and nearly one of them is 0 at last.
    """

    def __init__(self, limit: SoftLimit, sign: float, points: np.ndarray) -> None:
        self._limit, self._sign = limit, sign
        values = self.values(points)
        bound = sign * np.broadcast_to(
            limit.upper if sign > 0.0 else limit.lower, values.shape
        )
        self._bound = np.where(np.isfinite(bound), bound, UNBOUNDED)
        self.room = np.maximum(self._bound - values, FIRST_ROOM)
        self.force = FIRST_GAP / self.room

    def values(self, points: np.ndarray) -> np.ndarray:
        """Return what is limited from above."""
        return self._sign * self._limit.values(points)

    def pulls(self, forces: np.ndarray) -> np.ndarray:
        """Return what forces do to control points."""
        return self._limit.pulls(self._sign * forces)

    def prepare(self, quadratic: Quadratic, points: np.ndarray) -> None:
        """Add the stiffness of the limit to a step's matrix."""
        softness = 1.0 / self._limit.weight
        self._stiffness = 1.0 / (softness + self.room / self.force)
        self._missed = self.values(points) - softness * self.force
        self._missed += self.room - self._bound
        self._limit.add_squares(quadratic, self._stiffness)

    def aim(self, gap: float, correction: np.ndarray | float) -> np.ndarray:
        """Aim at a product of force and room; return what that does to points."""
        self._aim = (gap - correction) / self.force - self.room
        return self.pulls(self._stiffness * (self._missed + self._aim))

    def move(self, step: np.ndarray) -> None:
        """Compute the changes of force and room with a step of control points."""
        moved = self.values(step) + self._missed + self._aim
        self.force_change = self._stiffness * moved
        self.room_change = self._aim - self.room / self.force * self.force_change

    def longest(self) -> float:
        """Return the longest share of the changes that leaves both positive."""
        with np.errstate(divide="ignore"):
            ratios = [
                float((-change / now).max(initial=0.0))
                for now, change in (
                    (self.force, self.force_change),
                    (self.room, self.room_change),
                )
            ]
        return 1.0 / max(1.0, *ratios)

    def gap(self, length: float = 0.0) -> float:
        """Return the sum of the products after a share of the changes."""
        force = self.force + length * self.force_change if length else self.force
        room = self.room + length * self.room_change if length else self.room
        return float((force * room).sum())

    def go(self, length: float) -> None:
        """Take a share of the changes."""
        self.force = self.force + length * self.force_change
        self.room = self.room + length * self.room_change


def minimized(quadratic: Quadratic, limits: Sequence[SoftLimit]) -> np.ndarray:
    """Minimize a quadratic and half the weighted squares of excesses over limits.

    Returns:
        Control points, shape (count, n_columns).
    """
    points = np.zeros(quadratic.gradient.shape)
    sides = [_Side(one, 1.0, points) for one in limits]
    sides += [
        _Side(one, -1.0, points) for one in limits if isinstance(one, ControlBounds)
    ]
    number = sum(side.room.size for side in sides)
    for _ in range(MAX_ITERATIONS):
        matrix = Quadratic(*points.shape)
        matrix.blocks[:] = quadratic.blocks
        for side in sides:
            side.prepare(matrix, points)
        forces = quadratic.product(points) + quadratic.gradient
        forces = forces + sum(side.pulls(side.force) for side in sides)
        newton = partial(_newton, _factorized(matrix), forces, sides)
        gap = sum(side.gap() for side in sides)
        newton(0.0, [0.0] * len(sides))
        length = min(side.longest() for side in sides)
        left = sum(side.gap(length) for side in sides)
        corrections = [side.force_change * side.room_change for side in sides]
        step = newton((left / gap) ** 3 * gap / number, corrections)
        length = min(1.0, SHORTEN * min(side.longest() for side in sides))
        points = points + length * step
        for side in sides:
            side.go(length)
        pulled = quadratic.product(points) + 2.0 * quadratic.gradient
        decrease = abs(float((points * pulled).sum()))
        gap = sum(side.gap() for side in sides)
        if gap < max(LEAST_GAP, RELATIVE_GAP * decrease):
            break
    return points


def _newton(
    solve: Callable[[np.ndarray], np.ndarray],
    forces: np.ndarray,
    sides: Sequence[_Side],
    gap: float,
    corrections: Sequence[np.ndarray | float],
) -> np.ndarray:
    """Step towards balanced forces, and forces and rooms with a product."""
    aims = [side.aim(gap, one) for side, one in zip(sides, corrections)]
    step = solve(-forces - sum(aims))
    for side in sides:
        side.move(step)
    return step


def _factorized(quadratic: Quadratic) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function that solves ``H @ points = right``."""
    count, columns = quadratic.gradient.shape
    chosen, to = _places(count, columns)
    banded = np.zeros(ORDER * columns * count * columns)
    banded[to] = quadratic.blocks.ravel()[chosen]
    banded = banded.reshape(ORDER * columns, -1)
    factor = cholesky_banded(banded, overwrite_ab=True, check_finite=False)

    def solve(right: np.ndarray) -> np.ndarray:
        found = cho_solve_banded((factor, False), right.ravel(), check_finite=False)
        return np.asarray(found).reshape(count, columns)

    return solve


@lru_cache(maxsize=1)  # hundreds of MB for the longest
def _places(count: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Find the numbers of blocks that belong into LAPACK's upper banded storage.

    Returns:
        Their indices, and those in the storage.
    """
    apart, control, row, column = np.ogrid[:ORDER, :count, :columns, :columns]
    above = apart * columns + column - row
    chosen = (above >= 0) & (control + apart < count)
    to = (ORDER * columns - 1 - above) * (count * columns)
    to = to + (control + apart) * columns + column
    return np.flatnonzero(chosen), to[chosen]
