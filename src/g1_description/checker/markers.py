"""Shows the findings of the current state in RViz.

Publishes: ~markers (visualization_msgs/MarkerArray), while there are subscribers
"""

from __future__ import annotations

import threading
import time
from collections.abc import Collection, Iterable, Sequence

import genpy
import numpy as np
import rospy
from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from g1_description.checker.forces import LiveForces
from g1_description.checker.parameters import CheckerParameters, base_frame
from g1_description.checks.arrows import draw_forces
from g1_description.checks.marks import RED, Color, draw_marks, red_links
from g1_description.checks.verdict import Verdict
from g1_description.robot.description import Description, Shape
from g1_description.robot.state import RobotState
from g1_description.ros.conversions import pose_from_array, stamp_from_ns
from g1_description.ros.publisher import DirectPublisher
from g1_description.sim.meshes.stl import capsule

KINDS = {
    "box": Marker.CUBE,
    "cylinder": Marker.CYLINDER,
    "capsule": Marker.TRIANGLE_LIST,
    "sphere": Marker.SPHERE,
    "mesh": Marker.MESH_RESOURCE,
}
"""Types of markers by kinds of shapes."""

DARK = 0.7
"""Brightness of texts relative to surfaces, as RViz does not shade them."""


class MarkerMaker:
    """A canvas of markers in one frame at one time, numbered by namespace."""

    def __init__(self, frame: str, stamp: genpy.Time) -> None:
        self._frame, self._stamp = frame, stamp
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
            namespace: Its namespace in RViz.
            kind: Its type, a constant of ``Marker``.
            color: Red, green, blue, from 0 to 1.
            scale: Along x, y, z, in [m].
            alpha: Opacity, from 0 to 1.
        """
        marker = Marker(ns=namespace, type=kind, action=Marker.ADD)
        marker.id = self._counts.get(namespace, 0)
        self._counts[namespace] = marker.id + 1
        marker.header.frame_id = self._frame
        marker.header.stamp = self._stamp
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
            "capsule": (1.0,) * 3,
            "sphere": (2.0 * shape.size[0],) * 3,
        }
        scale = sizes.get(shape.kind, shape.size)
        marker = self.add(namespace, KINDS[shape.kind], color, scale, alpha)
        marker.pose = pose_from_array(shape.pose)
        marker.mesh_resource = shape.filename
        if shape.kind == "capsule":  # RViz has none
            surface = capsule(*shape.size)
            marker.points = to_points(surface.vertices[surface.triangles.ravel()])

    def text(
        self, namespace: str, place: np.ndarray, text: str, size: float, color
    ) -> None:
        """Add a text of a height in [m] that faces the viewer."""
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

REFRESH_PERIOD = 1.0
"""Time in [s] of wall time after which all markers are sent again: RViz drops those of
namespaces that are switched off."""

QUEUE_SIZE = 2
"""Messages queued for a slow RViz."""


class LiveMarkers:
    """Publishes markers of new findings while there are subscribers."""

    def __init__(self, robot: Description, parameters: CheckerParameters) -> None:
        self._prefix, self._map = parameters.frame_prefix, parameters.map_frame
        self._base_frame = base_frame(robot, parameters)
        self._limit_margin = parameters.limit_margin
        self._shapes = {
            link.name: [s for s in link.visuals or link.collisions if s.kind in KINDS]
            for link in robot.links
        }
        self._newest: tuple[RobotState, Verdict] | None = None
        self._content: tuple | None = None
        self._shown: dict[tuple[str, int], Marker] = {}
        self._refreshed = 0.0
        self._newcomer = threading.Event()
        self._topic = DirectPublisher(
            "~markers", MarkerArray, QUEUE_SIZE, on_newcomer=self._newcomer.set
        )
        rospy.on_shutdown(self._clear)

    @property
    def is_seen(self) -> bool:
        """Whether anyone receives markers."""
        return bool(self._topic.get_num_connections())

    def show(self, state: RobotState, verdict: Verdict, forces: LiveForces) -> None:
        """Show the findings of a state, and contact forces."""
        self._newest = state, verdict, forces

    def keep_up(self) -> None:
        """Send new markers, and all of them to new subscribers and periodically."""
        if self._newest is None or not self.is_seen:
            self._content, self._shown = None, {}
            return
        state, verdict, forces = self._newest
        place = None if state.base_pose is None else state.base_pose.tobytes()
        content = verdict.measured.positions.tobytes(), place, verdict.checked
        pushes = [np.round(arrow.vector, 3).tolist() for arrow in forces.arrows]
        content = *content, verdict.findings, pushes  # objects move, too
        stamp = stamp_from_ns(state.stamp)
        if content != self._content:
            self._content = content
            frame = self._base_frame if state.base_pose is None else self._map
            canvas = MarkerMaker(frame, stamp)
            draw_marks(canvas, verdict, self._limit_margin)
            if state.base_pose is not None:
                draw_forces(canvas, forces.arrows, forces.text, state.base_pose)
            self._send(self._link_markers(red_links(verdict)), canvas.markers)
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

    def _send(self, fixed: Sequence[Marker], moving: Sequence[Marker]) -> None:
        """Replace the shown markers; fixed ones are locked to a frame."""
        shown = {_key(marker): marker for marker in (*fixed, *moving)}
        last, self._shown = self._shown, shown
        gone = [
            Marker(header=one.header, ns=one.ns, id=one.id, action=Marker.DELETE)
            for key, one in last.items()
            if key not in shown
        ]
        new = [marker for marker in fixed if _key(marker) not in last]
        if gone or new or moving:
            self._topic.publish(MarkerArray([*gone, *new, *moving]))

    def _link_markers(self, links: Collection[str]) -> list[Marker]:
        """Make the markers of colliding links, locked to the links' frames."""
        markers, number = [], 0
        for name, shapes in self._shapes.items():
            canvas = MarkerMaker(self._prefix + name, genpy.Time())
            for shape in shapes if name in links else ():
                canvas.shape(LINKS, shape, RED, 0.6)
            for marker in canvas.markers:
                marker.frame_locked = True
                marker.id += number
            markers += canvas.markers
            number += len(shapes)
        return markers

    def _clear(self) -> None:
        """Delete all markers."""
        self._topic.publish(MarkerArray([Marker(action=Marker.DELETEALL)]))


def _key(marker: Marker) -> tuple[str, int]:
    return marker.ns, marker.id
