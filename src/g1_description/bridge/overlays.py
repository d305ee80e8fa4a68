"""The ghost and the trails that RViz shows next to a robot."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
import rospy
import tf2_ros
from geometry_msgs.msg import Point
from sensor_msgs.msg import JointState
from visualization_msgs.msg import Marker, MarkerArray

from g1_description.bridge.parameters import BridgeParameters, RobotParameters, topic_of
from g1_description.robot.assembly import WORLD, base_of
from g1_description.robot.description import Description
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.state import RobotState
from g1_description.ros.conversions import stamp_from_ns, transform

PREFIX = "ghost/"
"""Prefix of the names of its frames."""

PERIOD = 20_000_000
"""Least time between two messages, in [ns]."""


class Ghost:
    """Publishes the commanded configuration of one robot as a second robot."""

    def __init__(self, topic: str, root: str, frame: str) -> None:
        self._states = rospy.Publisher(topic, JointState, queue_size=10, latch=True)
        self._tf = tf2_ros.TransformBroadcaster()
        self._root, self._frame = PREFIX + root, frame
        self.reset()

    def reset(self) -> None:
        """Start over, as time did."""
        self._shown = -PERIOD

    def show(self, state: RobotState) -> None:
        """Publish the commanded state, if due; measured where nothing is commanded."""
        if state.stamp - self._shown < PERIOD or state.base_pose is None:
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

PUBLISH_PERIOD = 100_000_000
"""Least time between two messages, in [ns]."""

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
        self._added = self._published = -PUBLISH_PERIOD

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
