"""Markers for RViz, in one line each."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import genpy
import numpy as np
import rospy
from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from g1_description.checks.marks import RED, Color
from g1_description.robot.description import Description, Shape
from g1_description.ros.conversions import pose_from_array
from g1_description.ros.publisher import DirectPublisher

KINDS = {
    "box": Marker.CUBE,
    "cylinder": Marker.CYLINDER,
    "sphere": Marker.SPHERE,
    "mesh": Marker.MESH_RESOURCE,
}
"""Types of markers by kinds of shapes."""

DARK = 0.7
"""Brightness of texts as a share of that of surfaces: RViz does not shade them."""


@dataclass(frozen=True)
class Place:
    """Where coordinates are meant."""

    frame: str
    stamp: genpy.Time


class MarkerMaker:
    """Makes markers of one place and time, and numbers them by namespace."""

    def __init__(self, place: Place) -> None:
        self._place = place
        self._counts: dict[str, int] = {}
        self.markers: list[Marker] = []

    def add(
        self,
        namespace: str,
        kind: int,
        color: Sequence[float],
        scale: Sequence[float],
        alpha: float = 1.0,
    ) -> Marker:
        """Add a marker at the origin.

        Args:
            namespace: What RViz lists it under.
            kind: Its type.
            color: Red, green, blue, from 0 to 1.
            scale: Along x, y, z, in [m].
            alpha: 1 hides what is behind.
        """
        marker = Marker(ns=namespace, type=kind, action=Marker.ADD)
        marker.id = self._counts.get(namespace, 0)
        self._counts[namespace] = marker.id + 1
        marker.header.frame_id = self._place.frame
        marker.header.stamp = self._place.stamp
        marker.pose.orientation.w = 1.0
        marker.color = ColorRGBA(*color, alpha)
        marker.scale.x, marker.scale.y, marker.scale.z = scale
        self.markers.append(marker)
        return marker

    def ball(
        self, namespace: str, center: np.ndarray, size: float, color, alpha: float = 1.0
    ) -> None:
        """Add a ball with a diameter in [m]."""
        marker = self.add(namespace, Marker.SPHERE, color, (size,) * 3, alpha)
        marker.pose.position = Point(*center.tolist())

    def disc(self, namespace: str, center: np.ndarray, size: float, color) -> None:
        """Add a flat disc on the floor."""
        scale = (size, size, 0.004)
        marker = self.add(namespace, Marker.CYLINDER, color, scale)
        marker.pose.position = Point(*center.tolist())

    def line(self, namespace: str, points: np.ndarray, width: float, color) -> None:
        """Add a line through points, shape (n, 3)."""
        marker = self.add(namespace, Marker.LINE_STRIP, color, (width, 0.0, 0.0))
        marker.points = to_points(points)

    def triangles(
        self, namespace: str, corners: np.ndarray, color, alpha: float
    ) -> Marker:
        """Add triangles with corners of shape (3 n, 3)."""
        kind = Marker.TRIANGLE_LIST
        marker = self.add(namespace, kind, color, (1.0, 1.0, 1.0), alpha)
        marker.points = to_points(corners)
        return marker

    def shape(self, namespace: str, shape: Shape, color: Color, alpha: float) -> None:
        """Add a visual shape of a link, at its place in the link's frame."""
        sizes = {
            "box": shape.size,
            "cylinder": (2.0 * shape.size[0], 2.0 * shape.size[0], shape.size[-1]),
            "sphere": (2.0 * shape.size[0],) * 3,
        }
        scale = sizes.get(shape.kind, shape.size)
        marker = self.add(namespace, KINDS[shape.kind], color, scale, alpha)
        marker.pose = pose_from_array(shape.pose)
        marker.mesh_resource = shape.filename

    def text(
        self, namespace: str, place: np.ndarray, text: str, size: float, color
    ) -> None:
        """Add a text of a height in [m] that faces whoever looks."""
        dark = [DARK * part for part in color]
        kind = Marker.TEXT_VIEW_FACING
        marker = self.add(namespace, kind, dark, (0.0, 0.0, size))
        marker.pose.position = Point(*place.tolist())
        marker.text = text


def to_points(rows: np.ndarray | Iterable) -> list[Point]:
    """Convert points, shape (n, 3)."""
    return [Point(*row) for row in np.asarray(rows).tolist()]


LINKS = "colliding links"
"""Namespace in RViz."""


class LinkMarkers:
    """Makes the markers of links of one robot."""

    def __init__(self, robot: Description) -> None:
        """Prepare.

        Args:
            robot: The robot.
        """
        self._shapes = {
            link.name: [s for s in link.visuals or link.collisions if s.kind in KINDS]
            for link in robot.links
        }
        counts = np.cumsum([0, *(len(shapes) for shapes in self._shapes.values())])
        self._numbers = dict(zip(self._shapes, counts.tolist()))

    def links(self, names: Sequence[str], prefix: str) -> list[Marker]:
        """Make the markers of links that collide; each stays with its link's frame.

        Args:
            names: Names of the links.
            prefix: What stands before the names of their frames.
        """
        markers = []
        for name in names:
            maker = MarkerMaker(Place(prefix + name, genpy.Time()))
            for shape in self._shapes[name]:
                maker.shape(LINKS, shape, RED, 0.6)
            for number, marker in enumerate(maker.markers):
                marker.frame_locked = True
                marker.id = self._numbers[name] + number
            markers += maker.markers
        return markers


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
