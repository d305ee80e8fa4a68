"""Collision shapes as PyBullet takes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Dict

import numpy as np

from g1_description.robot.description import Shape
from g1_description.sim.bullet.client import BulletClient, pybullet
from g1_description.sim.meshes.hulls import cylinder_points, thinned_hulls
from g1_description.sim.meshes.shapes import Mesh, is_there
from g1_description.sim.meshes.stl import write_stl

MAX_TOGETHER = 16
"""Collision shapes that PyBullet takes in one call: of one more its process dies."""

TOLERANCE = 1e-3
"""Largest distance in [m] of a mesh from the hull that stands for it: fewer points make
steps with contacts, and loading, faster."""

Form = Dict[str, Any]
"""A collision shape in the words of ``createCollisionShapeArray``."""

MIN_RADIUS = 1e-9
"""Smallest radius of a sphere in [m]: PyBullet refuses zero."""

KINDS = {
    "box": pybullet.GEOM_BOX,
    "sphere": pybullet.GEOM_SPHERE,
    "cylinder": pybullet.GEOM_MESH,
    "mesh": pybullet.GEOM_MESH,
    "plane": pybullet.GEOM_PLANE,
}


class Forms:
    """Writes collision shapes in PyBullet's words, and their meshes into files.

    PyBullet takes the points of a hull directly only for a link that has no other
    shape, so they go through files.
    """

    def __init__(
        self, meshes: Mapping[str, Mesh], folder: Path, is_static: bool
    ) -> None:
        """Begin without files.

        Args:
            meshes: By their names as written.
            folder: Where files are written. They are read when the shapes are created.
            is_static: Whether the model never moves: then its meshes are hollow where
                their files are.
        """
        self._meshes = meshes
        self._folder = folder
        self._is_static = is_static
        self._files: dict[tuple[str, float], str] = {}
        self.deviations: dict[str, float] = {}
        """By meshes of which points were left out: how far the farthest of these is
        from the hull in use, in [m]."""
        self._n_files = 0

    def of(self, shapes: Sequence[Shape], anchor: np.ndarray) -> list[Form]:
        """Return the forms of a link's shapes, without meshes that were not found.

        Args:
            shapes: Collision shapes of the link.
            anchor: Where PyBullet has the link's frame, in the link frame, in [m],
                shape (3,).
        """
        return [
            self._form(shape, anchor, self._file_of(shape))
            for shape in shapes
            if is_there(shape, self._meshes)
        ]

    def _form(self, shape: Shape, anchor: np.ndarray, file: str) -> Form:
        """Write a shape, whose mesh is in a file."""
        form: Form = {
            "shapeTypes": KINDS[shape.kind],
            "halfExtents": [1.0, 1.0, 1.0],
            "radii": 1.0,
            "fileNames": file,
            "meshScales": [1.0, 1.0, 1.0],
            "planeNormals": [0.0, 0.0, 1.0],
            "flags": 0,
            "collisionFramePositions": (shape.pose[:3] - anchor).tolist(),
            "collisionFrameOrientations": shape.pose[3:].tolist(),
        }
        if shape.kind == "box":
            form["halfExtents"] = [size / 2.0 for size in shape.size]
        elif shape.kind == "sphere":
            form["radii"] = max(shape.size[0], MIN_RADIUS)
        elif shape.kind == "plane":
            form["planeNormals"] = list(shape.size)
        elif shape.kind == "mesh":
            form["meshScales"] = list(shape.size)
            if self._is_static:
                form["flags"] = pybullet.GEOM_FORCE_CONCAVE_TRIMESH
        return form

    def _file_of(self, shape: Shape) -> str:
        """Return the file of a shape; an empty name where it needs none."""
        if shape.kind == "cylinder":
            return self._write([cylinder_points(*shape.size)])
        if shape.kind != "mesh":
            return ""
        scale = max(map(abs, shape.size))
        key = shape.filename, scale
        if key not in self._files:
            self._files[key] = self._mesh_file(shape.filename, scale)
        return self._files[key]

    def _mesh_file(self, name: str, scale: float) -> str:
        """Write a mesh, whose largest scale is given, to a file; return its name."""
        mesh = self._meshes[name]
        if not self._is_static:
            hulls = thinned_hulls(mesh, TOLERANCE / scale if scale else 0.0)
            deviation = max(deviation for _, deviation in hulls) * scale
            if deviation:
                known = self.deviations.get(name, 0.0)
                self.deviations[name] = max(known, deviation)
            return self._write([points for points, _ in hulls])
        if mesh.parts:
            corners = [part.corners.reshape(-1, 3) for part in mesh.parts]
            return self._write([np.concatenate(corners)])
        path = self._new_path(".stl")
        path.symlink_to(mesh.path.resolve())
        return str(path)

    def _write(self, hulls: Sequence[np.ndarray]) -> str:
        """Write the points of hulls, each with shape (n, 3); return the file's name."""
        triangles = [_triples(points) for points in hulls]
        if len(hulls) == 1:
            path = self._new_path(".stl")
            path.write_bytes(write_stl(triangles[0]))
        else:
            path = self._new_path(".obj")
            path.write_text(_obj_text(triangles))
        return str(path)

    def _new_path(self, suffix: str) -> Path:
        """Name a new file; PyBullet dies of names beyond ASCII."""
        self._n_files += 1
        return self._folder / f"{self._n_files}{suffix}"


def _obj_text(objects: Sequence[np.ndarray]) -> str:
    """Write an OBJ file; PyBullet makes a hull of each object.

    Args:
        objects: Triangles of each, shape (n, 3, 3).
    """
    lines = []
    count = 0
    for number, triangles in enumerate(objects):
        lines.append(f"o {number}")
        corners = triangles.reshape(-1, 3).tolist()
        lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in corners]
        begins = range(count + 1, count + len(corners) + 1, 3)
        lines += [f"f {first} {first + 1} {first + 2}" for first in begins]
        count += len(corners)
    return "\n".join(lines) + "\n"


def _triples(points: np.ndarray) -> np.ndarray:
    """Write points, shape (n, 3), as triangles, the last point as often as it takes."""
    padding = np.repeat(points[-1:], -len(points) % 3, axis=0)
    return np.concatenate([points, padding]).reshape(-1, 3, 3)


def create_shapes(client: BulletClient, forms: Sequence[Form]) -> int:
    """Create the collision shapes of a link.

    Args:
        client: PyBullet.
        forms: At most ``MAX_TOGETHER``.

    Returns:
        PyBullet's number for all of them; -1 if there are none.
    """
    if not forms:
        return -1
    columns = {name: [form[name] for form in forms] for name in forms[0]}
    return int(client.createCollisionShapeArray(**columns))
