"""Arrays to geometry messages and back."""

from __future__ import annotations

from collections.abc import Sequence

import genpy
import numpy as np
from geometry_msgs.msg import (
    Point,
    Pose,
    Transform,
    TransformStamped,
    Twist,
    Vector3,
)
from sensor_msgs.msg import JointState

from g1_description.errors import InvalidValueError
from g1_description.motion.motion import Motion
from g1_description.msg import ModelTrajectory
from g1_description.msg import RobotState as RobotStateMessage
from g1_description.robot.state import RobotState
from g1_description.text import listed

COMMAND_FIELDS = ("q", "dq", "kp", "kd", "tau")
"""Fields of commands to motors, in each message, in the order of ``PdCommand``."""


def stamp_from_ns(time_ns: int) -> genpy.Time:
    """Convert a time in [ns]."""
    return genpy.Time(time_ns // 1_000_000_000, time_ns % 1_000_000_000)


def vector_to_array(vector: Vector3 | Point) -> np.ndarray:
    """Convert a vector or point, shape (3,)."""
    return np.array([vector.x, vector.y, vector.z])


def pose_to_array(pose: Pose) -> np.ndarray:
    """Convert a pose, position and quaternion (x, y, z, w) unchecked, shape (7,)."""
    p, q = pose.position, pose.orientation
    return np.array([p.x, p.y, p.z, q.x, q.y, q.z, q.w])


def pose_from_array(array: np.ndarray) -> Pose:
    """Convert a pose, shape (7,)."""
    pose = Pose()
    pose.position.x, pose.position.y, pose.position.z = array[:3].tolist()
    q = pose.orientation
    q.x, q.y, q.z, q.w = array[3:].tolist()
    return pose


def twist_to_array(twist: Twist) -> np.ndarray:
    """Convert a twist, linear then angular, shape (6,)."""
    v, w = twist.linear, twist.angular
    return np.array([v.x, v.y, v.z, w.x, w.y, w.z])


def twist_from_array(array: np.ndarray) -> Twist:
    """Convert a twist, linear then angular, shape (6,)."""
    twist = Twist()
    twist.linear.x, twist.linear.y, twist.linear.z = array[:3].tolist()
    twist.angular.x, twist.angular.y, twist.angular.z = array[3:].tolist()
    return twist


def to_transform(T_parent_child: Sequence[float]) -> Transform:
    """Convert a pose, seven numbers."""
    message = Transform()
    t, q = message.translation, message.rotation
    t.x, t.y, t.z = T_parent_child[:3]
    q.x, q.y, q.z, q.w = T_parent_child[3:]
    return message


def transform(
    stamp: genpy.Time, parent: str, child: str, T_parent_child: Sequence[float]
) -> TransformStamped:
    """Make a transform message from a pose, seven numbers."""
    message = TransformStamped(
        child_frame_id=child, transform=to_transform(T_parent_child)
    )
    message.header.stamp = stamp
    message.header.frame_id = parent
    return message


def model_trajectory(
    model: str, motion: Motion, start_ns: int | None = None
) -> ModelTrajectory:
    """Write a motion as a message.

    Args:
        model: Name of the model in the simulator.
        motion: The motion.
        start_ns: Start of its times, in [ns]; None: the next step.
    """
    velocities, bases = motion.velocities, motion.base_poses
    return ModelTrajectory(
        model,
        stamp_from_ns(start_ns or 0),
        list(motion.joint_names),
        motion.times.tolist(),
        motion.positions.ravel().tolist(),
        [] if velocities is None else velocities.ravel().tolist(),
        [] if bases is None else bases.ravel().tolist(),
    )


def joint_states_to_arrays(
    message: JointState,
) -> tuple[tuple[str, ...], np.ndarray, np.ndarray | None]:
    """Return names, positions, and velocities if present, of joint states.

    Raises:
        InvalidValueError: If lengths differ, or a name is repeated.
    """
    names = tuple(message.name)
    for label, numbers in (
        ("position", message.position),
        ("velocity", message.velocity or message.position),
    ):
        if len(names) != len(numbers):
            raise InvalidValueError(
                f"joint_state must have one {label} per name (got {len(numbers)} for "
                f"{len(names)} names)."
            )
    if len({*names}) != len(names):
        twice = listed(dict.fromkeys(n for n in names if names.count(n) > 1))
        raise InvalidValueError(f"joint_state must not repeat a name (got {twice}).")
    velocities = np.array(message.velocity) if message.velocity else None
    return names, np.array(message.position), velocities


def robot_state_to_message(state: RobotState, frame: str) -> RobotStateMessage:
    """Convert a state with poses in a frame, the map."""
    message = RobotStateMessage(
        name=state.names,
        position=state.positions.tolist(),
        velocity=[] if state.velocities is None else state.velocities.tolist(),
        commanded_name=list(state.commanded),
        commanded_position=list(state.commanded.values()),
    )
    message.header.stamp = stamp_from_ns(state.stamp)
    message.header.frame_id = frame
    if state.base_pose is not None:
        message.has_base = True
        message.base_pose = pose_from_array(state.base_pose)
    if state.base_twist is not None:
        message.base_twist = twist_from_array(state.base_twist)
    if state.commanded_base is not None:
        message.has_commanded_base = True
        message.commanded_base_pose = pose_from_array(state.commanded_base)
    return message


def robot_state_from_message(message: RobotStateMessage) -> RobotState:
    """Convert a state.

    Raises:
        InvalidValueError: If lengths differ.
    """
    counts = len(message.position), len(message.velocity) or len(message.name)
    pairs = len(message.commanded_name), len(message.commanded_position)
    if {*counts} != {len(message.name)} or pairs[0] != pairs[1]:
        raise InvalidValueError(
            f"The lengths of a robot state must be equal (got {len(message.name)} "
            f"names, {counts[0]} positions, {counts[1]} velocities, and {pairs[0]} "
            f"commanded names with {pairs[1]} positions)."
        )
    return RobotState(
        message.header.stamp.to_nsec(),
        tuple(message.name),
        np.array(message.position),
        np.array(message.velocity) if message.velocity else None,
        pose_to_array(message.base_pose) if message.has_base else None,
        twist_to_array(message.base_twist) if message.has_base else None,
        dict(zip(message.commanded_name, message.commanded_position)),
        pose_to_array(message.commanded_base_pose)
        if message.has_commanded_base
        else None,
    )
