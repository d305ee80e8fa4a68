"""The bridge's node: link states to joint states and TF, commands to the simulator.

Publishes: joint_states (sensor_msgs/JointState): for each state, with its stamp;
    tf_joint_states (sensor_msgs/JointState): those of them that go to TF;
    /diagnostics (diagnostic_msgs/DiagnosticArray)
Subscribes: <gazebo>/world_state (gazebo_msgs/WorldState) or, where there is none,
    <gazebo>/link_states (gazebo_msgs/LinkStates); joint_commands
    (sensor_msgs/JointState)
Broadcasts: map -> base_link, throttled; static world -> map, base_link -> the
    robot's root, imu_in_torso -> body_imu; fixed joints while time stands still
Calls: <gazebo>/set_model_configuration (gazebo_msgs/SetModelConfiguration)
Parameters: those of parameters.BridgeParameters
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterable, Sequence

import genpy
import numpy as np
import rospy
import tf2_ros
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage

from g1_description.core.bridge.commands import listed
from g1_description.core.bridge.observer import Observer, Sight
from g1_description.core.bridge.stamps import RisingStamps
from g1_description.core.errors import G1DescriptionError
from g1_description.core.robot.description import Description
from g1_description.core.transform import IDENTITY
from g1_description.ros.node.complaints import Complaints
from g1_description.ros.node.parameters import read_parameters
from g1_description.ros.node.shutdown import quiet_when_closing, start_node
from g1_description.ros.transport.direct_publisher import DirectPublisher
from g1_description.ros.transport.tcpros import serve_as_roscpp
from g1_description.ros.wire.conversions import stamp_from_ns, transform
from g1_description.ros.wire.link_states import LinkStatesArrays

from .descriptions import wait_for_descriptions
from .frames import fixed_edges, static_edges
from .health import BridgeHealth
from .parameters import BridgeParameters, RobotParameters
from .robot import BridgedRobot
from .sender import CommandSender
from .state_source import StateSource

QUEUE = 100
"""Transforms kept for a slow listener."""

UPKEEP = 0.02
"""Time between two looks at what no message would do, in [s] of wall time."""

STILL = 0.03
"""Without a state for this long, in [s] of wall time, time stands still."""

PAUSED = 1.0
"""Without a state for this long, in [s] of wall time, who waits for the clock waits in
vain."""

BEHIND = 100_000_000
"""A clock that is further behind the last state, in [ns], has gone back. What is of the
time before then is not sent any more: it would spoil what listeners know."""

AGAIN = (0.1, 0.5, 2.0)
"""When time stands still, a newcomer on /tf is shown the last state after these, in
[s]: it may be connected to us before it is to robot_state_publisher."""


class BridgeNode:
    """The callbacks; each state makes its outputs with one stamp."""

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
        self._robots = [
            BridgedRobot(robot, description, p, self._complaints)
            for robot, description in robots
        ]
        self._observer = Observer({r.name: r.description for r in self._robots})
        self._stamps = RisingStamps()
        self._sight: Sight | None = None
        self._has_clock = self._has_new_time = False
        self._clock = 0
        self._newcomer = threading.Event()
        self._again: list[float] = []
        self._tf = DirectPublisher(
            "/tf", TFMessage, QUEUE, on_newcomer=self._newcomer.set
        )
        self._static_broadcaster = tf2_ros.StaticTransformBroadcaster()
        self._broadcast_static_frames(p, robots)
        self._sender = CommandSender(
            f"{p.gazebo}/set_model_configuration",
            {robot.name: robot.description for robot, _ in robots},
            self._complaints.tell,
        )
        self._sender.start()
        for robot in self._robots:
            robot.listen(self._sender)
        self._source = StateSource(p.gazebo, p.max_rate, self._take, self._complaints)
        self._source.start()
        self._stopped = threading.Event()
        rospy.on_shutdown(self._stopped.set)
        threading.Thread(target=self._keep_up, daemon=True).start()
        BridgeHealth(
            p.gazebo, self._source, self._sender, self._robots, self._complaints
        ).start()

    def _broadcast_static_frames(
        self,
        p: BridgeParameters,
        robots: Sequence[tuple[RobotParameters, Description]],
    ) -> None:
        """Send all edges that do not move, in one message."""
        self._static_edges = {
            (parent, child): IDENTITY
            for robot, description in robots
            for parent, child in static_edges(p, description, robot.frame_prefix)
        }
        self._fixed_edges = {
            (parent, child): pose
            for robot, description in robots
            for parent, child, pose in fixed_edges(description, robot.frame_prefix)
        }
        self._send_static(self._static_edges)

    def _send_static(self, edges: dict[tuple[str, str], np.ndarray]) -> None:
        """Send edges that do not move, in one message; the last such message counts."""
        now = rospy.Time.now()
        self._static_broadcaster.sendTransform(
            [transform(now, *edge, pose.tolist()) for edge, pose in edges.items()]
        )

    def _send_fixed(self) -> None:
        """Send the robots' fixed joints, as nobody else may have done it.

        robot_state_publisher sends them by a timer, which waits for the clock.
        """
        is_certain = not self._has_clock or self._source.age > PAUSED
        if self._fixed_edges and is_certain:
            self._send_static({**self._static_edges, **self._fixed_edges})
            self._fixed_edges = {}

    def _take(self, stamp_ns: int, states: LinkStatesArrays) -> None:
        """Turn one state into joint states and, now and then, TF."""
        if self._is_of_old_time(stamp_ns):
            return
        stamp_ns, went_back = self._stamps.next(stamp_ns)
        if went_back:
            self._reset()
        self._sight = self._observer.see(*states, 1e-9 * stamp_ns)
        if self._observer.twice:
            names = listed(self._observer.twice)
            self._complaints.tell(
                "twice", f"Links come more than once, the first counts: {names}."
            )
        self._publish(stamp_from_ns(stamp_ns))

    def _is_of_old_time(self, stamp_ns: int) -> bool:
        """Whether a state is late: its time ended, and the clock has begun anew.

        What was published before a reset may still be on its way after it.
        """
        now = rospy.Time.now().to_nsec()
        if now < self._clock - BEHIND:
            self._has_new_time = True
        self._clock = now
        if self._has_new_time and stamp_ns <= now + 10 * BEHIND:
            self._has_new_time = False
        return self._has_new_time

    def _publish(self, stamp: genpy.Time, again: bool = False) -> None:
        """Publish the last state."""
        sight = self._sight
        with quiet_when_closing():
            self._broadcast(
                robot.publish(stamp, sight, share, again)
                for robot, share in zip(self._robots, sight.shares)
            )

    def _broadcast(self, edges: Iterable[TransformStamped | None]) -> None:
        """Send the edges there are in one message."""
        found = [edge for edge in edges if edge is not None]
        if found:
            self._tf.publish(TFMessage(found))

    def _reset(self) -> None:
        """Take it that simulated time began again."""
        self._complaints.tell(
            "time", "Time went back: starting anew.", 1.0, rospy.loginfo
        )
        self._observer.reset()
        for robot in self._robots:
            robot.reset()

    def _keep_up(self) -> None:
        """Do what no message would, until the node is shut down."""
        while not self._stopped.wait(UPKEEP):
            with quiet_when_closing():
                self._source.look_after()
                self._tf.flush()
                for robot in self._robots:
                    robot.flush()
                is_wanted = self._is_wanted_again()
                with self._source.lock:
                    if self._stands_still:
                        self._send_fixed()
                        if is_wanted:
                            self._show_again()
                        self._broadcast(robot.settle() for robot in self._robots)

    @property
    def _stands_still(self) -> bool:
        """Whether there was a state, and none follows, of this time or another."""
        age, now = self._source.age, rospy.Time.now().to_nsec()
        self._has_clock = self._has_clock or now > 0
        went_back = self._has_clock and now < self._stamps.last - BEHIND
        return age is not None and age > STILL and not went_back

    def _is_wanted_again(self) -> bool:
        """Whether somebody has just come who may have missed the last state."""
        now = time.monotonic()
        if self._newcomer.is_set():
            self._newcomer.clear()
            self._again = [now + delay for delay in AGAIN]
        due = [moment for moment in self._again if moment <= now]
        self._again = self._again[len(due) :]
        return bool(due)

    def _show_again(self) -> None:
        """Show the last state on TF once more."""
        for robot in self._robots:
            robot.reset()
        self._publish(stamp_from_ns(self._stamps.again()), again=True)


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
