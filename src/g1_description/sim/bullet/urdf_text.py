"""A robot written as URDF that PyBullet reads as it is meant."""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from g1_description.core.bounds import LARGEST
from g1_description.core.errors import DescriptionError
from g1_description.core.robot.assembly import WORLD
from g1_description.core.robot.description import (
    Description,
    Inertial,
    Joint,
    Link,
    Shape,
)
from g1_description.core.rotation import axes_to_rpy, to_axes
from g1_description.sim.meshes.shapes import Mesh, find_meshes
from g1_description.sim.meshes.stl import write_stl

UNKNOWN = Inertial(1.0, np.zeros(3), np.eye(3))
"""In the place of mass properties that a file does not give. Nothing moves by itself
where there are such links; without a mass PyBullet finds no contacts."""

LONGEST_NAME = 1000
"""PyBullet cuts names at 1023 bytes."""

MOST_HULLS = 100
"""A mesh of more parts becomes one convex hull, instead of one for each."""


def prepared_urdf(
    description: Description,
    folder: Path,
    is_static: bool = False,
) -> tuple[str, tuple[str, ...]]:
    """Write a tree of bodies so that PyBullet loads what their file means.

    PyBullet's links sit where their joint's axis is; a joint whose axis does not
    go through its child's origin moves the child's content instead.

    Args:
        description: The tree.
        folder: Where meshes may be written that the text names.
        is_static: Whether it never moves: then meshes are hollow where their files are.

    Returns:
        URDF text, and a clause for each mesh that was left out.

    Raises:
        DescriptionError: If PyBullet would cut a name short.
    """
    anchors = {joint.child: joint.joint_origin for joint in description.joints}
    # The robot's own name is not needed, and one of a megabyte ends PyBullet.
    robot = ElementTree.Element("robot", name="robot")
    left_out: list[str] = []
    names = (*description.link_names, *(joint.name for joint in description.joints))
    too_long = [name for name in names if len(name.encode()) > LONGEST_NAME]
    if too_long:
        raise DescriptionError(
            f"The name {too_long[0][:40]}... is longer than {LONGEST_NAME} bytes."
        )
    shapes = [shape for link in description.links for shape in link.collisions]
    meshes = find_meshes(shapes)
    files: dict[str, list[Path]] = {}
    for name, mesh in meshes.items():
        if isinstance(mesh, str):
            left_out.append(mesh)
        else:
            files[name] = _collision_files(mesh, folder / str(len(files)))
    for link in description.links:
        element = ElementTree.SubElement(robot, "link", name=link.name)
        anchor = anchors.get(link.name, np.zeros(3))
        if link.name != WORLD or description.root != WORLD:
            _write_inertial(element, link, anchor)
        for shape in link.collisions:
            if shape.kind != "mesh":
                _write_collision(element, shape, anchor)
            for path in files.get(shape.filename, ()):
                collision = _write_collision(element, shape, anchor, path)
                if is_static:
                    collision.set("concave", "yes")
    for joint in description.joints:
        _write_joint(robot, joint, anchors.get(joint.parent, np.zeros(3)))
    text = ElementTree.tostring(robot, encoding="unicode")
    # PyBullet reads lines of 1024 characters and breaks longer ones anywhere.
    return text.replace("><", ">\n<"), tuple(dict.fromkeys(left_out))


def _numbers(values: np.ndarray | tuple[float, ...]) -> str:
    """Write numbers without losing a bit."""
    return " ".join(repr(float(value)) for value in values)


def _write_origin(
    element: ElementTree.Element, position: np.ndarray, axes: np.ndarray
) -> None:
    """Add an origin element for a position, shape (3,), and axes, shape (3, 3)."""
    rpy = _numbers(axes_to_rpy(axes))
    ElementTree.SubElement(element, "origin", xyz=_numbers(position), rpy=rpy)


def _write_inertial(
    element: ElementTree.Element, link: Link, anchor: np.ndarray
) -> None:
    """Add a link's inertial, seen from the anchor of its joint."""
    given = link.inertial or UNKNOWN
    # PyBullet reads only round bodies without a warning; it is given the moments later.
    moments, axes = principal_axes(given.inertia)
    inertial = ElementTree.SubElement(element, "inertial")
    _write_origin(inertial, given.center_of_mass - anchor, axes)
    ElementTree.SubElement(inertial, "mass", value=repr(given.mass))
    zero = dict.fromkeys(("ixy", "ixz", "iyz"), "0")
    largest = repr(float(moments.max()))
    diagonal = dict.fromkeys(("ixx", "iyy", "izz"), largest)
    ElementTree.SubElement(inertial, "inertia", {**diagonal, **zero})


def principal_axes(inertia: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find the axes about which a body turns freely.

    Args:
        inertia: Tensor in [kg m^2], shape (3, 3).

    Returns:
        Principal moments in [kg m^2], shape (3,), and the principal axes as the
        columns of a rotation matrix, shape (3, 3).
    """
    moments, axes = np.linalg.eigh(inertia)
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    return moments, axes


def _write_collision(
    element: ElementTree.Element,
    shape: Shape,
    anchor: np.ndarray,
    path: Path | None = None,
) -> ElementTree.Element:
    """Add a collision shape; a mesh becomes its convex hull, unless it is concave."""
    collision = ElementTree.SubElement(element, "collision")
    _write_origin(collision, shape.pose[:3] - anchor, to_axes(shape.pose[3:]))
    geometry = ElementTree.SubElement(collision, "geometry")
    if shape.kind == "box":
        ElementTree.SubElement(geometry, "box", size=_numbers(shape.size))
    elif shape.kind == "sphere":
        ElementTree.SubElement(geometry, "sphere", radius=repr(float(shape.size[0])))
    elif shape.kind == "plane":
        ElementTree.SubElement(geometry, "plane", normal=_numbers(shape.size))
    elif shape.kind == "cylinder":
        radius, length = (repr(float(size)) for size in shape.size)
        ElementTree.SubElement(geometry, "cylinder", radius=radius, length=length)
    else:
        scale = _numbers(shape.size)
        ElementTree.SubElement(geometry, "mesh", filename=str(path), scale=scale)
    return collision


def _collision_files(mesh: Mesh, beginning: Path) -> list[Path]:
    """Give the files of a mesh: what PyBullet reads itself, or one for each part.

    Args:
        mesh: The mesh.
        beginning: What the names of files begin with that are written.
    """
    if not mesh.parts:
        return [mesh.path]
    corners = [part.corners for part in mesh.parts]
    if len(corners) > MOST_HULLS:
        corners = [np.concatenate(corners)]
    paths = [Path(f"{beginning}_{number}.stl") for number in range(len(corners))]
    for path, triangles in zip(paths, corners):
        path.write_bytes(write_stl(triangles))
    return paths


def _write_joint(
    robot: ElementTree.Element, joint: Joint, parent_anchor: np.ndarray
) -> None:
    """Add a joint; mimic is left out, as Gazebo leaves it out."""
    element = ElementTree.SubElement(robot, "joint", name=joint.name, type=joint.kind)
    ElementTree.SubElement(element, "parent", link=joint.parent)
    ElementTree.SubElement(element, "child", link=joint.child)
    axes = to_axes(joint.pose[3:])
    origin = joint.pose[:3] + axes @ joint.joint_origin - parent_anchor
    _write_origin(element, origin, axes)
    if joint.kind == "fixed":
        return
    ElementTree.SubElement(element, "axis", xyz=_numbers(joint.axis))
    lower, upper = joint.lower, joint.upper
    if math.isfinite(lower) != math.isfinite(upper):  # PyBullet wants both or none
        lower, upper = max(lower, -LARGEST), min(upper, LARGEST)
    limit = {
        "lower": lower,
        "upper": upper,
        "effort": joint.effort,
        "velocity": joint.velocity,
    }
    finite = {
        name: repr(value) for name, value in limit.items() if math.isfinite(value)
    }
    ElementTree.SubElement(element, "limit", finite)
