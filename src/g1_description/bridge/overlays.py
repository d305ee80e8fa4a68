"""What RViz shows of a robot beside the robot itself."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
import rospy
import tf2_ros
from geometry_msgs.msg import Point
from sensor_msgs.msg import JointState
from visualization_msgs.msg import Marker, MarkerArray

from g1_description.bridge.estimator import Observation
from g1_description.bridge.parameters import BridgeParameters, RobotParameters, topic_of
from g1_description.bridge.player import MotionPlayer
from g1_description.robot.assembly import WORLD, base_of
from g1_description.robot.description import Description
from g1_description.robot.kinematics import Kinematics
from g1_description.ros.conversions import stamp_from_ns, transform
from g1_description.ros.lifecycle import quiet_when_closing

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
        """Publish the commanded state, if a message is due.

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


POINT_PERIOD = 20_000_000
"""Least time between two points of a path, in [ns]."""

PUBLISH_PERIOD = 100_000_000
"""Least time between two messages, in [ns]."""

MAX_POINTS = 500
"""Points kept of a path: ten seconds."""

WIDTH = 0.008
"""Of the lines, in [m]."""

COLORS = (
    (0.90, 0.35, 0.10),
    (0.10, 0.45, 0.80),
    (0.15, 0.60, 0.30),
    (0.60, 0.30, 0.70),
    (0.75, 0.60, 0.10),
)
"""Red, green, blue of the paths, in turn."""


class Trails:
    """Where links of one robot have been."""

    def __init__(
        self, topic: str, links: Sequence[str], robot: Description, frame: str
    ) -> None:
        """Advertise the topic.

        Args:
            topic: Its name.
            links: The links; those that the robot does not have are left out.
            robot: Whose links they are.
            frame: Name of the map.
        """
        names = [name for name in robot.link_names if name != WORLD]
        self._links = [link for link in links if link in names]
        self._rows = [names.index(link) for link in self._links]
        self._frame = frame
        self._joints = [joint.name for joint in robot.movable_joints]
        self._kinematics = Kinematics(robot)
        self._n_trees = len(robot.roots)
        self._publisher = rospy.Publisher(topic, MarkerArray, queue_size=1, latch=True)
        self.reset()

    def reset(self) -> None:
        """Forget where the links were: time began again."""
        self._points: deque[np.ndarray] = deque(maxlen=MAX_POINTS)
        self._added = self._published = -PUBLISH_PERIOD

    def add(self, stamp: int, seen: Observation) -> None:
        """Add a point to each path where one is due.

        Args:
            stamp: Time of the state in [ns].
            seen: The state; without a base or with missing joints it adds nothing.
        """
        is_whole = seen.base_pose is not None and len(seen.names) == len(self._joints)
        if stamp - self._added < POINT_PERIOD or not is_whole or self._n_trees > 1:
            return
        self._added = stamp
        poses = self._kinematics.link_poses(seen.base_pose, seen.position)
        self._points.append(poses[self._rows, :3])
        if stamp - self._published >= PUBLISH_PERIOD:
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


class Extras:
    """The paths of links, and where the robot is wanted; both off by default."""

    def __init__(
        self,
        robot: RobotParameters,
        parameters: BridgeParameters,
        description: Description,
        player: MotionPlayer,
    ) -> None:
        """Advertise what is wanted.

        Args:
            robot: The robot's names.
            parameters: What is wanted.
            description: The robot.
            player: What knows where the robot is wanted.
        """
        p = parameters
        self._player = player
        self._trails = self._ghost = None
        if p.trails.split():
            topic = topic_of(robot, "trails")
            self._trails = Trails(topic, p.trails.split(), description, p.map_frame)
        if p.ghost:
            root, _ = base_of(description)
            topic = topic_of(robot, "commanded_joint_states")
            self._ghost = Ghost(topic, robot.frame_prefix + root, p.map_frame)
        player.keeps_commands = p.ghost
        self.are_wanted = bool(self._trails or self._ghost)
        """Whether there is any."""

    def show(self, time_ns: int, seen: Observation) -> None:
        """Show what belongs to a state of the robot, at its time in [ns]."""
        with quiet_when_closing():
            if self._trails:
                self._trails.add(time_ns, seen)
            if self._ghost:
                self._ghost.show(time_ns, seen, self._player)

    def reset(self) -> None:
        """Begin again, as time did."""
        if self._trails:
            self._trails.reset()
        if self._ghost:
            self._ghost.reset()
