"""A robot that goes through motions, as its bridge offers it.

Subscribes: joint_states (sensor_msgs/JointState)
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import rosgraph
import rospy

from g1_description.core.errors import MotionError
from g1_description.core.transform import IDENTITY
from g1_description.ros.apps.motion_client import MotionClient
from g1_description.ros.apps.robot_view import RobotView
from g1_description.ros.motion.map_frame import MapFrame
from g1_description.ros.node.waiting import NoAnswerError
from g1_description.srv import PlayMotion

TIMEOUT = 30.0
"""Longest wait for the bridge, in [s]: machines may be busy."""

GONE = 5.0
"""Time without a publisher of joint states after which the robot is given up, in [s]:
a bridge that failed is started again."""


class PlayedRobot(RobotView):
    """The robot behind play_motion of a namespace."""

    def __init__(self, namespace: str, notify: Callable[[str], None]) -> None:
        """Connect.

        Args:
            namespace: Of the robot's topics, without slashes around; empty: the
                node's.
            notify: Takes messages about what is waited for.

        Raises:
            DescriptionError: If there is no description, or it is not one.
            NoAnswerError: If there is no bridge, or no master.
        """
        with _told_without_master():
            super().__init__(namespace, notify)
        self._told = ""
        self._alone: float | None = None
        """Since when nobody publishes its state, on the monotonic clock."""
        service = rospy.ServiceProxy(f"{self._prefix}play_motion", PlayMotion)
        self.motions = MotionClient(service)
        """What lets it move."""
        if not self.wait_until(lambda: self.newest is not None, TIMEOUT):
            raise NoAnswerError(f"The robot's state is unknown: {self.silence}")

    @property
    def now_ns(self) -> int:
        """Time of its newest state, in [ns]."""
        return self.newest.header.stamp.to_nsec() if self.newest else 0

    def look_after_time(self) -> None:
        """Tell what keeps its time from going on; to be called again and again.

        Raises:
            NoAnswerError: If nobody publishes its state any more.
        """
        obstacle = self.obstacle()
        if obstacle not in ("", self._told):
            self._notify(f"waiting: {obstacle}")
        self._told = obstacle
        if self._subscriber.get_num_connections():
            self._alone = None
            return
        now = time.monotonic()
        self._alone = self._alone or now
        if now > self._alone + GONE:
            raise NoAnswerError(
                f"Nobody publishes {self.topic} any more; the bridge is gone."
            )

    def base_pose(self, frame: str | None) -> np.ndarray:
        """Return where its base is in the map, shape (7,).

        Args:
            frame: The base on TF; None: base_link with the namespace before it.

        Raises:
            MotionError: If TF does not have it.
            NoAnswerError: If there is no master.
        """
        frame = frame or f"{self._prefix.lstrip('/')}base_link"
        try:
            with _told_without_master():
                return MapFrame().pose_in_map(IDENTITY, frame, rospy.Time())
        except MotionError as error:
            raise MotionError(
                f"TF does not know where the robot is: {error}. --base-frame names "
                "its base."
            ) from error


@contextmanager
def _told_without_master() -> Iterator[None]:
    """Raise NoAnswerError where the master does not answer."""
    try:
        yield
    except (OSError, rosgraph.MasterException) as error:
        raise NoAnswerError(f"The master is gone: {error}.") from error
