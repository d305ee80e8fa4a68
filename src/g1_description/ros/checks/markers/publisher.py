"""Markers on a topic: what is new, what goes, and all of it for a newcomer.

Publishes: ~markers (visualization_msgs/MarkerArray)
"""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence

import genpy
import rospy
from visualization_msgs.msg import Marker, MarkerArray

from g1_description.ros.transport.direct_publisher import DirectPublisher

REFRESH_PERIOD = 1.0
"""All is sent again after this time in [s] of wall time: RViz forgets what is switched
off there."""

QUEUE_SIZE = 2
"""Messages that wait for a slow RViz; older ones would be of no use."""


class MarkerPublisher:
    """Sends markers to those who subscribe, and nothing where nobody does."""

    def __init__(self, topic: str) -> None:
        """Advertise the topic.

        Args:
            topic: Its name.
        """
        self._newcomer = threading.Event()
        self._topic = DirectPublisher(
            topic, MarkerArray, QUEUE_SIZE, on_newcomer=self._newcomer.set
        )
        self._shown: dict[tuple[str, int], Marker] = {}
        self._refreshed = 0.0
        rospy.on_shutdown(self.clear)

    @property
    def is_wanted(self) -> bool:
        """Whether anybody subscribes."""
        return self._topic.get_num_connections() > 0

    def update(self, fixed: Sequence[Marker], moving: Sequence[Marker]) -> None:
        """Show these markers and no others.

        Args:
            fixed: Those that are sent once, as they stay with a frame.
            moving: Those that are sent each time.
        """
        shown = {_key(marker): marker for marker in (*fixed, *moving)}
        last, self._shown = self._shown, shown
        gone = [_removed(marker) for key, marker in last.items() if key not in shown]
        new = [marker for marker in fixed if _key(marker) not in last]
        if gone or new or moving:
            self._topic.publish(MarkerArray([*gone, *new, *moving]))

    def keep_up(self, stamp: genpy.Time) -> None:
        """Send all again where that is due, and what waited for a slow reader.

        Args:
            stamp: Until when the markers are valid: the newest time that TF knows.
        """
        self._topic.flush()
        is_due = time.monotonic() - self._refreshed > REFRESH_PERIOD
        if self._newcomer.is_set() or is_due:
            self._newcomer.clear()
            self._refreshed = time.monotonic()
            for marker in self._shown.values():
                if not marker.frame_locked:
                    marker.header.stamp = stamp
            if self._shown:
                self._topic.publish(MarkerArray([*self._shown.values()]))

    def forget(self) -> None:
        """Begin again, as nobody has seen anything."""
        self._shown = {}

    def clear(self) -> None:
        """Show nothing any more."""
        self._shown = {}
        self._topic.publish(MarkerArray([Marker(action=Marker.DELETEALL)]))


def _key(marker: Marker) -> tuple[str, int]:
    """Return what identifies a marker."""
    return marker.ns, marker.id


def _removed(marker: Marker) -> Marker:
    """Make what removes a marker."""
    removal = Marker(ns=marker.ns, id=marker.id, action=Marker.DELETE)
    removal.header = marker.header
    return removal
