"""The bridge's node: link states to joint states and TF, commands to the simulator.

Publishes: joint_states (sensor_msgs/JointState): for each link_states message;
    /diagnostics (diagnostic_msgs/DiagnosticArray)
Subscribes: <gazebo>/link_states (gazebo_msgs/LinkStates), joint_commands
    (sensor_msgs/JointState)
Broadcasts: map -> base_link, throttled; static world -> map, base_link -> the
    robot's root, imu_in_torso -> body_imu
Calls: <gazebo>/set_model_configuration (gazebo_msgs/SetModelConfiguration)
Parameters: those of parameters.BridgeParameters
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Sequence

import rospy
import tf2_ros

from ..core.commands import listed
from ..core.description import Description
from ..core.errors import G1DescriptionError, WireFormatError
from ..core.observer import Observer, Sight
from ..core.transform import IDENTITY
from .backlog import Backlog
from .bridge_health import BridgeHealth
from .bridge_robot import BridgedRobot
from .command_sender import CommandSender
from .complaints import Complaints
from .descriptions import wait_for_descriptions
from .frames import static_edges
from .link_states import LinkStatesArrays, LinkStatesDecoder
from .messages import transform
from .parameters import BridgeParameters, RobotParameters, read_parameters
from .shutdown import quiet_when_closing, start_node
from .tcpros import serve_as_roscpp

QUEUE = 100
"""Messages that may come at once; of more the newest count."""

BUFFER = 1 << 16
"""Bytes read from link_states at once: a dozen messages of a humanoid."""


class BridgeNode:
    """The callbacks; each input message makes its outputs with one stamp."""

    def __init__(
        self,
        parameters: BridgeParameters,
        robots: Sequence[tuple[RobotParameters, Description]],
    ) -> None:
        """Make the topics.

        Args:
            parameters: The node's parameters.
            robots: Names and descriptions of the robots.
        """
        p = parameters
        self._complaints = Complaints()
        self.robots = [
            BridgedRobot(robot, description, p, self._complaints)
            for robot, description in robots
        ]
        self._observer = Observer({r.name: r.description for r in self.robots})
        self._decoder = LinkStatesDecoder()
        # rospy has a thread for each publisher of link states; there may be two.
        self._one_at_a_time = threading.Lock()
        self._backlog = Backlog(QUEUE)
        self._kept: bytes | None = None
        self._last_stamp = rospy.Time()
        self.last_came: float | None = None
        """When the last good message came, on the monotonic clock."""
        self.timeless = 0
        """Messages that came before any time on /clock."""
        self.malformed = 0
        """Messages that could not be read."""
        self._broadcaster = tf2_ros.TransformBroadcaster()
        self._static_broadcaster = tf2_ros.StaticTransformBroadcaster()
        self._broadcast_static_frames(p, robots)
        self.sender = CommandSender(
            f"{p.gazebo}/set_model_configuration",
            {robot.name: robot.description for robot, _ in robots},
            self._complaints.tell,
        )
        self.sender.start()
        for robot in self.robots:
            robot.listen(self.sender)
        self.topic = rospy.resolve_name(f"{p.gazebo}/link_states")
        self.subscriber = rospy.Subscriber(
            self.topic,
            rospy.AnyMsg,
            self._link_states_came,
            queue_size=QUEUE,
            buff_size=BUFFER,
            tcp_nodelay=True,
        )
        BridgeHealth(self, self._complaints).start()

    def _broadcast_static_frames(
        self,
        parameters: BridgeParameters,
        robots: Sequence[tuple[RobotParameters, Description]],
    ) -> None:
        """Send all edges that do not move, in one message."""
        edges = [
            edge
            for robot, description in robots
            for edge in static_edges(parameters, description, robot.frame_prefix)
        ]
        now = rospy.Time.now()
        self._static_broadcaster.sendTransform(
            [
                transform(now, parent, child, IDENTITY.tolist())
                for parent, child in dict.fromkeys(edges)
            ]
        )

    def _link_states_came(self, message: rospy.AnyMsg) -> None:
        """Turn one message into joint states and, now and then, TF."""
        with self._one_at_a_time:
            if self._backlog.is_old():
                self._kept = message._buff
            else:
                self._kept = None
                self._take(message._buff)
            self._backlog.end()

    def take_kept(self) -> None:
        """Take the last message that was passed over, if none came after it."""
        with self._one_at_a_time:
            kept, self._kept = self._kept, None
            if kept is not None:
                self._take(kept)

    @property
    def passed_over(self) -> int:
        """Messages that were passed over because newer ones had come."""
        return self._backlog.passed_over

    def _take(self, data: bytes) -> None:
        """Take one message's bytes."""
        stamp = rospy.Time.now()
        if not stamp:  # simulated time has not come yet, and a stamp is not invented
            self.timeless += 1
            return
        if stamp < self._last_stamp:
            self._reset()
        self._last_stamp = stamp
        try:
            states = self._decoder.decode(data)
        except WireFormatError as error:
            self.malformed += 1
            self._complaints.tell(
                "malformed", f"A message on {self.topic} cannot be read: {error}"
            )
            return
        self.last_came = time.monotonic()
        with quiet_when_closing():
            self._publish(stamp, states)

    def _publish(self, stamp: rospy.Time, states: LinkStatesArrays) -> None:
        """Publish what one message tells."""
        sight: Sight = self._observer.see(*states, stamp.to_sec())
        if self._observer.twice:
            names = listed(self._observer.twice)
            self._complaints.tell(
                "twice", f"Links come more than once, the first counts: {names}."
            )
        moved = [
            robot.publish(stamp, sight, share)
            for robot, share in zip(self.robots, sight.shares)
        ]
        moved = [edge for edge in moved if edge is not None]
        if moved:
            self._broadcaster.sendTransform(moved)

    def _reset(self) -> None:
        """Take it that simulated time began again."""
        self._complaints.tell(
            "time", "Time went back: starting anew.", 1.0, rospy.loginfo
        )
        self._observer.reset()
        for robot in self.robots:
            robot.reset()


def main() -> None:
    """Run the node ``link_states_bridge``."""
    serve_as_roscpp()
    start_node("link_states_bridge")
    try:
        parameters = read_parameters(BridgeParameters)
        robots = wait_for_descriptions(parameters.each_robot)
    except G1DescriptionError as error:
        rospy.logfatal("%s", error)
        sys.exit(1)
    if not rospy.is_shutdown():
        BridgeNode(parameters, robots)
        rospy.spin()
