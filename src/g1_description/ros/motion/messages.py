"""Messages of trajectories to trajectories."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from g1_description.core.errors import MotionError, UnknownNameError
from g1_description.core.motion.trajectory import Trajectory
from g1_description.core.text import listed, similar_first


def trajectory_from_message(
    message: JointTrajectory, joints: Collection[str]
) -> Trajectory:
    """Convert a trajectory of joints.

    Accelerations and efforts are ignored.

    Args:
        message: The trajectory, with at least one point.
        joints: Names of the joints that it may move.

    Returns:
        The same, with times since the stamp of the message's header.

    Raises:
        UnknownNameError: If it names other joints, or none.
        MotionError: If it has no points, a point has not a number per joint, only some
            points have velocities, or numbers do not make a motion.
    """
    names, points = message.joint_names, message.points
    check_joint_names(names, joints)
    if not points:
        raise MotionError("The trajectory has no points.")
    positions = _rows(points, "positions", len(names))
    velocities = None
    if any(point.velocities for point in points):
        _check_all_have_velocities(points)
        velocities = _rows(points, "velocities", len(names))
    times = np.array([point.time_from_start.to_nsec() for point in points]) / 1e9
    return Trajectory(times, tuple(names), positions, velocities)


def check_joint_names(names: Sequence[str], joints: Collection[str]) -> None:
    """Check that names are those of joints.

    Raises:
        UnknownNameError: If one is not, or there are none.
    """
    if not names:
        raise UnknownNameError("The trajectory names no joints.")
    unknown = [name for name in names if name not in joints]
    if unknown:
        raise UnknownNameError(
            f"The trajectory names {listed(unknown)}; the joints are "
            f"{listed(similar_first(unknown[0], joints))}."
        )


def _check_all_have_velocities(points: Sequence[JointTrajectoryPoint]) -> None:
    """Check that no point is without velocities."""
    without = [n for n, point in enumerate(points, 1) if not point.velocities]
    if without:
        raise MotionError(
            f"Point {without[0]} has no velocities, others have; give them for all "
            "points or for none."
        )


def _rows(
    points: Sequence[JointTrajectoryPoint], what: str, n_joints: int
) -> np.ndarray:
    """Return the positions or velocities of all points, shape (n, n_joints)."""
    rows = [getattr(point, what) for point in points]
    for number, row in enumerate(rows, 1):
        if len(row) != n_joints:
            raise MotionError(
                f"Point {number} has {len(row)} {what}; there are {n_joints} joints."
            )
    return np.array(rows, dtype=float)
