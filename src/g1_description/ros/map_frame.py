"""Transforms poses from any TF frame to the map."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence

import numpy as np
import rospy
import tf2_ros

from g1_description.errors import MotionError
from g1_description.files.yaml import parse_yaml
from g1_description.robot.transform import compose
from g1_description.ros.conversions import vector_to_array
from g1_description.ros.waiting import BUFFER
from g1_description.text import did_you_mean

FIRST_TIMEOUT = 2.0
"""Longest wait for a frame by a new listener, in [s] of wall time."""

TIMEOUT = 0.2
"""Longest wait for a frame later on, in [s] of wall time."""

POLL_PERIOD = 0.005
"""Time between two lookups while waiting, in [s]."""


class MapFrame:
    """Transforms poses to the map; listens to TF from the first use on.

    Subscribes: /tf, /tf_static (tf2_msgs/TFMessage)
    """

    def __init__(self, names: Sequence[str] = ("map", "world")) -> None:
        """Create it without a listener.

        Args:
            names: Names of the map and of frames equal to it, the map first.
        """
        self._names = names
        self._lock = threading.Lock()
        self._buffer: tf2_ros.Buffer | None = None

    def pose_in_map(
        self, poses: np.ndarray, frame: str, stamp: rospy.Time
    ) -> np.ndarray:
        """Transform poses to the map.

        Args:
            poses: Poses in the frame, shape (..., 7).
            frame: The frame; empty: the map.
            stamp: Time of the transform; zero or in the future: the newest one.

        Raises:
            MotionError: If TF has no transform at that time.
        """
        frame = frame.lstrip("/")
        if not frame or frame in self._names:
            return poses
        return compose(self._find(frame, stamp), poses)

    def _find(self, frame: str, stamp: rospy.Time) -> np.ndarray:
        """Look a frame up; return its pose in the map, shape (7,)."""
        deadline = time.monotonic() + TIMEOUT
        with self._lock:
            if self._buffer is None:
                self._buffer = tf2_ros.Buffer(debug=False)
                self._listener = tf2_ros.TransformListener(
                    self._buffer, queue_size=100, buff_size=BUFFER
                )
                deadline += FIRST_TIMEOUT
        while True:
            try:
                return self._look_up(frame, stamp)
            except tf2_ros.TransformException as error:
                if time.monotonic() > deadline:
                    raise MotionError(self._reason(frame, error)) from None
                # tf2 itself waits in simulated time, which may stand still.
                threading.Event().wait(POLL_PERIOD)

    def _reason(self, frame: str, error: tf2_ros.TransformException) -> str:
        """Describe why a lookup failed; suggest a name if there is no such frame."""
        assert self._buffer is not None
        edges = parse_yaml(self._buffer.all_frames_as_yaml().encode())
        known = {*edges, *(edge["parent"] for edge in edges.values())}
        if frame in known:
            return f"no transform from frame {frame!r} to {self._names[0]!r}: {error}"
        hint = did_you_mean(frame, known)
        return f"no transform from frame {frame!r}: nothing publishes it on /tf{hint}"

    def _look_up(self, frame: str, stamp: rospy.Time) -> np.ndarray:
        """Return a frame's pose in the map, shape (7,); the newest for a future stamp.

        Raises:
            TransformException: If there is none at that time.
        """
        assert self._buffer is not None
        map_frame = self._names[0]
        try:
            found = self._buffer.lookup_transform(map_frame, frame, stamp)
        except tf2_ros.ExtrapolationException:
            found = self._buffer.lookup_transform(map_frame, frame, rospy.Time())
            if stamp < found.header.stamp:
                raise
        q = found.transform.rotation
        turn = np.array([q.x, q.y, q.z, q.w])
        return np.concatenate([vector_to_array(found.transform.translation), turn])
