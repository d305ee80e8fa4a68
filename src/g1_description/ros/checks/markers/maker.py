"""Markers for RViz, in one line each."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import genpy
import numpy as np
from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker

from g1_description.core.robot.description import Shape
from g1_description.ros.wire.conversions import pose_from_array
from g1_description.sim.marks.canvas import Color

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
        """Begin without any."""
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
