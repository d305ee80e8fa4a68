"""The bridge's node: link states to joint states and TF, commands to the simulator.

Publishes: joint_states (sensor_msgs/JointState): for each link_states message
Subscribes: <gazebo>/link_states (gazebo_msgs/LinkStates), joint_commands
    (sensor_msgs/JointState)
Broadcasts: map -> base_link, throttled; static world -> map, base_link -> the
    robot's root, imu_in_torso -> body_imu
Calls: <gazebo>/set_model_configuration (gazebo_msgs/SetModelConfiguration)
Parameters: those of parameters.BridgeParameters
"""

from __future__ import annotations

import sys
import time

import numpy as np
import rospy
import tf2_ros
from sensor_msgs.msg import JointState

from ..core.commands import split_command
from ..core.description import Description, parse_urdf
from ..core.errors import G1DescriptionError, WireFormatError
from ..core.joints import (
    MeasuredJoints,
    joint_positions,
    joint_velocities,
    measured_joints,
)
from ..core.throttle import PoseThrottle
from ..core.transform import IDENTITY
from .command_sender import CommandSender
from .link_states import LinkStatesArrays, LinkStatesDecoder
from .messages import joint_state, transform
from .parameters import BridgeParameters, read_parameters
from .shutdown import quiet_when_closing, start_node

QUEUE = 100
BUFFER = 1 << 20
"""Bytes read from link_states at once: some hundred messages of a humanoid."""


class Robot:
    """One robot's share of the link states: its joints and its root."""

    def __init__(self, model_name: str, description: Description) -> None:
        """Begin without having seen the robot.

        Args:
            model_name: The robot in the simulated world.
            description: The robot as its file tells it.
        """
        self._scope = f"{model_name}::"
        self._description = description
        self._names: tuple[str, ...] | None = None
        self._rows: list[int] = []
        self.joints: MeasuredJoints | None = None
        self.root: int | None = None
        self._last = None

    def find(self, names: tuple[str, ...]) -> None:
        """Find the robot's links among the names of a message.

        Args:
            names: Scoped names. The same tuple as last time costs nothing.
        """
        if names is self._names:
            return
        self._names = names
        links = [
            name[len(self._scope) :] if name.startswith(self._scope) else None
            for name in names
        ]
        self.joints = measured_joints(self._description, links)
        by_preference = (self._description.root, *self._description.link_names)
        present = (links.index(link) for link in by_preference if link in links)
        self.root = next(present, None)
        self._rows = [row for row, link in enumerate(links) if link is not None]
        self.reset()

    def is_finite(self, states: LinkStatesArrays) -> bool:
        """Tell whether all numbers of the robot's links are numbers."""
        sums = states.poses[self._rows].sum() + states.twists[self._rows].sum()
        return bool(np.isfinite(sums))

    def measure(self, states: LinkStatesArrays):
        """Measure joint positions and velocities, each shape (n_joints,)."""
        position = joint_positions(states.poses, self.joints, self._last)
        self._last = position
        return position, joint_velocities(states.poses, states.twists, self.joints)

    def reset(self) -> None:
        """Forget the last positions, which continuous joints go on from."""
        self._last = None


class BridgeNode:
    """The callbacks; each input message makes its outputs with one stamp."""

    def __init__(self, parameters: BridgeParameters, description: Description) -> None:
        """Make the topics.

        Args:
            parameters: The node's parameters.
            description: The robot.
        """
        self._parameters = p = parameters
        self._movable = frozenset(joint.name for joint in description.movable_joints)
        self._robot = Robot(p.model_name, description)
        self._base = base_child(p, description)
        self._decoder = LinkStatesDecoder()
        self._throttle = PoseThrottle(
            p.position_threshold, p.rotation_threshold, p.max_interval, p.min_interval
        )
        self._last_stamp = rospy.Time()
        self._joint_states = rospy.Publisher(
            "joint_states", JointState, queue_size=QUEUE
        )
        self._broadcaster = tf2_ros.TransformBroadcaster()
        self._static_broadcaster = tf2_ros.StaticTransformBroadcaster()
        self._static_broadcaster.sendTransform(
            [
                transform(rospy.Time.now(), parent, child, IDENTITY)
                for parent, child in static_edges(p, description)
            ]
        )
        self._sender = CommandSender(
            f"{p.gazebo}/set_model_configuration", p.model_name, p.robot_description
        )
        self._sender.start()
        rospy.Subscriber(
            "joint_commands", JointState, self._command_came, tcp_nodelay=True
        )
        rospy.Subscriber(
            f"{p.gazebo}/link_states",
            rospy.AnyMsg,
            self._link_states_came,
            queue_size=QUEUE,
            buff_size=BUFFER,
            tcp_nodelay=True,
        )

    def _command_came(self, message: JointState) -> None:
        """Pass on what can be obeyed of a command."""
        accepted, complaints = split_command(
            message.name, message.position, self._movable
        )
        if complaints:
            rospy.logwarn_throttle_identical(
                1.0, f"Of a joint command is ignored: {'; '.join(complaints)}."
            )
        if accepted:
            self._sender.put(accepted)

    def _link_states_came(self, message: rospy.AnyMsg) -> None:
        """Turn one message into joint states and, now and then, TF."""
        stamp = rospy.Time.now()
        if not stamp:
            return  # simulated time has not come yet, and a stamp is not invented
        if stamp < self._last_stamp:
            self._reset()
        self._last_stamp = stamp
        try:
            states = self._decoder.decode(message._buff)
        except WireFormatError as error:
            rospy.logwarn_throttle(1.0, f"A link_states message is no such: {error}")
            return
        self._robot.find(states.names)
        if self._robot.root is None:
            self._tell_absence(states.names)
            return
        if not self._robot.is_finite(states):
            rospy.logwarn_throttle(
                10.0, "A link_states message is dropped, the robot has NaN in it."
            )
            return
        with quiet_when_closing():
            self._publish(stamp, states)

    def _publish(self, stamp: rospy.Time, states: LinkStatesArrays) -> None:
        """Publish what one message tells."""
        joints = self._robot.joints
        if joints.missing:
            rospy.logwarn_throttle(
                10.0,
                f"Joints are left out, the simulator has no link {joints.missing}.",
            )
        position, velocity = self._robot.measure(states)
        self._joint_states.publish(joint_state(stamp, joints.names, position, velocity))
        root_pose = states.poses[self._robot.root]
        if self._base and self._throttle.passes(stamp.to_sec(), root_pose):
            p = self._parameters
            self._broadcaster.sendTransform(
                transform(stamp, p.map_frame, self._base, root_pose)
            )

    def _reset(self) -> None:
        """Take it that simulated time began again."""
        rospy.loginfo("Time went back: starting anew.")
        self._throttle.reset()
        self._robot.reset()

    def _tell_absence(self, names: tuple[str, ...]) -> None:
        """Say that the robot is not in the simulated world."""
        models = dict.fromkeys(name.split("::")[0] for name in names)
        rospy.logwarn_throttle(
            10.0,
            f"The simulator has no model {self._parameters.model_name}; "
            f"it has {', '.join(models) or 'none'}.",
        )


def base_child(parameters: BridgeParameters, description: Description) -> str | None:
    """Find the frame that moves in the map.

    Args:
        parameters: Names of the frames above.
        description: The robot; its frame names come from its file.

    Returns:
        base_link; the root where base_link is a link below it, which has a parent
        already; None where the root itself is the world or the map.
    """
    p = parameters
    if description.root in (p.world_frame, p.map_frame):
        return None
    below = p.base_frame in description.link_names and p.base_frame != description.root
    return description.root if below else p.base_frame


def static_edges(
    parameters: BridgeParameters, description: Description
) -> list[tuple[str, str]]:
    """List the static edges around a robot, all of them identities.

    Args:
        parameters: Names of the frames above.
        description: The robot.

    Returns:
        Parent and child of world -> map, base_link -> root where base_link is no
        link of the robot, and imu_in_torso -> body_imu where the robot has one.
    """
    p = parameters
    edges = [(p.world_frame, p.map_frame)]
    if base_child(p, description) not in (None, description.root):
        edges.append((p.base_frame, description.root))
    if p.imu_link in description.link_names:
        edges.append((p.imu_link, p.imu_frame))
    return edges


def wait_for_description(name: str) -> Description | None:
    """Wait for the robot on the parameter server.

    Args:
        name: The parameter.

    Returns:
        The robot, or None if the node was shut down before it came.

    Raises:
        DescriptionError: If what came is no robot.
    """
    while not rospy.is_shutdown():
        if rospy.has_param(name):
            return parse_urdf(str(rospy.get_param(name)))
        rospy.loginfo_once("Waiting for a robot on the parameter %s.", name)
        time.sleep(0.1)
    return None


def main() -> None:
    """Run the node ``link_states_bridge``."""
    start_node("link_states_bridge")
    try:
        parameters = read_parameters(BridgeParameters)
        description = wait_for_description(parameters.robot_description)
    except G1DescriptionError as error:
        rospy.logfatal("%s", error)
        sys.exit(1)
    if description is not None:
        BridgeNode(parameters, description)
        rospy.spin()
