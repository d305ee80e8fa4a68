"""How a robot begins a motion that its motors are to follow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from g1_description.core.errors import InvalidValueError
from g1_description.core.motion.trajectory import SINGLE_TIME, Trajectory
from g1_description.core.robot.assembly import Assembly
from g1_description.core.transform import IDENTITY, compose, inverse
from g1_description.sim.model import Model
from g1_description.sim.standing import hanging_height, standing_height


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
