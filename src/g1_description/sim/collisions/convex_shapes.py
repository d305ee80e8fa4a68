"""The convex shapes that stand for the links of a robot."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from g1_description.core.robot.assembly import WORLD
from g1_description.core.robot.description import Description, Link, Shape
from g1_description.core.rotation import rotate
from g1_description.sim.meshes.hull_vertices import hull_vertices, thinned
from g1_description.sim.meshes.hulls import hull_points, outline
from g1_description.sim.meshes.shapes import Mesh, find_meshes, is_there

TOLERANCE = 5e-4
"""How far a hull of very many points may stick out of the one that stands for it, in
[m]: PyBullet's time grows with the points."""


@dataclass(frozen=True)
class ConvexShape:
    """All points within a radius of the convex hull of some points."""

    link: int
    """Row of its link, as of ``link_rows``."""

    points: np.ndarray
    """Vertices of a hull in the link frame, in [m], shape (n, 3)."""

    radius: float = 0.0
    """In [m]: that of a sphere, of which there is one point; else 0."""


@dataclass(frozen=True)
class RobotShapes:
    """What stands for the links of a robot."""

    links: tuple[str, ...]
    """The links in the order of ``Description.link_names``, without the world."""

    shapes: tuple[ConvexShape, ...]
    """In the order of the links."""

    by_visuals: tuple[str, ...]
    """Links that have no collision shape, for which their visuals stand."""

    without_shapes: tuple[str, ...]
    """Links for which nothing stands."""

    left_out: tuple[str, ...]
    """A message for each mesh that cannot be read."""

    @property
    def judged(self) -> tuple[str, ...]:
        """Names of the links for which something stands."""
        rows = {shape.link for shape in self.shapes}
        return tuple(name for row, name in enumerate(self.links) if row in rows)


def robot_shapes(description: Description, visual_hulls: bool = True) -> RobotShapes:
    """Find what stands for the links of a robot.

    Args:
        description: The robot; names of its meshes can be found from anywhere.
        visual_hulls: Whether the convex hulls of the visuals stand for a link that has
            no collision shape.

    Returns:
        Boxes, cylinders (as prisms) and meshes as convex hulls, a collision mesh of
        several parts as one hull each; spheres exactly. A plane is no shape of a link.
    """
    links = [link for link in description.links if not _is_world(link, description)]
    used = [_shapes_of(link, visual_hulls) for link in links]
    meshes, left_out = find_meshes(shape for shapes in used for shape in shapes)
    found = []
    for row, (link, shapes) in enumerate(zip(links, used)):
        found += _convex(row, shapes, meshes, is_split=bool(link.collisions))
    rows = {shape.link for shape in found}
    return RobotShapes(
        links=tuple(link.name for link in links),
        shapes=tuple(found),
        by_visuals=tuple(
            link.name
            for row, link in enumerate(links)
            if row in rows and not link.collisions
        ),
        without_shapes=tuple(
            link.name for row, link in enumerate(links) if row not in rows
        ),
        left_out=left_out,
    )


def _is_world(link: Link, description: Description) -> bool:
    """Return whether a link is the world, which has no pose."""
    return link.name == WORLD == description.root


def _shapes_of(link: Link, visual_hulls: bool) -> tuple[Shape, ...]:
    """Select the shapes that count for a link."""
    shapes = link.collisions or (link.visuals if visual_hulls else ())
    return tuple(shape for shape in shapes if shape.kind != "plane")


def _convex(
    row: int, shapes: Sequence[Shape], meshes: Mapping[str, Mesh], is_split: bool
) -> list[ConvexShape]:
    """Make the convex shapes of a link.

    Args:
        row: The link's.
        shapes: Its shapes.
        meshes: By the names of their files.
        is_split: Whether each part of a mesh becomes a hull of its own.
    """
    return [
        ConvexShape(row, shape.pose[:3] + rotate(shape.pose[3:], points), radius)
        for shape in shapes
        if is_there(shape, meshes)
        for points, radius in _hulls(shape, meshes, is_split)
    ]


def _hulls(
    shape: Shape, meshes: Mapping[str, Mesh], is_split: bool
) -> Iterator[tuple[np.ndarray, float]]:
    """Give vertices in a shape's frame, shape (n, 3), and the radius about them."""
    if shape.kind == "mesh" and is_split:
        for part in hull_points(meshes[shape.filename]):
            yield _few(part * np.array(shape.size)), 0.0
    else:
        points, radius = outline(shape, meshes)
        yield _few(points), radius


def _few(points: np.ndarray) -> np.ndarray:
    """Select points whose hull is that of all, or almost, shape (m, 3)."""
    few, _ = thinned(hull_vertices(points), TOLERANCE)
    return few
