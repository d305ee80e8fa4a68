"""The node ``replay``: shows a motion from a file without a simulator.

Publishes: joint_states (sensor_msgs/JointState), /tf (tf2_msgs/TFMessage):
    map -> base_link, /tf_static: base_link -> root link
Parameters: those of ReplayParameters, and robot_description
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rospy
import tf2_ros
from sensor_msgs.msg import JointState

from g1_description.bridge.parameters import BridgeParameters, base_child, static_edges
from g1_description.errors import G1DescriptionError, InvalidValueError
from g1_description.motion.files.formats import read_motion
from g1_description.motion.files.source import ReadOptions
from g1_description.motion.motion import Motion, sample
from g1_description.motion.paths import motion_path
from g1_description.robot.description import Description
from g1_description.robot.transform import IDENTITY
from g1_description.ros.conversions import transform
from g1_description.ros.lifecycle import quiet_when_closing, start_node
from g1_description.ros.parameters import (
    DESCRIPTION,
    check_range,
    read_parameters,
    read_robot,
)

REST = 1.0
"""Pause before a motion starts again, in [s]."""


@dataclass(frozen=True)
class ReplayParameters:
    """Parameters of the node that shows a motion."""

    motion: str = ""
    """Motion file."""

    bag: str = ""
    """Rosbag with the motion."""

    topic: str = ""
    """Topic of the bag with the joints; empty: chosen automatically."""

    fps: float = 0.0
    """Samples per second of a file without times, in [Hz]; 0: unknown."""

    order: str = ""
    """Order of the base's quaternions in the file, xyzw or wxyz."""

    format: str = ""
    """Format of the file; empty: by its content."""

    speed: float = 1.0
    """Playback speed: seconds of the motion per second."""

    loop: bool = True
    """Repeat the motion; otherwise hold its last pose."""

    publish_rate: float = 60.0
    """Rate of joint_states and TF, in [Hz]."""

    def __post_init__(self) -> None:
        """Check ranges."""
        if not self.file:
            raise InvalidValueError("No motion file; give motion:=FILE or bag:=FILE.")
        if self.motion and self.bag:
            raise InvalidValueError("motion:= and bag:= cannot be combined.")
        if not self.path.is_absolute():
            raise InvalidValueError(
                f"The motion file must be an absolute path (got '{self.file}'); try "
                f"$PWD/{self.file}."
            )
        if self.order not in ("", "xyzw", "wxyz"):
            raise InvalidValueError(f"order must be xyzw or wxyz (got '{self.order}').")
        check_range(self, "fps", 0.0, 1e6)
        check_range(self, "speed", 1e-3, 1e3)
        check_range(self, "publish_rate", 0.1, 1e3)

    @property
    def file(self) -> str:
        """The file of either kind."""
        return self.motion or self.bag

    @property
    def path(self) -> Path:
        """Path of the file."""
        return motion_path(self.file)


class Replay:
    """Publishes a motion, in a loop by default."""

    def __init__(
        self, motion: Motion, robot: Description, parameters: ReplayParameters
    ) -> None:
        self._motion = motion
        self._parameters = parameters
        self._frames = BridgeParameters()
        self._base = base_child(self._frames, robot)
        self._names = [joint.name for joint in robot.movable_joints]
        names = self._motion.joint_names
        self._columns = [self._names.index(name) for name in names]
        self._states = rospy.Publisher("joint_states", JointState, queue_size=10)
        self._tf = tf2_ros.TransformBroadcaster()
        self._static = tf2_ros.StaticTransformBroadcaster()
        now = rospy.Time.now()
        edges = static_edges(self._frames, robot)
        self._static.sendTransform([transform(now, *e, IDENTITY) for e in edges])

    def run(self) -> None:
        """Show the motion until the node is shut down."""
        rate = rospy.Rate(self._parameters.publish_rate, reset=True)
        begin = rospy.Time.now()
        with quiet_when_closing():
            while not rospy.is_shutdown():
                now = rospy.Time.now()
                begin = min(begin, now)  # simulated time may be reset
                self._show(now, self._time((now - begin).to_sec()))
                rate.sleep()

    def _time(self, elapsed: float) -> float:
        """Return the time of the motion to show, in [s]."""
        speed = self._parameters.speed
        time = elapsed * speed
        if self._parameters.loop:
            time %= self._motion.duration + REST * speed
        return self._motion.begin + time

    def _show(self, stamp: rospy.Time, time: float) -> None:
        """Publish the configuration at a time of the motion."""
        found = sample(self._motion, time)
        message = JointState(name=self._names)
        message.header.stamp = stamp
        # Joints without a motion are at zero.
        position, velocity = np.zeros(len(self._names)), np.zeros(len(self._names))
        position[self._columns] = found.positions
        velocity[self._columns] = self._parameters.speed * found.velocities
        message.position, message.velocity = position.tolist(), velocity.tolist()
        self._states.publish(message)
        if self._base is not None:
            pose = IDENTITY if found.base_poses is None else found.base_poses
            edge = transform(stamp, self._frames.map_frame, self._base, pose.tolist())
            self._tf.sendTransform(edge)


def report(motion: Motion) -> None:
    """Log the motion's size and the notes of its reader."""
    for note in motion.notes:
        rospy.logwarn("%s", note)
    if motion.base_poses is None:
        rospy.logwarn("The motion has no base: it is shown at the origin of the map.")
    rospy.loginfo("%d samples, %.2f s.", len(motion.times), motion.duration)


def main() -> None:
    """Run the node ``replay``."""
    start_node("replay")
    try:
        parameters = read_parameters(ReplayParameters)
        robot = read_robot(DESCRIPTION)
        options = ReadOptions(
            parameters.fps or None,
            parameters.topic or None,
            parameters.order or None,
            parameters.format or None,
        )
        motion = read_motion(parameters.path, robot, options)
    except G1DescriptionError as error:
        rospy.logfatal("%s", error)
        sys.exit(1)
    report(motion)
    Replay(motion, robot, parameters).run()
