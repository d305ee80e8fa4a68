"""Small changes of base and joints that move points of a robot as they should.

All samples of a piece are solved for together: a sum of squares with terms of a sample,
of two neighbours, and of the curvature of the change. Gauss and Newton's method; its
matrix is banded.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solveh_banded

from g1_description.robot.rotation import from_rotation_vector, multiply

N_BASE = 6
"""Unknowns of the base: its translation, and its rotation about its origin, along the
axes of the map."""


class Change:
    """The sum of squares for the change of some samples.

    The unknowns of a sample are those of the base in [m] and [rad], then the joints in
    [rad] or [m]. Weights are inverse tolerances: a residual of its tolerance counts 1.
    """

    def __init__(self, count: int, n_joints: int) -> None:
        """Begin without terms.

        Args:
            count: Number of samples.
            n_joints: Number of joints.
        """
        self.size = N_BASE + n_joints
        self._right = np.zeros((count, self.size))
        # Blocks of the normal matrix: a sample with itself, and with the next ones.
        self._blocks = np.zeros((3, count, self.size, self.size))

    def add(self, rows: np.ndarray, jacobian: np.ndarray, residual: np.ndarray) -> None:
        """Add terms of single samples, whose residuals become zero.

        Args:
            rows: Samples, which may be repeated, shape (m,).
            jacobian: Weighted derivatives, shape (m, k, size).
            residual: Weighted residuals now, shape (m, k).
        """
        turned = np.swapaxes(jacobian, 1, 2)
        _add(self._blocks[0], rows, turned @ jacobian)
        _add(self._right, rows, -(turned @ residual[..., np.newaxis])[..., 0])

    def add_steps(
        self,
        rows: np.ndarray,
        before: np.ndarray,
        after: np.ndarray,
        residual: np.ndarray,
    ) -> None:
        """Add terms of samples and the next ones.

        Args:
            rows: First samples, shape (m,).
            before: Weighted derivatives by the first ones, shape (m, k, size).
            after: Weighted derivatives by the next ones, shape (m, k, size).
            residual: Weighted residuals now, shape (m, k).
        """
        self.add(rows, before, residual)
        self.add(rows + 1, after, residual)
        _add(self._blocks[1], rows, np.swapaxes(before, 1, 2) @ after)

    def add_bends(
        self,
        rows: np.ndarray,
        columns: np.ndarray,
        weights: np.ndarray,
        now: np.ndarray,
    ) -> None:
        """Add terms of one unknown at a sample and the next two.

        Args:
            rows: First samples, shape (m,).
            columns: Unknowns, shape (m,).
            weights: Weighted derivatives by the three, shape (m, 3).
            now: Weighted residuals now, shape (m,).
        """
        for k, one in enumerate(weights.T):
            np.add.at(self._right, (rows + k, columns), -one * now)
            for distance, block in enumerate(self._blocks[: 3 - k]):
                product = one * weights[:, k + distance]
                np.add.at(block, (rows + k, columns, columns), product)

    def keep_small(self, weights: np.ndarray, done: np.ndarray) -> None:
        """Prefer no change.

        Args:
            weights: Shape (count, size).
            done: The change so far that is not wanted, shape (count, size).
        """
        diagonal = np.arange(self.size)
        self._blocks[0][:, diagonal, diagonal] += weights**2
        self._right -= weights**2 * done

    def keep_smooth(self, weights: np.ndarray, done: np.ndarray) -> None:
        """Prefer a change of little curvature.

        Args:
            weights: Of second differences, shape (size,).
            done: The change so far, shape (count, size).
        """
        square, diagonal = weights**2, np.arange(self.size)
        count = len(done)
        parts = np.zeros((3, count))
        parts[0, :-2] += 1.0
        parts[0, 1:-1] += 4.0
        parts[0, 2:] += 1.0
        parts[1, :-2] -= 2.0
        parts[1, 1:-1] -= 2.0
        parts[2, :-2] += 1.0
        for block, part in zip(self._blocks, parts):
            block[:, diagonal, diagonal] += part[:, np.newaxis] * square
        curved = done[2:] - 2.0 * done[1:-1] + done[:-2]
        self._right[:-2] -= square * curved
        self._right[1:-1] += 2.0 * square * curved
        self._right[2:] -= square * curved

    def solve(self) -> np.ndarray:
        """Return the change that makes the sum smallest, shape (count, size)."""
        count, size = self._right.shape
        bands = np.zeros((3 * size, count * size))
        column, row = np.meshgrid(np.arange(size), np.arange(size))
        for distance, block in enumerate(self._blocks):
            # Of a symmetric matrix, the lower bands: entry (k + distance, i), (k, j).
            offset = distance * size + row - column
            lower = offset >= 0
            used = count - distance
            places = np.arange(used)[:, np.newaxis] * size + column[lower]
            bands[offset[lower], places] = np.swapaxes(block, 1, 2)[:used][:, lower]
        found = solveh_banded(bands, self._right.ravel(), lower=True)
        return np.asarray(found.reshape(count, size))


def _add(total: np.ndarray, rows: np.ndarray, values: np.ndarray) -> None:
    """Add values to rows, which may be repeated; numpy is slow where they are."""
    if (np.diff(rows) > 0).all():
        total[rows] += values
    else:
        np.add.at(total, rows, values)


def changed(
    bases: np.ndarray, positions: np.ndarray, change: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Apply a change.

    Args:
        bases: Poses of the base, shape (n, 7).
        positions: Of the joints, shape (n, n_joints).
        change: Shape (n, 6 + n_joints).
    """
    places = bases[:, :3] + change[:, :3]
    turns = multiply(from_rotation_vector(change[:, 3:N_BASE]), bases[:, 3:])
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    return np.concatenate([places, turns], axis=1), positions + change[:, N_BASE:]
