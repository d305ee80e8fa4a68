"""Collision shapes as PyBullet takes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Dict

import numpy as np

from g1_description.core.robot.description import Shape
from g1_description.sim.meshes.hulls import cylinder_points, hull_points
from g1_description.sim.meshes.shapes import Mesh
from g1_description.sim.meshes.stl import write_stl

from .client import BulletClient, pybullet

MAX_TOGETHER = 16
"""Collision shapes that PyBullet takes in one call: of one more its process dies."""

Form = Dict[str, Any]
"""A collision shape in the words of ``createCollisionShapeArray``."""

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
        self, meshes: Mapping[str, Mesh | str], folder: Path, is_static: bool
    ) -> None:
        """Begin without files.

        Args:
            meshes: By their names as written, as ``find_meshes`` returns them.
            folder: Where files are written. They are read when the shapes are created.
            is_static: Whether the model never moves: then its meshes are hollow where
                their files are.
        """
        self._meshes = meshes
        self._folder = folder
        self._is_static = is_static
        self._files: dict[str, list[str]] = {}
        self._n_files = 0

    def of(self, shapes: Sequence[Shape], anchor: np.ndarray) -> list[Form]:
        """Return the forms of a link's shapes; a mesh has one for each of its parts.

        Args:
            shapes: Collision shapes of the link.
            anchor: Where PyBullet has the link's frame, in the link frame, in [m],
                shape (3,).
        """
        return [
            self._form(shape, anchor, file)
            for shape in shapes
            for file in self._files_of(shape)
        ]

    def _form(self, shape: Shape, anchor: np.ndarray, file: str) -> Form:
        """Write a shape, or the part of a mesh that is in a file."""
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
            form["radii"] = shape.size[0]
        elif shape.kind == "plane":
            form["planeNormals"] = list(shape.size)
        elif shape.kind == "mesh":
            form["meshScales"] = list(shape.size)
            if self._is_static:
                form["flags"] = pybullet.GEOM_FORCE_CONCAVE_TRIMESH
        return form

    def _files_of(self, shape: Shape) -> list[str]:
        """Return the files of a shape; one empty name where it needs none."""
        if shape.kind == "cylinder":
            return [self._write(_triples(cylinder_points(*shape.size)))]
        if shape.kind != "mesh":
            return [""]
        mesh = self._meshes[shape.filename]
        if isinstance(mesh, str):
            return []
        if shape.filename not in self._files:
            self._files[shape.filename] = self._mesh_files(mesh)
        return self._files[shape.filename]

    def _mesh_files(self, mesh: Mesh) -> list[str]:
        """Write the parts of a mesh; return the names of the files."""
        if not self._is_static:
            return [self._write(_triples(points)) for points in hull_points(mesh)]
        if not mesh.parts:
            return [str(mesh.path)]
        return [self._write(np.concatenate([part.corners for part in mesh.parts]))]

    def _write(self, triangles: np.ndarray) -> str:
        """Write triangles, shape (n, 3, 3), to a file of their own; return its name."""
        path = self._folder / f"{self._n_files}.stl"
        self._n_files += 1
        path.write_bytes(write_stl(triangles))
        return str(path)


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
