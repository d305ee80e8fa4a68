"""The goal that a controller is going to."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from actionlib import ServerGoalHandle
from control_msgs.msg import FollowJointTrajectoryFeedback, FollowJointTrajectoryGoal
from trajectory_msgs.msg import JointTrajectoryPoint

from g1_description.bridge.controllers import Controller
from g1_description.errors import MotionError, UnknownNameError
from g1_description.motion.playlist import Following, Playback, Progress, remaining
from g1_description.motion.tolerances import (
    JointTolerance,
    Tolerances,
    tolerances_of_goal,
)
from g1_description.motion.trajectory import Trajectory
from g1_description.robot.state import RobotState
from g1_description.ros.conversions import stamp_from_ns
from g1_description.ros.motion_messages import trajectory_from_message
from g1_description.text import listed

FEEDBACK_PERIOD = 50_000_000
"""Time between two messages of feedback, in [ns] of simulated time."""


class ActiveGoal:
    """A goal that the robot is going to, and how far it is."""

    next_feedback = 0
    """When feedback is due, in [ns]."""

    is_seen = False
    """Whether a state came since it began."""

    def __init__(
        self, handle: ServerGoalHandle, following: Following, playback: Playback
    ) -> None:
        """Begin.

        Args:
            handle: actionlib's handle of the goal.
            following: The trajectory.
            playback: What is left of it.
        """
        self.handle, self.following = handle, following
        self._playback = playback
        self._names: Sequence[str] | None = None
        self._columns: list[int] = []

    @property
    def is_replaced(self) -> bool:
        """Whether another command has taken joints of it."""
        return len(self._playback.rows) < len(self.following.joint_names)

    def actual(self, state: RobotState) -> np.ndarray:
        """Return the positions and velocities of its joints, shape (2, n_joints).

        Raises:
            UnknownNameError: If the state does not have all of them.
        """
        if state.names is not self._names:
            wanted = self.following.joint_names
            missing = [name for name in wanted if name not in state.names]
            if missing:
                raise UnknownNameError(
                    f"The simulator does not tell of {listed(missing)} any longer."
                )
            self._columns = [state.names.index(name) for name in wanted]
            self._names = state.names
        return np.stack([state.positions, state.velocities])[:, self._columns]

    def publish_feedback(self, stamp: int, progress: Progress) -> None:
        """Publish feedback, if it is due at a time in [ns]."""
        if stamp >= self.next_feedback:
            self.next_feedback = stamp + FEEDBACK_PERIOD
            message = _feedback(self.following, stamp, progress)
            self.handle.publish_feedback(message)


def _feedback(
    following: Following, stamp: int, progress: Progress
) -> FollowJointTrajectoryFeedback:
    """Tell where the joints should be, where they are, and the difference."""
    message = FollowJointTrajectoryFeedback(joint_names=list(following.joint_names))
    message.header.stamp = stamp_from_ns(stamp)
    elapsed = stamp_from_ns(stamp - following.start_ns) - stamp_from_ns(0)
    for point, rows in (
        (message.desired, progress.desired),
        (message.actual, progress.actual),
        (message.error, progress.error),
    ):
        _fill(point, rows)
        point.time_from_start = elapsed
    return message


def _fill(point: JointTrajectoryPoint, rows: np.ndarray) -> None:
    """Write positions and velocities, shape (2, n_joints), into a point."""
    point.positions, point.velocities = rows.tolist()


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
