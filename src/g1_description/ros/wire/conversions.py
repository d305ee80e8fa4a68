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
    Wrench,
)


def stamp_from_ns(time_ns: int) -> genpy.Time:
    """Convert a time in [ns]."""
    return genpy.Time(time_ns // 1_000_000_000, time_ns % 1_000_000_000)


def vector_to_array(vector: Vector3 | Point) -> np.ndarray:
    """Give the coordinates, shape (3,)."""
    return np.array([vector.x, vector.y, vector.z])


def wrench_to_array(wrench: Wrench) -> np.ndarray:
    """Give force and torque, shape (6,)."""
    parts = (vector_to_array(part) for part in (wrench.force, wrench.torque))
    return np.concatenate([*parts])


def pose_to_array(pose: Pose) -> np.ndarray:
    """Give position and quaternion (x, y, z, w) as they came, shape (7,)."""
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
    """Give linear and angular velocity, shape (6,)."""
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
    """Make an edge of the TF tree from a pose, seven numbers."""
    message = TransformStamped(
        child_frame_id=child, transform=to_transform(T_parent_child)
    )
    message.header.stamp = stamp
    message.header.frame_id = parent
    return message
