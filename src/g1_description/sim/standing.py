"""How high a robot stands, and how high it hangs clear of the floor."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from g1_description.errors import DescriptionError, InvalidValueError
from g1_description.motion.trajectory import SINGLE_TIME, Trajectory
from g1_description.robot.assembly import Assembly
from g1_description.robot.description import Shape, origin_reaches
from g1_description.robot.rotation import rotate
from g1_description.robot.transform import IDENTITY, compose, inverse
from g1_description.sim.meshes.hulls import outline
from g1_description.sim.meshes.shapes import Mesh, find_meshes, is_there
from g1_description.sim.model import Model

GAP = 0.0005
"""Least distance from the floor, in [m]: what touches is pushed away."""

HULL_MARGIN = 0.001
"""How thick PyBullet makes a hull on all sides, in [m]."""


def standing_height(assembly: Assembly, rotation: np.ndarray) -> float:
    """Find the height at which a robot stands on the floor, which is z = 0.

    Args:
        assembly: The robot, its joints where they begin.
        rotation: How the model frame is turned in the world, shape (4,).

    Returns:
        The least height of the model frame in whole millimetres, in [m], at which all
        collision shapes are above the floor; without any, all links' origins.
    """
    pose = np.concatenate([IDENTITY[:3], rotation])
    model = Model("standing", assembly, pose)
    boxes = [box for _, box in _boxes(model)]
    lowest = min((box[0, 2] for box in boxes), default=math.inf)
    if math.isinf(lowest):
        lowest = model.poses[:, 2].min(initial=0.0)
    return _above(-lowest)


def hanging_height(assembly: Assembly, rotation: np.ndarray) -> float:
    """Find a height at which no joint can bring a robot to the floor, which is z = 0.

    Args:
        assembly: The robot.
        rotation: How the model frame is turned in the world, shape (4,).

    Returns:
        Height of the model frame in whole millimetres, in [m]. The root link's origin
        is then higher than the farthest that a collision shape, or the origin of a
        link, can be from it, joints anywhere within their limits.

    Raises:
        DescriptionError: If a joint slides without limits.
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
            f"A joint of '{description.name}' slides without limits, no height is out "
            "of its reach: say how high the robot hangs."
        )
    return _above(reach - rotate(rotation, assembly.root_pose[:3])[2])


def _above(height: float) -> float:
    """Return the next whole millimetre above a height, in [m], with a gap between."""
    return math.ceil((height + GAP) * 1000.0) / 1000.0


def _boxes(model: Model) -> Iterator[tuple[str, np.ndarray]]:
    """Bound each collision shape by a box along the world's axes.

    Args:
        model: The robot, where it is.

    Yields:
        The link's name, and the lowest and highest corner in the world, in [m], shape
        (2, 3). A mesh that is left out has none, and a plane has no end.
    """
    links = [link for link in model.assembly.description.links if link.collisions]
    meshes, _ = find_meshes(shape for link in links for shape in link.collisions)
    poses = dict(zip(model.link_names, model.poses))
    for link in links:
        for shape in link.collisions:
            if is_there(shape, meshes) and link.name in poses:
                yield (
                    link.name,
                    _box(shape, compose(poses[link.name], shape.pose), meshes),
                )


def _box(shape: Shape, pose: np.ndarray, meshes: Mapping[str, Mesh]) -> np.ndarray:
    """Bound a shape at a pose in the world by a box, shape (2, 3)."""
    if shape.kind == "plane":
        return np.array([[math.inf] * 3, [math.inf] * 3])
    points, radius = outline(shape, meshes)
    turned = pose[:3] + rotate(pose[3:], points)
    margin = radius if shape.kind in ("box", "sphere") else HULL_MARGIN
    return np.array([turned.min(axis=0) - margin, turned.max(axis=0) + margin])


def at_beginning(assembly: Assembly, motion: Trajectory) -> Assembly:
    """Put joints where a motion begins; the others at zero, all inside their limits.

    Raises:
        InvalidValueError: If the robot has none of the motion's joints.
    """
    first = dict(zip(motion.joint_names, motion.positions[0].tolist()))
    joints = assembly.description.movable_joints
    if not any(joint.name in first for joint in joints):
        name = assembly.description.name
        raise InvalidValueError(f"there is nothing of {name} that the motion can move")
    begin = {
        joint.name: float(np.clip(first.get(joint.name, 0.0), joint.lower, joint.upper))
        for joint in joints
    }
    return replace(assembly, positions=begin)


def place(
    assembly: Assembly, motion: Trajectory, on_floor: bool, hangs: bool
) -> tuple[np.ndarray, float]:
    """Place a robot where a motion begins; without a base in it, upright on the floor.

    Args:
        assembly: The robot, its joints where the motion begins.
        motion: The motion.
        on_floor: Whether it stands on the floor, however high the motion has it.
        hangs: Whether it hangs clear of the floor instead.

    Returns:
        Pose of the model frame in the world, shape (7,), and by how much that is above
        where the motion has it, in [m]; 0 where the motion has no base.
    """
    pose = np.array(IDENTITY)
    if motion.base_poses is not None:
        pose = compose(motion.base_poses[0], inverse(assembly.root_pose))
    wanted = float(pose[2])
    if hangs:
        pose[2] = hanging_height(assembly, pose[3:])
    elif on_floor or motion.base_poses is None:
        pose[2] = standing_height(assembly, pose[3:])
    return pose, 0.0 if motion.base_poses is None else float(pose[2]) - wanted


def complete(model: Model, motion: Trajectory) -> Trajectory:
    """Let a motion hold the joints that it does not have, and a single sample of it.

    Args:
        model: The robot, where the motion begins.
        motion: The motion; joints that the robot does not have are left out.

    Returns:
        A motion of all joints of the robot, of at least two samples.
    """
    columns = {name: column for column, name in enumerate(motion.joint_names)}
    known = [row for row, name in enumerate(model.joint_names) if name in columns]
    own = [columns[model.joint_names[row]] for row in known]
    positions = np.tile(model.position, (len(motion.times), 1))
    positions[:, known] = motion.positions[:, own]
    if len(motion.times) == 1:
        return _held(motion, model.joint_names, positions)
    velocities = None
    if motion.velocities is not None:
        velocities = np.zeros_like(positions)
        velocities[:, known] = motion.velocities[:, own]
    names, bases = model.joint_names, motion.base_poses
    return Trajectory(motion.times, names, positions, velocities, bases)


def _held(
    motion: Trajectory, names: tuple[str, ...], positions: np.ndarray
) -> Trajectory:
    """Hold a single configuration: motors that follow none are not watched."""
    bases = motion.base_poses
    return Trajectory(
        motion.times[0] + np.array([0.0, SINGLE_TIME]),
        names,
        np.repeat(positions, 2, axis=0),
        base_poses=None if bases is None else np.repeat(bases, 2, axis=0),
    )
