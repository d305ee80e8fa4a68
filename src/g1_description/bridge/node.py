"""The bridge's node: link states to joint states and TF, commands to the simulator.

Publishes: joint_states (sensor_msgs/JointState): for each state, with its stamp;
    robot_state (g1_description/RobotState): the same with the base, and what is
    commanded; tf_joint_states (sensor_msgs/JointState): those that go to TF;
    /diagnostics (diagnostic_msgs/DiagnosticArray)
Subscribes: <gazebo>/simulator_state (g1_description/SimulatorState) or, where there is
    none, <gazebo>/link_states (gazebo_msgs/LinkStates); joint_commands
    (sensor_msgs/JointState), and the topics of motion_topics.MotionTopics
Actions: <controller>/follow_joint_trajectory (control_msgs/FollowJointTrajectory)
Broadcasts: map -> base_link, throttled; static world -> map, base_link -> the
    robot's root, the IMU's link -> body_imu; fixed joints while time stands still
Calls: <gazebo>/set_model_configuration (gazebo_msgs/SetModelConfiguration)
Parameters: those of parameters.BridgeParameters
"""

from __future__ import annotations

import posixpath
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from functools import partial

import rospy
from tf2_msgs.msg import TFMessage

from g1_description.bridge.action import ACTION, FollowJointTrajectory
from g1_description.bridge.controllers import Controller
from g1_description.bridge.estimator import JointStateEstimator
from g1_description.bridge.health import BridgeHealth
from g1_description.bridge.history import (
    HistoryServices,
    announce_last_bag,
    keep_last_bag,
    record_joint_command,
)
from g1_description.bridge.motion_topics import MotionTopics
from g1_description.bridge.parameters import (
    BridgeParameters,
    RobotParameters,
    StaticFrames,
    controllers_of,
    topic_of,
    wait_for_descriptions,
)
from g1_description.bridge.robot import BridgedRobot
from g1_description.bridge.state_source import RisingStamps, StateSource
from g1_description.bridge.status import RobotStatus
from g1_description.errors import G1DescriptionError
from g1_description.motion.history import History
from g1_description.robot.description import Description
from g1_description.robot.launch_arguments import check_trails
from g1_description.ros.lifecycle import quiet_when_closing, start_node, unbroken
from g1_description.ros.log import SHORT_PERIOD, ThrottledLog
from g1_description.ros.map_frame import MapFrame
from g1_description.ros.parameters import read_parameters
from g1_description.ros.publisher import DirectPublisher
from g1_description.ros.rospy_tcp import serve_as_roscpp
from g1_description.ros.waiting import watch_publishers
from g1_description.ros.wire import LinkStatesArrays, MotorArrays
from g1_description.text import listed

MASTER_PERIOD = 1.0
"""Time between two calls of the master in [s] of wall time."""

TF_QUEUE_SIZE = 100
"""Transforms kept for a slow listener."""

HOUSEKEEPING_PERIOD = 0.02
"""Time between two rounds of housekeeping, in [s] of wall time."""

STANDSTILL = 0.03
"""Age of the last state in [s] of wall time from which time counts as stopped."""

CLOCK_STANDSTILL = 1.0
"""Age of the last state in [s] of wall time after which nodes that wait for the clock
have to be replaced."""

NEWCOMER_DELAYS = (0.1, 0.5, 2.0)
"""Times in [s] after which a new listener on /tf gets the last state again while time
stands still: it may connect to the bridge before it does to robot_state_publisher."""


class BridgeNode:
    """The callbacks, and the periodic housekeeping."""

    def __init__(
        self,
        parameters: BridgeParameters,
        robots: Sequence[tuple[RobotParameters, Description]],
        controllers: Sequence[Sequence[Controller]],
    ) -> None:
        p = parameters
        self._log = ThrottledLog()
        statuses = [
            RobotStatus(
                robot.name, description, History(p.history) if p.history else None
            )
            for robot, description in robots
        ]
        self._estimator = JointStateEstimator({s.name: s.description for s in statuses})
        self._stamps = RisingStamps()
        self._has_clock = False
        self._newcomer = threading.Event()
        self._repeats: list[float] = []
        self._tf = DirectPublisher(
            "/tf", TFMessage, TF_QUEUE_SIZE, on_newcomer=self._newcomer.set
        )
        self._robots = [
            BridgedRobot(robot, p, status, self._log, self._tf)
            for (robot, _), status in zip(robots, statuses)
        ]
        self._static_frames = StaticFrames(p, robots)
        frame = MapFrame((p.map_frame, p.world_frame))
        for (robot, _), bridged in zip(robots, self._robots):
            status, player = bridged.status, bridged.player
            topic = topic_of(robot, "joint_commands")
            bridged.commands.subscribe(
                topic, player.command, partial(record_joint_command, status)
            )
            MotionTopics(robot, status, player, frame, self._log)
            HistoryServices(robot, status)
            announce_last_bag(robot)
        self._actions = [
            FollowJointTrajectory(
                topic_of(robot, posixpath.join(controller.name, ACTION)),
                controller,
                bridged.status,
                bridged.player,
                self._log,
            )
            for (robot, _), bridged, own in zip(robots, self._robots, controllers)
            for controller in own
        ]
        self._source = StateSource(p.gazebo, p.max_rate, self._on_states, self._log)
        self._source.start()
        self._stopped = threading.Event()
        rospy.on_shutdown(self._stopped.set)
        rospy.on_shutdown(partial(_keep_last_bags, robots, statuses))
        threading.Thread(target=self._keep_house, daemon=True).start()
        # In a thread of its own: the master may take long to answer, or be gone.
        watch_publishers(self._look_at_publishers, MASTER_PERIOD)
        BridgeHealth(p.gazebo, self._source, statuses, self._log).start()

    def _look_at_publishers(self, publishers: Mapping[str, list[str]]) -> None:
        """Find other nodes that publish joint states; log new ones."""
        own = rospy.get_name()
        clocks = publishers.get("/clock", ())
        for robot in self._robots:
            found = publishers.get(robot.topic, ())
            others = tuple(node for node in found if node != own)
            new = {*others} - {*robot.status.other_publishers}
            robot.status.other_publishers = others
            for node in sorted(new):
                topics = f"/clock and {robot.topic}" if node in clocks else robot.topic
                self._log.warn(
                    f"publisher {node} {robot.topic}",
                    f"{node} also publishes {topics}: subscribers get both. To view a "
                    "bag, stop this launch and use "
                    "roslaunch g1_description view.launch.",
                )

    def _on_states(
        self,
        stamp: int,
        states: LinkStatesArrays,
        motors: Mapping[str, MotorArrays],
    ) -> None:
        """Publish one state as joint states and, throttled, on TF."""
        rising = self._stamps.next(stamp, rospy.Time.now().to_nsec())
        if rising is None:
            return
        stamp, went_back = rising
        if went_back:
            text = "Time went back: the bridge starts over."
            self._log.warn("time", text, SHORT_PERIOD, rospy.loginfo)
            self._estimator.reset()
            for robot in self._robots:
                robot.begin_again()
            for action in self._actions:
                action.reset(stamp)
        found = self._estimator.update(*states, stamp)
        if self._estimator.duplicates:
            names = listed(self._estimator.duplicates)
            text = f"Duplicate links in a message, the first one is used: {names}."
            self._log.warn("duplicates", text)
        for robot, state, problems in zip(
            self._robots, found, self._estimator.problems
        ):
            robot.publish(state, problems, motors.get(robot.status.name))
        for action in self._actions:
            action.on_state()

    def _keep_house(self) -> None:
        """Run the periodic work until the node is shut down."""
        while not self._stopped.wait(HOUSEKEEPING_PERIOD):
            with quiet_when_closing():
                self._source.keep_up()
                self._tf.flush()
                for robot in self._robots:
                    robot.flush()
                for action in self._actions:
                    action.keep_up(self._source.is_connected)
                is_repeat_due = self._is_repeat_due()
                with self._source.lock:
                    if self._stands_still:
                        self._settle(is_repeat_due)

    def _settle(self, is_repeat_due: bool) -> None:
        """Show the last state on TF while time stands still."""
        if not self._has_clock or self._source.age > CLOCK_STANDSTILL:
            self._static_frames.send_fixed_joints()
        if is_repeat_due:
            stamp = self._stamps.again()
            for robot in self._robots:
                robot.publish_again(stamp)
        for robot in self._robots:
            robot.settle()

    @property
    def _stands_still(self) -> bool:
        """Whether states have stopped, other than by a reset."""
        age, now = self._source.age, rospy.Time.now().to_nsec()
        self._has_clock = self._has_clock or now > 0
        was_reset = self._has_clock and self._stamps.is_ahead_of(now)
        return age is not None and age > STANDSTILL and not was_reset

    def _is_repeat_due(self) -> bool:
        """Whether a new listener may have missed the last state."""
        now = time.monotonic()
        if self._newcomer.is_set():
            self._newcomer.clear()
            self._repeats = [now + delay for delay in NEWCOMER_DELAYS]
        due = [moment for moment in self._repeats if moment <= now]
        self._repeats = self._repeats[len(due) :]
        return bool(due)


def _keep_last_bags(
    robots: Sequence[tuple[RobotParameters, Description]],
    statuses: Sequence[RobotStatus],
) -> None:
    """Keep the histories of all robots, also after an exception."""
    with unbroken:
        for (robot, _), status in zip(robots, statuses):
            try:
                keep_last_bag(robot, status)
            except G1DescriptionError as error:
                rospy.logwarn("The history of %s is lost: %s", status.name, error)


def main() -> None:
    """Run the node ``link_states_bridge``."""
    serve_as_roscpp()
    start_node("link_states_bridge")
    try:
        parameters = read_parameters(BridgeParameters)
        robots = wait_for_descriptions(parameters.each_robot)
        controllers = [controllers_of(*robot) for robot in robots]
        check_trails("~trails", parameters.trails.split(), [one for _, one in robots])
    except G1DescriptionError as error:
        rospy.logfatal("%s", error)
        sys.exit(1)
    except rospy.ROSInterruptException:  # shut down while waiting
        return
    BridgeNode(parameters, robots, controllers)
    rospy.spin()
