"""Visual shapes as PyBullet draws them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from g1_description.core.robot.description import Shape
from g1_description.sim.bullet.client import BulletClient, pybullet
from g1_description.sim.meshes.contents import Part
from g1_description.sim.meshes.shapes import Mesh
from g1_description.sim.meshes.surfaces import cylinder, sphere

BATCH_SIZE = 40_000
"""PyBullet takes 131072 corners of one shape."""

GREY = (0.7, 0.7, 0.7, 1.0)
"""Colour of a shape where its file gives none."""


def load_visual(
    client: BulletClient, shape: Shape, mesh: Mesh | None
) -> tuple[list[int], str]:
    """Load a shape, with a box around it that PyBullet keeps up.

    Args:
        client: PyBullet.
        shape: The shape.
        mesh: What was found of it if it is a mesh. As in RViz, the colours of the
            mesh's own materials count more than that of the shape.

    Returns:
        PyBullet's numbers for its bodies, and a message that says why there is none.
    """
    color = list(shape.color or GREY)
    kind = pybullet.GEOM_BOX if shape.kind == "box" else pybullet.GEOM_MESH
    looks = [(_primitive(shape), color)]
    if mesh is not None:
        looks = [
            (form, list(part.color or color))
            for part in by_color(mesh.parts)
            for form in _triangles(part, np.array(shape.size))
        ] or [({"fileName": str(mesh.path), "meshScale": list(shape.size)}, color)]
    try:
        return [_body(client, kind, *look) for look in looks], ""
    except pybullet.error:
        return [], f"{shape.kind} {shape.filename} cannot be read"


def by_color(parts: Sequence[Part]) -> list[Part]:
    """Put the parts of one colour together."""
    return [
        Part(
            np.concatenate([part.corners for part in parts if part.color == color]),
            np.concatenate([part.normals for part in parts if part.color == color]),
            color,
        )
        for color in dict.fromkeys(part.color for part in parts)
    ]


def _body(
    client: BulletClient, kind: int, form: dict[str, object], color: list[float]
) -> int:
    """Make a body of a form in PyBullet's words; give PyBullet's number for it."""
    visual = client.createVisualShape(kind, **form, rgbaColor=color)
    solid = {name: value for name, value in form.items() if name != "normals"}
    box = client.createCollisionShape(kind, **solid)
    return int(client.createMultiBody(0.0, box, visual))


def _triangles(part: Part, scale: np.ndarray) -> Iterator[dict[str, object]]:
    """Write a part of a mesh as PyBullet takes it: so many triangles at a time.

    Args:
        part: The part.
        scale: Of the mesh, shape (3,); below zero it is mirrored.
    """
    turn = 1 if np.prod(scale) > 0 else -1
    with np.errstate(all="ignore"):
        normals = part.normals / scale
        normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    corners = (part.corners * scale)[:, ::turn]
    normals = np.nan_to_num(normals)[:, ::turn]
    for first in range(0, len(corners), BATCH_SIZE):
        some = slice(first, first + BATCH_SIZE)
        yield {
            "vertices": corners[some].reshape(-1, 3).tolist(),
            "normals": normals[some].reshape(-1, 3).tolist(),
            "indices": list(range(corners[some].size // 3)),
        }


def _primitive(shape: Shape) -> dict[str, object]:
    """Write a shape as PyBullet takes it; its own round shapes have corners."""
    if shape.kind == "mesh":
        return {}
    if shape.kind == "box":
        return {"halfExtents": [size / 2 for size in shape.size]}
    surface = sphere(*shape.size) if shape.kind == "sphere" else cylinder(*shape.size)
    return {
        "vertices": surface.vertices.tolist(),
        "normals": surface.normals.tolist(),
        "indices": surface.triangles.ravel().tolist(),
    }
