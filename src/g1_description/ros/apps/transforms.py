"""Frames on TF, for a program that asks where a few of them are."""

from __future__ import annotations

import numpy as np
import rospy
import tf2_ros
from tf2_msgs.msg import TFMessage

from g1_description.ros.node.newest import BUFFER

LAST = 100
"""Messages of each publisher of /tf that count when many have come at once: they name
different frames, and each frame is in one of them."""


class Transforms:
    """What TF told last.

    tf2 keeps all as if it were static: the newest counts, also after a reset of the
    clock, and nothing is refused.

    Subscribes: /tf, /tf_static (tf2_msgs/TFMessage)
    """

    def __init__(self) -> None:
        """Begin to listen."""
        self._buffer = tf2_ros.Buffer(debug=False)
        self._subscribers = [
            rospy.Subscriber(
                "/tf", TFMessage, self._hear, queue_size=LAST, buff_size=BUFFER
            ),
            # Each tells of its frames once, so none may be lost.
            rospy.Subscriber("/tf_static", TFMessage, self._hear, queue_size=None),
        ]

    def close(self) -> None:
        """Listen no more; what was heard stays known."""
        for subscriber in self._subscribers:
            subscriber.unregister()

    def _hear(self, message: TFMessage) -> None:
        for transform in message.transforms:
            self._buffer.set_transform_static(transform, "tf")

    def pose(self, parent: str, child: str) -> np.ndarray | None:
        """Tell where a frame is in another, newest first.

        Returns:
            T_parent_child, shape (7,); None where nobody tells.
        """
        try:
            found = self._buffer.lookup_transform(parent, child, rospy.Time())
        except tf2_ros.TransformException:
            return None
        p, q = found.transform.translation, found.transform.rotation
        return np.array([p.x, p.y, p.z, q.x, q.y, q.z, q.w])
