"""The paths of chosen links, for RViz.

Publishes: trails (visualization_msgs/MarkerArray)
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
import rospy
from geometry_msgs.msg import Point
from visualization_msgs.msg import Marker, MarkerArray

from g1_description.core.bridge.estimator import Observation
from g1_description.core.robot.assembly import WORLD
from g1_description.core.robot.description import Description
from g1_description.core.robot.kinematics import Kinematics
from g1_description.ros.wire.conversions import stamp_from_ns

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
