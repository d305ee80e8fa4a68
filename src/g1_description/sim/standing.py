"""Heights of a robot: standing, hanging clear of the floor, lowest in a motion."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from g1_description.errors import DescriptionError, MotionError
from g1_description.motion.edit import moved
from g1_description.motion.files.conventions import of_robot
from g1_description.motion.motion import Motion, configuration
from g1_description.robot.assembly import WORLD, Assembly
from g1_description.robot.description import Description, Link, origin_reaches
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.rotation import conjugate, rotate
from g1_description.robot.transform import IDENTITY, compose
from g1_description.sim.meshes.hulls import outline
from g1_description.sim.meshes.shapes import find_meshes, is_there
from g1_description.sim.model import Model

GAP = 0.0005
"""Minimum distance from the floor, in [m]: touching links would be pushed away."""

HULL_MARGIN = 0.001
"""PyBullet's collision margin of a hull, in [m]."""

MAX_PRODUCTS = 1_000_000
"""Maximum number of points times samples per batch: 8 MB."""


def standing_height(assembly: Assembly, rotation: np.ndarray) -> float:
    """Compute the height at which a robot stands on the floor, which is z = 0.

    Args:
        assembly: The robot with its initial joint positions.
        rotation: Orientation of the model frame in the world, shape (4,).

    Returns:
        The lowest height of the model frame in whole millimetres, in [m], with all
        collision shapes above the floor; without any, all links' origins.
    """
    pose = np.concatenate([IDENTITY[:3], rotation])
    model = Model("standing", assembly, pose)
    boxes = [box for _, box in _boxes(model)]
    lowest = min((box[0, 2] for box in boxes), default=math.inf)
    if math.isinf(lowest):
        lowest = model.poses[:, 2].min(initial=0.0)
    return _above(-lowest)


def hanging_height(assembly: Assembly, rotation: np.ndarray) -> float:
    """Compute a height at which no configuration reaches the floor, which is z = 0.

    Args:
        assembly: The robot.
        rotation: Orientation of the model frame in the world, shape (4,).

    Returns:
        Height of the model frame in whole millimetres, in [m]: above the largest reach
        of a collision shape or link origin from the root link, within joint limits.

    Raises:
        DescriptionError: If a prismatic joint has no limits.
    """
    model = Model("hanging", replace(assembly, positions={}), IDENTITY)
    description = assembly.description.trees[0]  # only the first one can hang
    reaches = origin_reaches(description)
    origins = dict(zip(model.link_names, model.poses[:, :3]))
    reach = max((reaches[n] for n in description.link_names if n in origins), default=0)
    for name, box in _boxes(model):
        if name in reaches and np.isfinite(box).all():
            extent = np.linalg.norm(np.abs(box - origins[name]).max(axis=0))
            reach = max(reach, reaches[name] + float(extent))
    if math.isinf(reach):
        raise DescriptionError(
            f"A prismatic joint of '{description.name}' has no limits, so its reach is "
            "infinite: set the height of the robot."
        )
    return _above(reach - rotate(rotation, assembly.root_pose[:3])[2])


def _above(height: float) -> float:
    """Return the next whole millimetre above a height, in [m], with a gap between."""
    return math.ceil((height + GAP) * 1000.0) / 1000.0


def _boxes(model: Model) -> Iterator[tuple[str, np.ndarray]]:
    """Compute the bounding box of each collision shape along the world's axes.

    Yields:
        The link's name, and the lowest and highest corner in the world, in [m], shape
        (2, 3); infinite for a plane. Missing meshes are skipped.
    """
    links = [link for link in model.assembly.description.links if link.collisions]
    meshes, _ = find_meshes(shape for link in links for shape in link.collisions)
    poses = dict(zip(model.link_names, model.poses))
    for link in links:
        for shape in link.collisions:
            if link.name not in poses or not is_there(shape, meshes):
                continue
            if shape.kind == "plane":
                yield link.name, np.full((2, 3), math.inf)
                continue
            pose = compose(poses[link.name], shape.pose)
            points, radius = outline(shape, meshes)
            turned = pose[:3] + rotate(pose[3:], points)
            is_hull = shape.kind in ("cylinder", "mesh")
            margin = HULL_MARGIN if is_hull else radius
            corners = [turned.min(axis=0) - margin, turned.max(axis=0) + margin]
            yield link.name, np.array(corners)


def lowest_height(robot: Description, motion: Motion) -> float:
    """Compute the lowest point of a robot in the samples of a motion.

    For links without collision shapes visual ones are used; planes are ignored.

    Args:
        robot: The robot.
        motion: The motion; other joints are at zero.

    Returns:
        Height in the map, in [m]; of the links' origins if there are no shapes.
    """
    return float(lowest_heights(robot, motion).min())


def lowest_heights(robot: Description, motion: Motion) -> np.ndarray:
    """Like ``lowest_height``, of each sample, shape (n_samples,)."""
    positions = of_robot(motion.joint_names, motion.positions, robot)
    bases = motion.base_poses
    if bases is None:
        bases = np.broadcast_to(IDENTITY, (len(positions), 7))
    place = Kinematics(robot).link_poses
    poses = np.array([place(base, row) for base, row in zip(bases, positions)])
    lowest = []
    links = [link for link in robot.links if link.name != WORLD]
    for row, link in enumerate(links):
        for points, radius in _outlines(link):
            lowest.append(_lowest(poses[:, row], points) - radius)
    return np.min(lowest or [poses[..., 2].min(axis=1)], axis=0)


def standing_base(robot: Description, positions: Mapping[str, float]) -> np.ndarray:
    """Compute an upright base pose above the map's origin on which the robot stands.

    Args:
        robot: The robot.
        positions: Positions of its joints, in [rad] or [m] by name.

    Returns:
        T_map_base, shape (7,), with which its lowest point is at height 0.
    """
    upright = IDENTITY.copy()
    upright[2] = -lowest_height(robot, configuration(positions, upright))
    return upright


def outlines(link: Link) -> tuple[np.ndarray, np.ndarray]:
    """Outline a link by its collision shapes, or else by its visual ones.

    Returns:
        Points in the frame of the link, shape (n, 3), and the radii around them, shape
        (n,), in [m]; its origin if it has no shapes.
    """
    found = [*_outlines(link)] or [(np.zeros((1, 3)), 0.0)]
    radii = [np.full(len(points), radius) for points, radius in found]
    return np.concatenate([points for points, _ in found]), np.concatenate(radii)


def _outlines(link: Link) -> Iterator[tuple[np.ndarray, float]]:
    """Outline each shape of a link: points in the link's frame, and their radius."""
    shapes = link.collisions or link.visuals
    meshes, _ = find_meshes(shapes)
    for shape in shapes:
        if shape.kind != "plane" and is_there(shape, meshes):
            points, radius = outline(shape, meshes)
            yield shape.pose[:3] + rotate(shape.pose[3:], points), radius


def on_floor(robot: Description, motion: Motion) -> Motion:
    """Lift or lower a whole motion so that its lowest point is at height 0.

    Args:
        robot: The robot.
        motion: With a base.

    Raises:
        MotionError: If it has no base.
    """
    if motion.base_poses is None:
        raise MotionError("The motion has no base, so it has no height.")
    T_map_motion = IDENTITY.copy()
    T_map_motion[2] = -lowest_height(robot, motion)
    return moved(motion, T_map_motion)


def _lowest(poses: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Compute the lowest heights of points of a link.

    Args:
        poses: Poses of the link in each sample, shape (n_samples, 7).
        points: Points in the link's frame, in [m], shape (n, 3).

    Returns:
        In [m], shape (n_samples,).
    """
    up = rotate(conjugate(poses[:, 3:]), np.array([0.0, 0.0, 1.0]))
    n_at_once = max(1, MAX_PRODUCTS // len(points))
    lowest = [
        (up[first : first + n_at_once] @ points.T).min(axis=1)
        for first in range(0, len(up), n_at_once)
    ]
    return poses[:, 2] + np.concatenate(lowest)
