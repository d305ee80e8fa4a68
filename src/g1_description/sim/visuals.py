"""Visual shapes as PyBullet draws them."""

from __future__ import annotations

from collections.abc import Callable

from ..core.description import Shape
from ..core.surfaces import cylinder, sphere
from .bullet import BulletClient, pybullet
from .meshes import find_mesh

GREY = (0.7, 0.7, 0.7, 1.0)
"""Colour of a shape where its file gives none."""


def load_visual(
    client: BulletClient,
    shape: Shape,
    package_folder: Callable[[str], str | None],
) -> tuple[int | None, str]:
    """Load a shape, with a box around it that PyBullet keeps up.

    Args:
        client: PyBullet.
        shape: The shape; a mesh without colour keeps its own.
        package_folder: Gives a package's folder, None if there is no such package.

    Returns:
        PyBullet's number for the body; or None and a clause that says why not.
    """
    form = _primitive(shape)
    if shape.kind == "mesh":
        path, why_not = find_mesh(shape.filename, package_folder)
        if path is None:
            return None, why_not
        form = {"fileName": str(path), "meshScale": list(shape.size)}
    looks = dict(form)
    if shape.color is not None or shape.kind != "mesh":
        looks["rgbaColor"] = list(shape.color or GREY)
    form.pop("normals", None)
    kind = pybullet.GEOM_BOX if shape.kind == "box" else pybullet.GEOM_MESH
    try:
        visual = client.createVisualShape(kind, **looks)
        solid = client.createCollisionShape(kind, **form)
        body = client.createMultiBody(0.0, solid, visual)
    except pybullet.error:
        return None, f"{shape.kind} {shape.filename} cannot be read"
    return body, ""


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
