"""Conversion of trajectory messages to motions and back."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import genpy
import numpy as np
from trajectory_msgs.msg import (
    JointTrajectory,
    JointTrajectoryPoint,
    MultiDOFJointTrajectoryPoint,
)

from g1_description.errors import MotionError, UnknownNameError
from g1_description.motion.motion import Motion, configuration
from g1_description.msg import RobotTrajectory
from g1_description.ros.conversions import to_transform
from g1_description.text import listed, similar_first

if TYPE_CHECKING:
    from g1_description.ros.map_frame import MapFrame

MAP = ("", "map", "world")
"""Frames of a base without TF."""


def trajectory_from_message(
    message: JointTrajectory, joints: Collection[str]
) -> Motion:
    """Convert a trajectory of joints.

    Accelerations and efforts are ignored.

    Args:
        message: The trajectory, with at least one point.
        joints: Names of the joints that it may move.

    Returns:
        The motion, with times since the stamp of the message's header.

    Raises:
        UnknownNameError: If it has other joints, or none.
        MotionError: If it has no points, lengths differ, only some points have
            velocities, or numbers are invalid.
    """
    names, points = message.joint_names, message.points
    check_joint_names(names, joints)
    if not points:
        raise MotionError("The trajectory has no points.")
    positions = _rows(points, "positions", len(names))
    velocities = None
    if any(point.velocities for point in points):
        without = [n for n, point in enumerate(points, 1) if not point.velocities]
        if without:
            raise MotionError(
                f"Point {without[0]} has no velocities; all points or none must have "
                "them."
            )
        velocities = _rows(points, "velocities", len(names))
    return Motion(_times(points), tuple(names), positions, velocities)


def whole_body_message(
    motion: Motion, stamp: genpy.Time | None = None
) -> RobotTrajectory:
    """Convert a motion of joints and base; it starts at a time, by default at once."""
    message, counts = RobotTrajectory(), np.rint(1e9 * motion.times).tolist()
    times = [genpy.Duration(*divmod(int(count), 1_000_000_000)) for count in counts]
    joints, base = message.joint_trajectory, message.multi_dof_joint_trajectory
    if motion.joint_names:
        speeds = motion.velocities
        rates = [[]] * len(times) if speeds is None else speeds.tolist()
        joints.joint_names = list(motion.joint_names)
        joints.points = [
            JointTrajectoryPoint(positions=row, velocities=rate, time_from_start=time)
            for row, rate, time in zip(motion.positions.tolist(), rates, times)
        ]
    if motion.base_poses is not None:
        base.joint_names = ["base"]
        base.points = [
            MultiDOFJointTrajectoryPoint(
                transforms=[to_transform(pose)], time_from_start=time
            )
            for pose, time in zip(motion.base_poses.tolist(), times)
        ]
    for part in (joints, base):
        part.header.stamp = stamp or genpy.Time()
    return message


def configuration_message(
    positions: Mapping[str, float], base: np.ndarray
) -> RobotTrajectory:
    """Convert a configuration to command at once.

    Args:
        positions: Positions of joints in [rad] or [m], by name.
        base: Pose of the base in the map, shape (7,).
    """
    return whole_body_message(configuration(positions, base))


def motion_from_message(
    message: RobotTrajectory | JointTrajectory, joints: Collection[str]
) -> Motion:
    """Convert a motion of joints, or of joints and a base in the map.

    Raises:
        UnknownNameError: If it has other joints.
        MotionError: If it is no motion, or its base is in another frame.
    """
    if isinstance(message, JointTrajectory):
        return trajectory_from_message(message, joints)
    motion = whole_body_from_message(message, joints)
    if motion is None:
        raise MotionError("The message has no points.")
    return motion


def check_joint_names(names: Sequence[str], joints: Collection[str]) -> None:
    """Check the joint names of a trajectory.

    Raises:
        UnknownNameError: If one is unknown, or there are none.
    """
    if not names:
        raise UnknownNameError("The trajectory has no joint names.")
    unknown = [name for name in names if name not in joints]
    if unknown:
        raise UnknownNameError(
            f"The trajectory has unknown joints: {listed(unknown)}; the joints are "
            f"{listed(similar_first(unknown[0], joints))}."
        )


def _rows(
    points: Sequence[JointTrajectoryPoint], field: str, n_joints: int
) -> np.ndarray:
    """Return the positions or velocities of all points, shape (n, n_joints)."""
    rows = [getattr(point, field) for point in points]
    for number, row in enumerate(rows, 1):
        if len(row) != n_joints:
            raise MotionError(
                f"Point {number} must have {n_joints} {field} (got {len(row)})."
            )
    return np.array(rows, dtype=float)


def whole_body_from_message(
    message: RobotTrajectory,
    joints: Collection[str],
    frame: MapFrame | None = None,
) -> Motion | None:
    """Convert a motion of joints and base.

    Velocities and accelerations of the base are ignored.

    Args:
        message: The motion.
        joints: Names of the joints that it may move.
        frame: Transforms the base's poses to the map; None: they must be in the map.

    Returns:
        The motion; None if it has no points.

    Raises:
        UnknownNameError: If it has other joints.
        MotionError: If the times of joints and base differ, the base's frame is
            unknown, or numbers are invalid.
    """
    arms, base = message.joint_trajectory, message.multi_dof_joint_trajectory
    if not base.points:
        return trajectory_from_message(arms, joints) if arms.points else None
    if len(base.joint_names) > 1:
        raise MotionError(
            f"The base must be a single joint (got {listed(base.joint_names)})."
        )
    poses = np.array([_base_pose(n, point) for n, point in enumerate(base.points, 1)])
    if frame is not None:
        poses = frame.pose_in_map(poses, base.header.frame_id, base.header.stamp)
    elif base.header.frame_id.lstrip("/") not in MAP:
        raise MotionError(
            f"The base must be in the frame map (got {base.header.frame_id})."
        )
    times = _times(base.points)
    if not arms.points:
        return Motion(times, (), np.zeros((len(times), 0)), base_poses=poses)
    motion = trajectory_from_message(arms, joints)
    if not np.array_equal(motion.times, times):
        raise MotionError("The points of base and joints must have the same times.")
    return replace(motion, base_poses=poses)


def pose_from_numbers(pose: np.ndarray) -> np.ndarray:
    """Check a pose and normalize its quaternion.

    Args:
        pose: Position and quaternion (x, y, z, w), shape (7,); a zero quaternion is
            the identity, as in Gazebo.

    Raises:
        MotionError: If a number is not finite, or the quaternion is far from unit
            length.
    """
    if not pose[3:].any():
        pose = np.append(pose[:6], 1.0)
    still = Motion(np.zeros(1), (), np.zeros((1, 0)), base_poses=pose[np.newaxis])
    return still.base_poses[0]


def _base_pose(number: int, point: MultiDOFJointTrajectoryPoint) -> list[float]:
    """Return the pose of the base in a point, seven numbers."""
    if len(point.transforms) != 1:
        raise MotionError(
            f"Point {number} of the base must have 1 transform (got "
            f"{len(point.transforms)})."
        )
    t, q = point.transforms[0].translation, point.transforms[0].rotation
    return [t.x, t.y, t.z, q.x, q.y, q.z, q.w]


def _times(points: Sequence) -> np.ndarray:
    """Return the times of points in [s], shape (n,)."""
    return np.array([point.time_from_start.to_nsec() for point in points]) / 1e9
