"""The commanded configuration as a second robot, for RViz.

Publishes: commanded_joint_states (sensor_msgs/JointState), /tf (tf2_msgs/TFMessage):
    map -> root link of the ghost
"""

from __future__ import annotations

import numpy as np
import rospy
import tf2_ros
from sensor_msgs.msg import JointState

from g1_description.core.bridge.estimator import Observation
from g1_description.ros.wire.conversions import stamp_from_ns, transform

from .player import MotionPlayer

PREFIX = "ghost/"
"""What the names of its frames begin with."""

PERIOD = 20_000_000
"""Least time between two messages, in [ns]."""


class Ghost:
    """Shows where one robot is wanted."""

    def __init__(self, topic: str, root: str, frame: str) -> None:
        """Advertise the topic.

        Args:
            topic: Its name.
            root: Frame of the robot's root link.
            frame: Name of the map.
        """
        self._states = rospy.Publisher(topic, JointState, queue_size=10, latch=True)
        self._tf = tf2_ros.TransformBroadcaster()
        self._root, self._frame = PREFIX + root, frame
        self.reset()

    def reset(self) -> None:
        """Begin again, as time did."""
        self._shown = -PERIOD

    def show(self, stamp: int, seen: Observation, player: MotionPlayer) -> None:
        """Show what is wanted, where a message is due.

        Args:
            stamp: Time of the state in [ns].
            seen: Where the robot is: so is the ghost, where nothing is wanted.
            player: What knows where the robot is wanted.
        """
        if stamp - self._shown < PERIOD or seen.base_pose is None:
            return
        self._shown = stamp
        time = stamp_from_ns(stamp)
        wanted, names = player.wanted, player.joint_names
        measured = dict(zip(seen.names, seen.position.tolist()))
        positions = {
            name: measured.get(name) if np.isnan(position) else position
            for name, position in zip(names, wanted.positions.tolist())
        }
        known = {n: p for n, p in positions.items() if p is not None}
        message = JointState(name=list(known), position=list(known.values()))
        message.header.stamp = time
        self._states.publish(message)
        pose = seen.base_pose
        if not np.isnan(wanted.base_pose).any():
            pose = wanted.base_pose
        self._tf.sendTransform(transform(time, self._frame, self._root, pose.tolist()))
