"""Errors of links from their tasks, and how these change with velocities."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from g1_description.ik.tasks import (
    LinkTask,
    displaced,
    errors_of,
    matrix_of,
    weights_of,
)
from g1_description.robot.jacobians import Jacobians
from g1_description.robot.kinematics import Kinematics

SAMPLES = 3


def unit(vector):
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


def drawn(robot, seed):
    """Draw configurations, and a task of each kind."""
    random = np.random.default_rng(seed)
    base, pose = (
        np.concatenate(
            [
                random.uniform(-1, 1, (SAMPLES, 3)),
                unit(random.normal(size=(SAMPLES, 4))),
            ],
            axis=1,
        )
        for _ in range(2)
    )
    positions = robot.random_configuration(random, SAMPLES)
    point, axis = random.uniform(-0.1, 0.1, 3), unit(random.normal(size=3))
    places, links = np.ones(6), random.integers(0, len(robot.link_names), 5)
    turns = np.repeat([0.0, 1.0], 3)
    tasks = [
        LinkTask(links[0], pose, places, point),
        LinkTask(links[1], pose[0], np.array([1.0, 0.0, 1.0, 0.0, 0.0, 0.0])),
        LinkTask(links[2], pose, turns, point),
        LinkTask(
            links[3], pose, places, point, axis, unit(random.normal(size=(SAMPLES, 3)))
        ),
        LinkTask(
            links[4],
            pose,
            turns,
            point,
            axis,
            None,
            random.uniform(-1, 1, (SAMPLES, 3)),
        ),
    ]
    return base, positions, tasks


def moved(base, positions, velocities, time):
    """Move robots by velocities of root and joints."""
    turn = Rotation.from_rotvec(time * velocities[:, 3:6])
    turned = (turn * Rotation.from_quat(base[:, 3:])).as_quat()
    place = base[:, :3] + time * velocities[:, :3]
    return np.concatenate([place, turned], 1), positions + time * velocities[:, 6:]


@pytest.mark.parametrize("seed", range(5))
def test_the_squares_of_displacements_fall_as_the_matrix_says(g1, seed):
    """In a batch, against central differences of the sum of each task's squares."""
    base, positions, tasks = drawn(g1, seed)
    kinematics, random = Kinematics(g1.description), np.random.default_rng(seed)
    velocities = random.normal(size=(SAMPLES, 6 + positions.shape[1]))
    now = Jacobians(kinematics, base, positions)
    points, rows = displaced(tasks, now)
    rates = matrix_of(tasks, now, points) @ velocities[..., np.newaxis]
    per_task = (SAMPLES, len(tasks), 6)
    falls = -2.0 * (rows * rates[..., 0]).reshape(per_task).sum(axis=-1)
    squares = [
        (errors_of(displaced(tasks, Jacobians(kinematics, *there))[1]) ** 2).sum(
            axis=-1
        )
        for there in (moved(base, positions, velocities, h) for h in (1e-6, -1e-6))
    ]
    np.testing.assert_allclose(falls, (squares[0] - squares[1]) / 2e-6, atol=2e-7)


@pytest.mark.parametrize("seed", range(5))
def test_near_the_goal_displacements_change_as_the_matrix_says(g1, seed):
    """So a turn about an axis that points where it should is none."""
    base, positions, tasks = drawn(g1, seed)
    kinematics, random = Kinematics(g1.description), np.random.default_rng(seed)
    now = Jacobians(kinematics, base, positions)
    reached = []
    for task in tasks:
        poses = now.link_poses[:, task.link]
        turned = Rotation.from_quat(poses[:, 3:])
        point = poses[:, :3] + turned.apply(task.point)
        task = task._replace(pose=np.concatenate([point, poses[:, 3:]], axis=1))
        aim = None if task.axis is None else turned.apply(task.axis)
        if task.direction is not None:
            task = task._replace(direction=aim)
        elif aim is not None:
            task = task._replace(look_at=point + 0.6 * aim)
        reached.append(task)
    velocities = random.normal(size=(SAMPLES, 6 + positions.shape[1]))
    points, rows = displaced(reached, now)
    np.testing.assert_allclose(rows, 0.0, atol=1e-7)
    rates = (matrix_of(reached, now, points) @ velocities[..., np.newaxis])[..., 0]
    rates[:, weights_of(reached) == 0.0] = 0.0
    ahead, behind = (
        displaced(
            reached, Jacobians(kinematics, *moved(base, positions, velocities, h))
        )[1]
        for h in (1e-5, -1e-5)
    )
    np.testing.assert_allclose(rates, (behind - ahead) / 2e-5, atol=1e-4)


@pytest.mark.parametrize("seed", range(5))
def test_errors_are_distances_and_angles(g1, seed):
    base, positions, tasks = drawn(g1, seed)
    now = Jacobians(Kinematics(g1.description), base, positions)
    found = errors_of(displaced(tasks, now)[1])
    for number, task in enumerate(tasks):
        poses = now.link_poses[:, task.link]
        turns = Rotation.from_quat(poses[:, 3:])
        point = poses[:, :3] + turns.apply(task.point)
        away = (task.pose[..., :3] - point) * task.weights[:3]
        np.testing.assert_allclose(
            found[:, number, 0], np.linalg.norm(away, axis=1), atol=1e-12
        )
        if task.axis is not None:
            aim = task.direction
            if aim is None:
                aim = unit(task.look_at - point)
            cosine = (turns.apply(task.axis) * aim).sum(axis=1)
            np.testing.assert_allclose(np.cos(found[:, number, 1]), cosine, atol=1e-12)
        elif task.is_posed or number == 2:
            apart = Rotation.from_quat(task.pose[..., 3:]) * turns.inv()
            angle = np.linalg.norm(apart.as_rotvec(), axis=1)
            np.testing.assert_allclose(found[:, number, 1], angle, atol=1e-9)


def test_a_batch_has_what_each_of_its_configurations_has(g1):
    base, positions, tasks = drawn(g1, 0)
    kinematics = Kinematics(g1.description)
    now = Jacobians(kinematics, base, positions)
    points, rows = displaced(tasks, now)
    matrix = matrix_of(tasks, now, points)
    assert matrix.shape == (SAMPLES, len(weights_of(tasks)), 6 + positions.shape[1])
    for row in range(SAMPLES):
        single = [task.at(row) for task in tasks]
        alone = Jacobians(kinematics, base[row], positions[row])
        place, own = displaced(single, alone)
        np.testing.assert_allclose(rows[row], own, rtol=0, atol=1e-12)
        np.testing.assert_allclose(
            matrix[row], matrix_of(single, alone, place), rtol=0, atol=1e-12
        )
