"""Small changes of base and joints that move points of a robot as they should.

All samples of a piece are solved for together: a sum of squares with terms of a sample,
of two neighbours, and of the curvature of the change. Gauss and Newton's method; its
matrix is banded.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solveh_banded

from g1_description.checks.measured import CheckedRobot
from g1_description.robot.dynamics import Masses
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
        if count < 3:
            return
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


class Placed:
    """A robot at all samples of a motion, and derivatives of its points."""

    def __init__(
        self, robot: CheckedRobot, bases: np.ndarray, positions: np.ndarray
    ) -> None:
        """Place it.

        Args:
            robot: The robot.
            bases: Poses of the root link, shape (n, 7).
            positions: Of all joints in [rad] or [m], shape (n, n_joints).
        """
        self._above = robot.kinematics.joints_above
        self.bases, self.positions = bases, positions
        self.poses, origin, axis = robot.kinematics.place(bases, positions)
        self._screws = robot.kinematics.joint_screws(origin, axis)

    def jacobian(
        self, rows: np.ndarray, links: np.ndarray, points: np.ndarray
    ) -> np.ndarray:
        """Differentiate points that are fixed to links.

        Args:
            rows: Samples, shape (m,).
            links: Rows of the links, shape (m,).
            points: In the map in [m], shape (m, 3).

        Returns:
            Shape (m, 3, size).
        """
        lever = points - self.bases[rows, :3]
        screws = self._screws[rows] * self._above[links][..., np.newaxis]
        found = np.zeros((len(rows), 3, N_BASE + screws.shape[1]))
        found[:, :, :3] = np.eye(3)
        found[:, :, 3:6] = -np.cross(np.eye(3), lever[:, np.newaxis])
        moved = screws[..., :3] + np.cross(screws[..., 3:], points[:, np.newaxis])
        found[:, :, 6:] = np.swapaxes(moved, 1, 2)
        return found

    def center_jacobian(self, masses: Masses) -> tuple[np.ndarray, np.ndarray]:
        """Return the centre of mass, shape (n, 3), and its derivatives (n, 3, size)."""
        centers, shares = masses.centers(self.poses), masses.shares
        center = shares @ centers
        found = np.zeros((len(center), 3, N_BASE + self._screws.shape[1]))
        found[:, :, :3] = np.eye(3)
        lever = center - self.bases[:, :3]
        found[:, :, 3:6] = -np.cross(np.eye(3), lever[:, np.newaxis])
        below = self._above.T * shares
        moved = below.sum(axis=1)[:, np.newaxis] * self._screws[..., :3]
        moved += np.cross(self._screws[..., 3:], below @ centers)
        found[:, :, 6:] = np.swapaxes(moved, 1, 2)
        return center, found


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
