"""Arrays to ROS messages and back. Message classes only, no rospy."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import genpy
import numpy as np
from gazebo_msgs.msg import LinkStates, ModelStates, WorldState
from geometry_msgs.msg import (
    Point,
    Pose,
    Transform,
    TransformStamped,
    Twist,
    Vector3,
    Wrench,
)
from sensor_msgs.msg import JointState

_COUNT = struct.Struct("<I")
_STAMP = struct.Struct("<III")


class PreparedLinkStates(LinkStates):
    """A LinkStates message whose bytes are ready."""

    data = b""

    def serialize(self, buff):
        """Write the prepared bytes, as rospy asks of a message."""
        buff.write(self.data)


class PreparedModelStates(ModelStates):
    """A ModelStates message whose bytes are ready."""

    data = b""

    def serialize(self, buff):
        """Write the prepared bytes, as rospy asks of a message."""
        buff.write(self.data)


class PreparedWorldState(WorldState):
    """A WorldState message whose bytes after the header are ready."""

    _has_header = False  # rospy would put its own count and time into it
    data = b""

    def serialize(self, buff):
        """Write header and prepared bytes, as rospy asks of a message."""
        self.header.serialize(buff)
        buff.write(self.data)


class PreparedJointState(JointState):
    """A JointState message whose bytes are ready."""

    _has_header = False  # rospy would put its own count and time into it
    data = b""

    def serialize(self, buff):
        """Write the prepared bytes, as rospy asks of a message."""
        buff.write(self.data)


class JointStateEncoder:
    """Write JointState messages; the names are only written when they change.

    Effort is left empty because it is not known.
    """

    def __init__(self) -> None:
        """Begin without names."""
        self._names: Sequence[str] | None = None
        self._seq = 0

    def encode(
        self,
        stamp: genpy.Time,
        names: Sequence[str],
        position: np.ndarray,
        velocity: np.ndarray,
    ) -> PreparedJointState:
        """Write one message.

        Args:
            stamp: When the joints were so.
            names: Joint names. The same object as last time costs nothing.
            position: In [rad] or [m], shape (n_joints,).
            velocity: In [rad/s] or [m/s], shape (n_joints,).
        """
        if names is not self._names:
            encoded = [name.encode("utf-8") for name in names]
            self._count = _COUNT.pack(len(encoded))
            strings = b"".join(_COUNT.pack(len(name)) + name for name in encoded)
            # Between stamp and names stands the empty frame_id.
            self._head = _COUNT.pack(0) + self._count + strings + self._count
            self._names = names
        self._seq += 1
        message = PreparedJointState()
        message.data = b"".join(
            (
                _STAMP.pack(self._seq, stamp.secs, stamp.nsecs),
                self._head,
                np.asarray(position, dtype="<f8").tobytes(),
                self._count,
                np.asarray(velocity, dtype="<f8").tobytes(),
                _COUNT.pack(0),
            )
        )
        return message


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


def transform(
    stamp: genpy.Time, parent: str, child: str, T_parent_child: Sequence[float]
) -> TransformStamped:
    """Make an edge of the TF tree from a pose, seven numbers."""
    message = TransformStamped(child_frame_id=child, transform=Transform())
    message.header.stamp = stamp
    message.header.frame_id = parent
    t, q = message.transform.translation, message.transform.rotation
    t.x, t.y, t.z = T_parent_child[:3]
    q.x, q.y, q.z, q.w = T_parent_child[3:]
    return message
