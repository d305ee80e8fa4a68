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
    cross,
    multiply,
    rotate,
    to_rotation_vector,
    turn_between,
)
from g1_description.robot.transform import compose

NEAREST = 0.01
"""Distance of a point that an axis points at from the axis' own, in [m]: nearer ones
count as that far away."""

FAR = np.array([0.05, 0.2])
"""Errors from which on they pull with a constant force, in [m] and [rad]."""

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

    axis: np.ndarray | None = None
    """Unit vector in its frame, shape (3,), which points along ``direction`` or at
    ``look_at`` instead of the rotation of the pose; None: the pose has the rotation."""

    direction: np.ndarray | None = None
    """Unit vector in the world, shape (..., 3)."""

    look_at: np.ndarray | None = None
    """In the world, in [m], shape (..., 3)."""

    def at(self, row: int) -> LinkTask:
        """Return the task of one configuration of a batch."""
        rows = {
            name: each[row]
            for name, each in self._asdict().items()
            if name in ("pose", "direction", "look_at") and np.ndim(each) == 2
        }
        return self._replace(**rows)

    def in_frame(self, frame: np.ndarray) -> LinkTask:
        """Return the task in the world, if this one is in a frame, shape (..., 7)."""
        turn, direction, look_at = frame[..., 3:], self.direction, self.look_at
        if direction is not None:
            direction = rotate(turn, direction)
        if look_at is not None:
            look_at = frame[..., :3] + rotate(turn, look_at)
        pose = compose(frame, self.pose)
        return self._replace(pose=pose, direction=direction, look_at=look_at)

    @property
    def is_posed(self) -> bool:
        """Whether the whole pose is given."""
        return self.axis is None and bool(np.all(self.weights))

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
    turns = to_rotation_vector(multiply(goals[..., 3:], conjugate(poses[..., 3:])))
    for number, task in enumerate(tasks):
        if task.axis is not None:
            axis, aim, _ = _aim(task, task.axis, jacobians, points[..., number, :])
            turns[..., number, :] = turn_between(axis, aim)
    moves = [goals[..., :3] - points, turns]
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
    for number, task in enumerate(tasks):
        if task.axis is not None:
            axis, aim, near = _aim(task, task.axis, jacobians, points[..., number, :])
            axis = axis[..., np.newaxis, :]
            linear, angular = np.split(matrix[..., number, :, :], 2, axis=-2)
            # A turn about the axis does not move it.
            angular -= np.swapaxes(axis, -1, -2) * (axis @ angular)
            turned = cross(aim[..., np.newaxis, :], np.swapaxes(linear, -1, -2))
            angular += near[..., np.newaxis] * np.swapaxes(turned, -1, -2)
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


def factors_of(displacements: np.ndarray) -> np.ndarray:
    """Weaken errors that are large, so that they pull with a constant force.

    Source: Huber, Annals of Mathematical Statistics 35, 1964.

    Args:
        displacements: As for ``errors_of``.

    Returns:
        Factors of their squares, shape (..., n_rows).
    """
    errors = np.maximum(errors_of(displacements), FAR)
    return np.repeat((FAR / errors).reshape(len(errors), -1), 3, axis=1)


def _aim(
    task: LinkTask, axis: np.ndarray, jacobians: Jacobians, point: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find where an axis of a link points, and where it should point.

    Returns:
        Unit vectors in the world, shape (..., 3), and the angle by which the second one
        turns when the point moves across it, in [rad/m], shape (..., 1).
    """
    now = rotate(jacobians.link_poses[..., task.link, 3:], axis)
    if task.look_at is None:
        assert task.direction is not None
        return now, task.direction, np.zeros((1,))
    ray = task.look_at - point
    distance = np.maximum(np.linalg.norm(ray, axis=-1, keepdims=True), NEAREST)
    return now, ray / distance, 1.0 / distance


def _links(tasks: Sequence[LinkTask]) -> np.ndarray:
    return np.array([task.link for task in tasks], dtype=int)
