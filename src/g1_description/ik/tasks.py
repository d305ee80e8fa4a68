"""Tasks of links: errors, and how these change with the velocities of a robot.

Leading axes of all arrays are those of a batch of configurations, as in ``Jacobians``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from g1_description.robot.jacobians import Jacobians
from g1_description.robot.rotation import (
    conjugate,
    multiply,
    rotate,
    to_rotation_vector,
)

ROWS = 6
"""Rows of a task: displacements along the world's axes, then about them."""


class LinkTask(NamedTuple):
    """Where a link should be."""

    link: int
    """Row of the link."""

    pose: np.ndarray
    """In the world, shape (..., 7)."""

    weights: np.ndarray
    """Weights of its position along the world's axes and rotation about them, shape
    (6,); 0: any will do."""

    point: np.ndarray = np.zeros(3)
    """Which of its points should be there, in its frame, in [m], shape (3,)."""

    @property
    def link_pose(self) -> np.ndarray:
        """Pose of the link itself in the world, shape (..., 7)."""
        origin = self.pose[..., :3] - rotate(self.pose[..., 3:], self.point)
        return np.concatenate([origin, self.pose[..., 3:]], axis=-1)


def weights_of(tasks: Sequence[LinkTask]) -> np.ndarray:
    """Return the weights of the rows of tasks, shape (n_rows,)."""
    return np.array([task.weights for task in tasks]).reshape(-1)


def displaced(
    tasks: Sequence[LinkTask], jacobians: Jacobians
) -> tuple[np.ndarray, np.ndarray]:
    """Compare configurations with tasks.

    Args:
        tasks: The tasks.
        jacobians: Those of the configurations, with the leading axes of the tasks.

    Returns:
        Points of tasks in the world, in [m], shape (..., n_tasks, 3), and by how much
        the links must move and turn along the world's axes, in [m] and [rad], shape
        (..., n_rows); 0 where free.
    """
    poses = jacobians.link_poses[..., _links(tasks), :]
    offsets = np.array([task.point for task in tasks]).reshape(-1, 3)
    points = poses[..., :3] + rotate(poses[..., 3:], offsets)
    goals = np.empty_like(poses)
    for number, task in enumerate(tasks):
        goals[..., number, :] = task.pose
    turns = multiply(goals[..., 3:], conjugate(poses[..., 3:]))
    moves = [goals[..., :3] - points, to_rotation_vector(turns)]
    rows = np.concatenate(moves, axis=-1).reshape(*poses.shape[:-2], ROWS * len(tasks))
    return points, np.where(weights_of(tasks) == 0.0, 0.0, rows)


def matrix_of(
    tasks: Sequence[LinkTask], jacobians: Jacobians, points: np.ndarray
) -> np.ndarray:
    """Linearize tasks.

    Args:
        tasks: The tasks.
        jacobians: Those of the configurations.
        points: Points of tasks in the world, a result of ``displaced``.

    Returns:
        J such that small velocities reduce the displacements by J @ velocities, shape
        (..., n_rows, 6 + n_joints).
    """
    matrix = jacobians.of_links(_links(tasks), points)
    shape = matrix.shape[:-3]
    return matrix.reshape(*shape, ROWS * len(tasks), matrix.shape[-1])


def errors_of(displacements: np.ndarray) -> np.ndarray:
    """Measure the distances from tasks.

    Args:
        displacements: A result of ``displaced``, shape (..., n_rows).

    Returns:
        In [m] and [rad], shape (..., n_tasks, 2).
    """
    shape = (*displacements.shape[:-1], displacements.shape[-1] // ROWS, 2, 3)
    return np.asarray(np.linalg.norm(displacements.reshape(shape), axis=-1))


def _links(tasks: Sequence[LinkTask]) -> np.ndarray:
    return np.array([task.link for task in tasks], dtype=int)
