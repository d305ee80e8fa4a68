"""Goals of follow_joint_trajectory, read."""

from __future__ import annotations

from control_msgs.msg import FollowJointTrajectoryGoal

from g1_description.core.errors import MotionError
from g1_description.core.motion.following import remaining
from g1_description.core.motion.tolerances import (
    JointTolerance,
    Tolerances,
    tolerances_of_goal,
)
from g1_description.core.motion.trajectory import Trajectory
from g1_description.ros.motion.messages import trajectory_from_message

from .controllers import Controller


class OldTrajectoryError(MotionError):
    """All points of a trajectory are in the past."""


def trajectory_of_goal(
    goal: FollowJointTrajectoryGoal, controller: Controller, now_ns: int
) -> Trajectory:
    """Read what of a goal's trajectory is still to come.

    Args:
        goal: The goal, with at least one point.
        controller: The joints that it may move.
        now_ns: The time in [ns].

    Raises:
        UnknownNameError: If it has joints that the controller does not have.
        OldTrajectoryError: If nothing of it is to come.
        MotionError: If it is no trajectory.
    """
    message = goal.trajectory
    trajectory = trajectory_from_message(message, controller.joints)
    start = message.header.stamp.to_nsec()
    if not start and len(trajectory.times) == 1:
        return trajectory
    elapsed = (now_ns - start) / 1e9 if start else 0.0
    rest = remaining(trajectory, elapsed)
    if rest is None:
        late = elapsed - trajectory.duration
        raise OldTrajectoryError(
            f"The last point of the trajectory is {late:.3g} s in the past."
        )
    return rest


def tolerances_in_goal(
    goal: FollowJointTrajectoryGoal, controller: Controller
) -> Tolerances:
    """Read what tolerances a goal asks for.

    Raises:
        InvalidValueError: If one is NaN.
    """
    path, end = (
        [JointTolerance(one.name, one.position, one.velocity) for one in asked]
        for asked in (goal.path_tolerance, goal.goal_tolerance)
    )
    return tolerances_of_goal(
        goal.trajectory.joint_names,
        controller.constraints,
        path,
        end,
        goal.goal_time_tolerance.to_sec(),
    )
