"""The topics on which a robot takes motions."""

from __future__ import annotations

from functools import partial

import rospy
from gazebo_msgs.msg import ModelState
from geometry_msgs.msg import PoseStamped
from trajectory_msgs.msg import JointTrajectory

from g1_description.core.errors import G1DescriptionError, MotionError
from g1_description.core.motion.trajectory import Trajectory
from g1_description.msg import RobotTrajectory
from g1_description.ros.bridge.parameters import RobotParameters
from g1_description.ros.bridge.robot import topic_of
from g1_description.ros.bridge.status import RobotStatus
from g1_description.ros.node.throttled_log import SHORT_PERIOD, ThrottledLog
from g1_description.ros.transport.direct_publisher import DirectPublisher
from g1_description.ros.wire.conversions import pose_from_array, pose_to_array

from .map_frame import MapFrame
from .messages import (
    check_joint_names,
    pose_from_numbers,
    trajectory_from_message,
    whole_body_from_message,
)
from .player import MotionPlayer

QUEUE_SIZE = 1000
"""Poses kept for a busy simulator: a second of them at 1 kHz."""


class MotionTopics:
    """Hands the motions of one robot to its player.

    Subscribes: joint_trajectory (trajectory_msgs/JointTrajectory), base_command
        (geometry_msgs/PoseStamped), motion (g1_description/RobotTrajectory)
    Publishes: <gazebo>/set_model_state (gazebo_msgs/ModelState)
    """

    def __init__(
        self,
        gazebo: str,
        robot: RobotParameters,
        status: RobotStatus,
        player: MotionPlayer,
        log: ThrottledLog,
    ) -> None:
        """Subscribe.

        Args:
            gazebo: Namespace of the simulator.
            robot: The robot's names.
            status: The robot.
            player: What plays its motions.
            log: Where to log what cannot be done.
        """
        self._status, self._player, self._log = status, player, log
        self._map = MapFrame()
        self._joints = [joint.name for joint in status.description.movable_joints]
        self._states = DirectPublisher(
            f"{gazebo}/set_model_state", ModelState, QUEUE_SIZE
        )
        for name, kind, act in (
            ("joint_trajectory", JointTrajectory, self._on_joint_trajectory),
            ("base_command", PoseStamped, self._on_base_command),
            ("motion", RobotTrajectory, self._on_motion),
        ):
            # Messages may move different joints, so none of them may be lost.
            rospy.Subscriber(
                topic_of(robot, name),
                kind,
                partial(self._obey, name, act),
                queue_size=None,
                tcp_nodelay=True,
            )

    def _obey(self, topic: str, act, message) -> None:
        """Do what a message wants, or log why not."""
        try:
            problem = act(message)
        except G1DescriptionError as error:
            problem = f"refused, {error}"
        if problem:
            key = f"{topic} {self._status.name}"
            text = f"{topic} of {self._status.name}: {problem}"
            self._log.warn(key, text, SHORT_PERIOD)

    def _on_joint_trajectory(self, message: JointTrajectory) -> str:
        """Play a motion of joints, or stop them; return what was not done."""
        names = message.joint_names
        if not message.points:
            if names:
                check_joint_names(names, self._joints)
            return self._player.stop(names or self._joints).message
        trajectory = trajectory_from_message(message, self._joints)
        return self._play(trajectory, message.header.stamp)

    def _on_motion(self, message: RobotTrajectory) -> str:
        """Play a motion of joints and base, or stop them; return what was not done."""
        trajectory = whole_body_from_message(message, self._joints, self._map)
        if trajectory is None:
            return self._player.stop().message
        joints, base = message.joint_trajectory, message.multi_dof_joint_trajectory
        header = joints.header if joints.points else base.header
        return self._play(trajectory, header.stamp)

    def _play(self, trajectory: Trajectory, stamp: rospy.Time) -> str:
        """Play a motion; return what was not done."""
        start, now = stamp.to_nsec(), rospy.Time.now().to_nsec()
        is_configuration = trajectory.duration == 0.0
        if is_configuration:
            later = start if start > now else None
            played = self._player.stream(trajectory, later)
            return played.message
        late = 1e-9 * (now - start) - trajectory.duration
        if start and late > 0.0:
            raise MotionError(f"it was over {late:.3f} s ago")
        played = self._player.play(trajectory, start or None)
        return played.message if played.success else f"refused, {played.message}"

    def _on_base_command(self, message: PoseStamped) -> str:
        """Put the robot somewhere by its root link."""
        pose = pose_from_numbers(pose_to_array(message.pose))
        header = message.header
        pose = self._map.pose_in_map(pose, header.frame_id, header.stamp)
        name = self._status.name
        self._states.publish(ModelState(model_name=name, pose=pose_from_array(pose)))
        return ""
