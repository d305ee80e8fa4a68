"""One robot of the bridge: its joint states, base on TF, ghost, trails and warnings."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import rospy
import tf2_ros
from geometry_msgs.msg import Point
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from g1_description.bridge.commands import JointCommands
from g1_description.bridge.estimator import LASTING, LinkProblems
from g1_description.bridge.parameters import (
    BridgeParameters,
    RobotParameters,
    base_child,
    topic_of,
)
from g1_description.bridge.player import MotionPlayer
from g1_description.bridge.status import SPAWN_GRACE, RobotStatus
from g1_description.bridge.tf_filter import PoseThrottle, TfFilter
from g1_description.msg import RobotState as RobotStateMessage
from g1_description.robot.assembly import WORLD, base_of
from g1_description.robot.description import FREE, Description
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.state import RobotState
from g1_description.ros.conversions import stamp_from_ns, transform
from g1_description.ros.lifecycle import quiet_when_closing
from g1_description.ros.log import SHORT_PERIOD, ThrottledLog
from g1_description.ros.publisher import DirectPublisher
from g1_description.ros.wire import (
    JointStateEncoder,
    MotorArrays,
    Prepared,
    write_robot_state,
)
from g1_description.text import listed

QUEUE_SIZE = 10_000
"""Joint states kept for a slow subscriber: a script that steps the simulator may be
seconds ahead of its own subscriber, which must get the states of each step."""

TF_QUEUE_SIZE = 100
"""Joint states kept for a slow robot_state_publisher; older ones are useless on TF."""


class BridgedRobot:
    """Publishes the states of one robot."""

    def __init__(
        self,
        robot: RobotParameters,
        parameters: BridgeParameters,
        status: RobotStatus,
        log: ThrottledLog,
        tf: DirectPublisher,
    ) -> None:
        p = parameters
        self.status, self._tf = status, tf
        self.commands = JointCommands(p.gazebo, status.name, status.commands, log)
        self.player = MotionPlayer(p.gazebo, status, self.commands)
        self._warnings = RobotWarnings(status, log)
        self._map_frame = p.map_frame
        base = base_child(p, status.description)
        self._base = base and robot.frame_prefix + base
        self._tf_filter = TfFilter(
            PoseThrottle(
                p.position_threshold,
                p.rotation_threshold,
                p.max_interval,
                p.min_interval,
            )
        )
        self._overlays = overlays_of(robot, p, status.description)
        self._encoder = JointStateEncoder()
        self._joint_states, self._robot_states, self._tf_joint_states = self._topics = [
            DirectPublisher(topic_of(robot, name), kind, size, latch=True)
            for name, kind, size in (
                ("joint_states", JointState, QUEUE_SIZE),
                ("robot_state", RobotStateMessage, QUEUE_SIZE),
                ("tf_joint_states", JointState, TF_QUEUE_SIZE),
            )
        ]

    @property
    def topic(self) -> str:
        """Full name of the topic of its joint states."""
        return self._joint_states.name

    def publish(
        self,
        state: RobotState,
        problems: LinkProblems,
        motors: MotorArrays | None = None,
    ) -> None:
        """Publish a state.

        Args:
            state: The state.
            problems: Problems of the robot's links.
            motors: Its motors; None if the simulator does not publish them.
        """
        state, is_sample = self.player.observe(state, motors)
        has_changed = problems is not self.status.problems
        self.status.state, self.status.problems = state, problems
        if has_changed or problems.are_any:
            self._warnings.check(state, problems)
        if not problems.is_present:
            self._tf_filter.drop()
            for topic in self._topics:
                topic.forget()
            return
        if self._overlays:
            with quiet_when_closing():
                for overlay in self._overlays:
                    overlay.show(state)
        self._joint_states.publish(self._encoder.encode(state))
        state = self._below_map(state)
        if self.status.history is not None:
            if motors is not None and motors.efforts is not None:
                state = replace(state, efforts=motors.of(state.names, motors.efforts))
            self.status.history.add(state)
        self._robot_states.publish(
            Prepared(partial(write_robot_state, state, self._map_frame))
        )
        self._send_to_tf(state, is_sample)

    def publish_again(self, stamp: int) -> None:
        """Send the last state to TF once more, for a new listener.

        Args:
            stamp: The stamp to send it with, in [ns].
        """
        self._tf_filter.reset()
        state, problems = self.status.state, self.status.problems
        if state is not None and problems is not None and problems.is_present:
            self._send_to_tf(self._below_map(replace(state, stamp=stamp)))

    def settle(self) -> None:
        """Send the last state to TF if it was not sent yet."""
        self._show(*self._tf_filter.settle())

    def _below_map(self, state: RobotState) -> RobotState:
        """Return a state without the base, if that is no child of the map."""
        if self._base is None:
            return replace(state, base_pose=None, base_twist=None)
        return state

    def _send_to_tf(self, state: RobotState, is_sample: bool = False) -> None:
        """Send the transforms that are due with a new state."""
        count = self.status.commands
        is_under_way = count.received > count.answered
        self._show(
            *self._tf_filter.next(
                state, time.monotonic(), count.received, is_under_way, is_sample
            )
        )

    def _show(self, joints: RobotState | None, base: RobotState | None) -> None:
        """Send a state's joints and another one's base in the map."""
        if joints is not None:
            self._tf_joint_states.publish(self._encoder.encode(joints))
        if base is not None and base.base_pose is not None:
            stamp, pose = stamp_from_ns(base.stamp), base.base_pose.tolist()
            edge = transform(stamp, self._map_frame, self._base, pose)
            self._tf.publish(TFMessage([edge]))

    def flush(self) -> None:
        """Send the queued messages of slow subscribers, and compress the history."""
        self.player.flush()
        for topic in self._topics:
            topic.flush()
        if self.status.history is not None:
            self.status.history.pack()
        self.status.tf_listeners = self._tf_joint_states.get_num_connections()

    def begin_again(self) -> None:
        """Forget everything: time began again."""
        self._tf_filter.reset()
        self.player.reset()
        for overlay in self._overlays:
            overlay.reset()


class RobotWarnings:
    """Logs problems of the links of one robot."""

    def __init__(self, status: RobotStatus, log: ThrottledLog) -> None:
        self._status, self._log = status, log
        self._was_present = self._came = False
        joints = status.description.joints
        found = [f"{j.name} ({j.kind})" for j in joints if j.kind in FREE]
        if found:
            rospy.logwarn(
                "Joints of %s are ignored, they have more than one degree of freedom: "
                "%s.",
                status.name,
                ", ".join(found),
            )

    def check(self, state: RobotState, problems: LinkProblems) -> None:
        """Log that the robot appeared, and problems of its links."""
        if problems.is_present and not self._was_present:
            name = self._status.name
            text = f"Found model {name}; publishing {len(state.names)} joints."
            self._log.warn(f"found {name}", text, SHORT_PERIOD, rospy.loginfo)
        if problems.missing or problems.invalid or not problems.is_present:
            self._warn_of_missing_links(problems)
        if problems.axis_residual:
            self._warn_of_rotated_joints(problems)
        self._was_present = problems.is_present
        self._came = self._came or problems.is_present

    def _warn_of_missing_links(self, problems: LinkProblems) -> None:
        """Warn that joints are ignored, as their links are unknown."""
        age = time.monotonic() - self._status.start
        if age < SPAWN_GRACE and not self._came:
            return
        if problems.invalid:
            reason = f"invalid poses for {listed(problems.invalid)}"
        elif problems.is_present:
            reason = f"no link {listed(problems.missing)}"
        elif self._status.vanishes:
            reason = "no link of it (links without mass are dropped, with all below)"
        else:
            reason = "no link of it (is it spawned with this name?)"
        name = self._status.name
        self._log.warn(
            f"missing {name}",
            f"Joints of {name} are ignored: the simulator has {reason}.",
            lasts=True,
        )

    def _warn_of_rotated_joints(self, problems: LinkProblems) -> None:
        """Warn that joints are rotated off their axes."""
        name, residual = self._status.name, problems.axis_residual
        angles = (f"{joint} by {angle:.3g} rad" for joint, angle in residual.items())
        self._log.warn(
            f"off axis {name}",
            f"Joints of {name} have been rotated off their axes for {LASTING:g} s of "
            f"simulated time: {listed(angles)}. Is its robot_description the one that "
            "was spawned?",
        )


GHOST = "ghost/"
"""Prefix of the names of a ghost's frames."""

GHOST_PERIOD = 20_000_000
"""Least time between two messages of a ghost, in [ns]."""


class Ghost:
    """Publishes the commanded configuration of one robot as a second robot."""

    def __init__(self, topic: str, root: str, frame: str) -> None:
        self._states = rospy.Publisher(topic, JointState, queue_size=10, latch=True)
        self._tf = tf2_ros.TransformBroadcaster()
        self._root, self._frame = GHOST + root, frame
        self.reset()

    def reset(self) -> None:
        """Start over, as time did."""
        self._shown = -GHOST_PERIOD

    def show(self, state: RobotState) -> None:
        """Publish the commanded state, if due; measured where nothing is commanded."""
        if state.stamp - self._shown < GHOST_PERIOD or state.base_pose is None:
            return
        self._shown = state.stamp
        time = stamp_from_ns(state.stamp)
        known = {**state.positions_by_name, **state.commanded}
        message = JointState(name=list(known), position=list(known.values()))
        message.header.stamp = time
        self._states.publish(message)
        base = state.commanded_base
        pose = state.base_pose if base is None else base
        self._tf.sendTransform(transform(time, self._frame, self._root, pose.tolist()))


POINT_PERIOD = 20_000_000
"""Least time between two points of a path, in [ns]."""

TRAILS_PERIOD = 100_000_000
"""Least time between two messages of paths, in [ns]."""

MAX_POINTS = 500
"""Points kept of a path: ten seconds."""

WIDTH = 0.008
"""Width of the lines, in [m]."""

COLORS = (
    (0.90, 0.35, 0.10),
    (0.10, 0.45, 0.80),
    (0.15, 0.60, 0.30),
    (0.60, 0.30, 0.70),
    (0.75, 0.60, 0.10),
)
"""Red, green, blue of consecutive paths."""


class TrailMarkers:
    """Publishes the paths of links of one robot; unknown links are ignored."""

    def __init__(
        self, topic: str, links: Sequence[str], robot: Description, frame: str
    ) -> None:
        names = [name for name in robot.link_names if name != WORLD]
        self._links = [link for link in links if link in names]
        self._rows = [names.index(link) for link in self._links]
        self._frame = frame
        self._n_joints = len(robot.movable_joints)
        self._kinematics = Kinematics(robot)
        self._n_trees = len(robot.roots)
        self._publisher = rospy.Publisher(topic, MarkerArray, queue_size=1, latch=True)
        self.reset()

    def reset(self) -> None:
        """Forget where the links were: time began again."""
        self._points: deque[np.ndarray] = deque(maxlen=MAX_POINTS)
        self._added = self._published = -TRAILS_PERIOD

    def show(self, state: RobotState) -> None:
        """Add a point to each path, if due.

        A state without a base or with missing joints adds nothing.
        """
        stamp, base = state.stamp, state.base_pose
        is_whole = base is not None and len(state.names) == self._n_joints
        if stamp - self._added < POINT_PERIOD or not is_whole or self._n_trees > 1:
            return
        self._added = stamp
        poses = self._kinematics.link_poses(base, state.positions)
        self._points.append(poses[self._rows, :3])
        if stamp - self._published >= TRAILS_PERIOD:
            self._published = stamp
            self._publish(stamp)

    def _publish(self, stamp: int) -> None:
        """Publish the paths."""
        paths = np.array(self._points).transpose(1, 0, 2)
        markers = MarkerArray()
        for number, (link, path) in enumerate(zip(self._links, paths)):
            marker = Marker(ns=link, id=number, type=Marker.LINE_STRIP)
            marker.header.frame_id = self._frame
            marker.header.stamp = stamp_from_ns(stamp)
            marker.frame_locked = False
            marker.pose.orientation.w = 1.0
            marker.scale.x = WIDTH
            color = marker.color
            color.r, color.g, color.b = COLORS[number % len(COLORS)]
            color.a = 1.0
            marker.points = [Point(*point) for point in path.tolist()]
            markers.markers.append(marker)
        self._publisher.publish(markers)


def overlays_of(
    robot: RobotParameters, parameters: BridgeParameters, description: Description
) -> list[Ghost | TrailMarkers]:
    """Create the overlays that the parameters enable; none by default."""
    p = parameters
    found: list[Ghost | TrailMarkers] = []
    links = p.trails.split()
    if links:
        topic = topic_of(robot, "trails")
        found.append(TrailMarkers(topic, links, description, p.map_frame))
    if p.ghost:
        root, _ = base_of(description)
        topic = topic_of(robot, "commanded_joint_states")
        found.append(Ghost(topic, robot.frame_prefix + root, p.map_frame))
    return found
