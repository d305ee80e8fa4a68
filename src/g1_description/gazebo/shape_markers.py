"""Markers of the shapes of objects for RViz, serialized once except for their poses."""

from __future__ import annotations

import io
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np
from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker

from g1_description.files.model_files import find_folder
from g1_description.files.uris import local_path
from g1_description.render.patches import GREY, PLANE, SEE_THROUGH
from g1_description.robot.assembly import MAP
from g1_description.robot.description import Shape
from g1_description.robot.rotation import from_z
from g1_description.robot.transform import compose
from g1_description.sim.meshes.stl import capsule

KINDS = {
    "box": Marker.CUBE,
    "plane": Marker.CUBE,
    "sphere": Marker.SPHERE,
    "cylinder": Marker.CYLINDER,
    "capsule": Marker.TRIANGLE_LIST,
    "mesh": Marker.MESH_RESOURCE,
}
"""Types of markers by kinds of shapes."""

THIN = 0.001
"""Thickness of the square that shows a plane, in [m]."""

EMBEDDED = (".dae", ".obj")
"""Endings of meshes that may have colours of their own."""

POSE_BYTES = 56
"""Size of a serialized pose."""


class ShapeMarkers:
    """The markers of objects: the namespace is the object's name, the id a number."""

    def __init__(self, shapes: Mapping[str, Sequence[Shape]]) -> None:
        """Prepare the markers.

        Args:
            shapes: Shapes in the frames of their objects, by the objects' names.
        """
        self.keys: list[tuple[str, int]] = []
        """Namespace and id of each marker."""
        self.left_out: dict[str, None] = {}
        """Messages on shapes that cannot be shown."""
        self._meshes: dict[str, str] = {}
        rows: list[int] = []
        poses: list[np.ndarray] = []
        self._parts: list[tuple[bytes, bytes]] = []
        for row, (name, some) in enumerate(shapes.items()):
            for number, shape in enumerate(some):
                if shape.kind == "mesh" and not self._mesh(shape.filename):
                    continue
                marker = self._marker(shape)
                marker.ns, marker.id = name, number
                self.keys.append((name, number))
                self._parts.append(_around_pose(marker))
                rows.append(row)
                poses.append(_pose(shape))
        self._rows = np.array(rows, dtype=int)
        self._poses = np.array(poses).reshape(-1, 7)

    def at(self, poses: np.ndarray, is_shown: np.ndarray) -> list[bytes]:
        """Serialize markers.

        Args:
            poses: T_map_object of all objects, shape (n_objects, 7).
            is_shown: Whether the markers of each are, shape (n_objects,).
        """
        used = np.flatnonzero(is_shown[self._rows])
        placed = compose(poses[self._rows[used]], self._poses[used])
        parts = [self._parts[number] for number in used]
        each = placed.astype("<f8")
        return [head + at.tobytes() + tail for (head, tail), at in zip(parts, each)]

    def _mesh(self, uri: str) -> str:
        """Find a mesh as RViz does, which knows no ``model://``; empty: none."""
        if uri not in self._meshes:
            path = local_path(uri, find_folder)
            if path is None:
                self.left_out[f"mesh {uri} is not shown: there is no such file"] = None
            is_known = path is None or uri.startswith("package://")
            found = "" if path is None else uri
            self._meshes[uri] = found if is_known else Path(path).as_uri()
        return self._meshes[uri]

    def _marker(self, shape: Shape) -> Marker:
        """Make a marker of a shape, without a place."""
        size, color = shape.size, shape.color
        sizes = {
            "cylinder": (2.0 * size[0], 2.0 * size[0], size[-1]),
            "capsule": (1.0, 1.0, 1.0),
            "sphere": (2.0 * size[0],) * 3,
            "plane": (PLANE, PLANE, THIN),
        }
        marker = Marker(type=KINDS[shape.kind], action=Marker.ADD)
        marker.header.frame_id = MAP
        marker.scale.x, marker.scale.y, marker.scale.z = sizes.get(shape.kind, size)
        red, green, blue, alpha = color or GREY
        if shape.kind == "plane":
            alpha *= SEE_THROUGH
        marker.color = ColorRGBA(red, green, blue, alpha)
        if shape.kind == "mesh":
            marker.mesh_resource = self._mesh(shape.filename)
            if color is None and marker.mesh_resource.lower().endswith(EMBEDDED):
                marker.mesh_use_embedded_materials = True
                marker.color = ColorRGBA()
        if shape.kind == "capsule":  # RViz has none
            surface = capsule(*size)
            corners = surface.vertices[surface.triangles.ravel()].tolist()
            marker.points = [Point(*corner) for corner in corners]
        return marker


def _pose(shape: Shape) -> np.ndarray:
    """Return the pose of the marker of a shape in the object, shape (7,)."""
    if shape.kind != "plane":
        return shape.pose
    below = np.array([0.0, 0.0, -THIN / 2])
    turned = np.concatenate([np.zeros(3), from_z(np.array(shape.size))])
    placed = compose(shape.pose, turned)
    return compose(placed, np.concatenate([below, [0.0, 0.0, 0.0, 1.0]]))


def serialized(marker: Marker) -> bytes:
    """Serialize a marker."""
    buffer = io.BytesIO()
    marker.serialize(buffer)
    return buffer.getvalue()


def deleted(keys: Collection[tuple[str, int]]) -> list[bytes]:
    """Serialize the deletion of markers."""
    markers = [Marker(ns=ns, id=number, action=Marker.DELETE) for ns, number in keys]
    for marker in markers:
        marker.header.frame_id = MAP
    return [serialized(marker) for marker in markers]


def _around_pose(marker: Marker) -> tuple[bytes, bytes]:
    """Serialize a marker; return what is before its pose, and behind."""
    data = serialized(marker)
    # Numbers of the header, frame, namespace; id, type and action.
    begin = 12 + 4 + len(MAP) + 4 + len(marker.ns.encode("utf-8")) + 12
    return data[:begin], data[begin + POSE_BYTES :]
