"""The service play_motion, as a command uses it that may be ended at any moment.

Calls: play_motion (g1_description/PlayMotion)
"""

from __future__ import annotations

import threading

import rospy
from trajectory_msgs.msg import MultiDOFJointTrajectoryPoint

from g1_description.motion.trajectory import Trajectory
from g1_description.msg import RobotTrajectory
from g1_description.ros.conversions import to_transform
from g1_description.ros.motion_messages import durations_of, message_of_joints
from g1_description.ros.waiting import NoAnswerError


class RefusedError(NoAnswerError):
    """The bridge, or the simulator, does not play a motion."""


class MotionClient:
    """Asks a robot's bridge for motions, and stops what it has asked for."""

    def __init__(self, service: rospy.ServiceProxy) -> None:
        """Prepare; nothing is called yet.

        Args:
            service: The robot's service play_motion.
        """
        self._service = service
        self._lock = threading.Lock()
        self.is_left = False
        """Whether no motion may begin any more."""
        self.may_move = False
        """Whether the robot may be on its way."""

    def play(self, trajectory: Trajectory) -> tuple[int, str]:
        """Let the robot go through a motion, at once.

        Returns:
            When its times count from, in [ns], and what was not done as requested.

        Raises:
            NoAnswerError: If that is refused, or nobody answers.
            ROSInterruptException: If the robot was left.
        """
        with self._lock:
            # Before the question: who leaves sets is_left before it looks at may_move.
            self.may_move = len(trajectory.times) > 1 or trajectory.times[0] > 0.0
            if self.is_left:
                self.may_move = False
                raise rospy.ROSInterruptException("interrupted")
            try:
                return self._call(_message(trajectory))
            except RefusedError:
                self.may_move = False
                raise

    def stop(self) -> None:
        """Stop the robot where it is.

        Raises:
            NoAnswerError: If that is refused, or nobody answers.
        """
        with self._lock:
            self._call(RobotTrajectory())
            self.may_move = False

    def leave(self) -> bool:
        """Begin no motion any more, and stop the robot if it may be on its way.

        It may be called from any thread. A motion that the bridge has been asked for is
        stopped as soon as it has answered.

        Returns:
            Whether the robot was stopped.

        Raises:
            NoAnswerError: If that is refused, or nobody answers.
        """
        self.is_left = True
        if not self.may_move:
            return False
        self.stop()
        return True

    def _call(self, message: RobotTrajectory) -> tuple[int, str]:
        """Call the bridge."""
        try:
            answer = self._service(message)
        except (rospy.ServiceException, OSError) as error:
            name = self._service.resolved_name
            raise NoAnswerError(
                f"{name} does not answer, is the bridge running? {error}"
            ) from error
        if not answer.success:
            raise RefusedError(f"The motion is refused: {answer.status_message}")
        return answer.start.to_nsec(), answer.status_message


def _message(trajectory: Trajectory) -> RobotTrajectory:
    """Write a motion as a message."""
    message = RobotTrajectory()
    if trajectory.joint_names:
        message.joint_trajectory = message_of_joints(trajectory)
    if trajectory.base_poses is not None:
        base = message.multi_dof_joint_trajectory
        base.joint_names = ["base"]
        base.points = [
            MultiDOFJointTrajectoryPoint(
                transforms=[to_transform(pose)], time_from_start=time
            )
            for pose, time in zip(
                trajectory.base_poses.tolist(), durations_of(trajectory)
            )
        ]
    return message
