"""How low a robot comes in a motion."""

from __future__ import annotations

import numpy as np

from g1_description.motion.trajectory import Trajectory
from g1_description.robot.assembly import WORLD
from g1_description.robot.description import Description, Link
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.rotation import conjugate, rotate
from g1_description.robot.transform import IDENTITY
from g1_description.sim.meshes.hulls import outline
from g1_description.sim.meshes.shapes import find_meshes, is_there

MAX_PRODUCTS = 1_000_000
"""Points times samples that are computed at once: 8 MB."""


def lowest_height(robot: Description, trajectory: Trajectory) -> float:
    """Find the lowest point of a robot in the samples of a motion.

    Links without collision shapes count with their visual ones; planes do not count.

    Args:
        robot: The robot, as in its file.
        trajectory: The motion; joints that it does not move are at zero.

    Returns:
        Height in the map, in [m]; of the links' origins where there are no shapes.
    """
    poses = _link_poses(robot, trajectory)
    names = [name for name in robot.link_names if name != WORLD]
    links = {link.name: link for link in robot.links}
    lowest = [
        _lowest(poses[:, row], points, radius)
        for row, name in enumerate(names)
        for points, radius in _points(links[name])
    ]
    return float(min(lowest)) if lowest else float(poses[..., 2].min())


def _link_poses(robot: Description, trajectory: Trajectory) -> np.ndarray:
    """Place all links in each sample, shape (n_samples, n_links, 7)."""
    kinematics = Kinematics(robot)
    names = [joint.name for joint in robot.movable_joints]
    own = [n for n, name in enumerate(trajectory.joint_names) if name in names]
    columns = [names.index(trajectory.joint_names[n]) for n in own]
    positions = np.zeros((len(trajectory.times), len(names)))
    positions[:, columns] = trajectory.positions[:, own]
    bases = trajectory.base_poses
    if bases is None:
        bases = np.broadcast_to(IDENTITY, (len(positions), 7))
    return np.array(
        [kinematics.link_poses(base, row) for base, row in zip(bases, positions)]
    )


def _points(link: Link) -> list[tuple[np.ndarray, float]]:
    """Return points of a link's shapes, in its frame, and a radius about them."""
    shapes = link.collisions or link.visuals
    meshes, _ = find_meshes(shapes)
    found = []
    for shape in shapes:
        if shape.kind != "plane" and is_there(shape, meshes):
            points, radius = outline(shape, meshes)
            found.append((shape.pose[:3] + rotate(shape.pose[3:], points), radius))
    return found


def _lowest(poses: np.ndarray, points: np.ndarray, radius: float) -> float:
    """Find the lowest of some points of a link.

    Args:
        poses: Of the link in each sample, shape (n_samples, 7).
        points: In the link's frame, in [m], shape (n, 3).
        radius: About the points, in [m].
    """
    up = rotate(conjugate(poses[:, 3:]), np.array([0.0, 0.0, 1.0]))
    n_at_once = max(1, MAX_PRODUCTS // len(points))
    lowest = [
        (up[first : first + n_at_once] @ points.T).min(axis=1)
        for first in range(0, len(up), n_at_once)
    ]
    return float((poses[:, 2] + np.concatenate(lowest)).min()) - radius
