"""What a robot does now, from its joint states and from TF."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import rospy
import tf2_ros
from tf2_msgs.msg import TFMessage

from g1_description.robot.assembly import base_of
from g1_description.robot.transform import compose, inverse
from g1_description.ros.robot_view import RobotView
from g1_description.ros.waiting import BUFFER, NoAnswerError, wait_until

MAP = "map"

JOINTS_TIMEOUT = 10.0
"""Longest wait for the positions of all joints, in [s]."""

TF_TIMEOUT = 2.0
"""Longest wait for a transform once the joints are known, in [s]."""

TF_QUEUE = 100
"""Messages kept per publisher of /tf when many come at once: each may be the only one
with a frame."""


@dataclass(frozen=True)
class Moment:
    """The state of a robot at some time."""

    positions: dict[str, float]
    """Positions of its joints in [rad] or [m] by name; unknown ones are left out."""

    T_map_root: np.ndarray | None
    """Pose of its root link in the map, shape (7,); None where it is unknown."""

    def with_joints(self, positions: dict[str, float]) -> Moment:
        """Return the same with other positions of some joints."""
        return replace(self, positions={**self.positions, **positions})


class Transforms:
    """The newest transforms on TF.

    tf2 keeps them as static transforms: so the last one received counts, also after
    the clock was reset, and none is refused.

    Subscribes: /tf, /tf_static (tf2_msgs/TFMessage)
    """

    def __init__(self) -> None:
        self._buffer = tf2_ros.Buffer(debug=False)
        self._subscribers = [
            rospy.Subscriber(
                "/tf",
                TFMessage,
                self._on_transforms,
                queue_size=TF_QUEUE,
                buff_size=BUFFER,
            ),
            # Each publisher sends its frames once, so none may be lost.
            rospy.Subscriber(
                "/tf_static", TFMessage, self._on_transforms, queue_size=None
            ),
        ]

    def close(self) -> None:
        """Unsubscribe; what was received stays known."""
        for subscriber in self._subscribers:
            subscriber.unregister()

    def _on_transforms(self, message: TFMessage) -> None:
        for transform in message.transforms:
            self._buffer.set_transform_static(transform, "tf")

    def pose(self, parent: str, child: str) -> np.ndarray | None:
        """Return the pose of a frame in another one.

        Returns:
            T_parent_child, shape (7,); None if it is unknown.
        """
        try:
            found = self._buffer.lookup_transform(parent, child, rospy.Time())
        except tf2_ros.TransformException:
            return None
        p, q = found.transform.translation, found.transform.rotation
        return np.array([p.x, p.y, p.z, q.x, q.y, q.z, q.w])


class RobotWatch(RobotView):
    """Follows one robot's joints and its place in the map."""

    def __init__(
        self,
        namespace: str,
        notify: Callable[[str], None],
        transforms: Transforms,
    ) -> None:
        """Read the description and subscribe.

        Args:
            namespace: Of the robot's topics, without slashes around; the bridge
                prefixes its frames with it.
            notify: Takes messages about what is waited for.
            transforms: The frames on TF.

        Raises:
            DescriptionError: If there is no description, or it is not one.
            ROSInterruptException: If the node is shut down.
        """
        super().__init__(namespace, notify)
        self._transforms = transforms
        prefix = f"{namespace}/" if namespace else ""
        base, self._T_root_base = base_of(self.description)
        self.frame = prefix + base
        """Name in TF of the link whose pose is the robot's."""

    def wait(self) -> None:
        """Wait for all joints, or at least some, and for the pose of the root.

        Raises:
            NoAnswerError: If no position of any joint comes.
            ROSInterruptException: If the node is shut down.
        """
        wait_until(lambda: not self.missing, JOINTS_TIMEOUT)
        if self.missing and not self.positions:
            raise NoAnswerError(
                f"No joint states of '{self.description.name}' came on {self.topic} "
                f"within {JOINTS_TIMEOUT:g} s: does the bridge run, and is time not "
                "paused?"
            )
        wait_until(lambda: self._root_pose() is not None, TF_TIMEOUT)

    def now(self) -> Moment:
        """Return how the robot is."""
        return Moment(self.positions, self._root_pose())

    def _root_pose(self) -> np.ndarray | None:
        """Return T_map_root, shape (7,); None if it is unknown."""
        pose = self._transforms.pose(MAP, self.frame)
        return None if pose is None else compose(pose, inverse(self._T_root_base))
