"""A robot written for PyBullet: what its own URDF import gets wrong is settled first.

PyBullet gives a link without inertial 1 kg, so bodies are lumped before. It fails
the whole load for one missing mesh, so only meshes that exist are named, by
absolute paths. It needs no visuals: nothing is drawn here.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from pybullet_utils.bullet_client import BulletClient

from ..core.description import Description, Joint, Link, Shape
from ..core.errors import DescriptionError
from ..core.resources import local_path
from ..core.rotation import axes_to_rpy, to_axes

MASS_TOLERANCE = 1e-3
"""How far the loaded mass may be from the file's, in [kg]."""


def prepared_urdf(
    description: Description, package_folder: Callable[[str], str | None]
) -> tuple[str, tuple[str, ...]]:
    """Write a robot so that PyBullet loads what the robot's file means.

    Args:
        description: Robot with movable joints only; every link has mass.
        package_folder: Gives a package's folder, None if there is no such package.

    Returns:
        URDF text, and the mesh files that were left out because they don't exist.
    """
    robot = ElementTree.Element("robot", name=description.name)
    missing: list[str] = []
    for link in description.links:
        element = ElementTree.SubElement(robot, "link", name=link.name)
        _write_inertial(element, link)
        for shape in link.collisions:
            path = None
            if shape.kind == "mesh":
                path = local_path(shape.filename, package_folder)
                if path is None:
                    missing.append(shape.filename)
                    continue
            _write_collision(element, shape, path)
    for joint in description.joints:
        _write_joint(robot, joint)
    text = ElementTree.tostring(robot, encoding="unicode")
    # PyBullet reads lines of 1024 characters and breaks longer ones anywhere.
    return text.replace("><", ">\n<"), tuple(dict.fromkeys(missing))


def _numbers(values: np.ndarray | tuple[float, ...]) -> str:
    """Write numbers without losing a bit."""
    return " ".join(repr(float(value)) for value in values)


def _write_origin(
    element: ElementTree.Element, position: np.ndarray, axes: np.ndarray
) -> None:
    """Add an origin element for a position, shape (3,), and axes, shape (3, 3)."""
    rpy = _numbers(axes_to_rpy(axes))
    ElementTree.SubElement(element, "origin", xyz=_numbers(position), rpy=rpy)


def _write_inertial(element: ElementTree.Element, link: Link) -> None:
    """Add a link's inertial."""
    if link.inertial is None:
        raise DescriptionError(f"Link {link.name} has no mass.")
    moments, axes = principal_axes(link.inertial.inertia)
    inertial = ElementTree.SubElement(element, "inertial")
    _write_origin(inertial, link.inertial.center_of_mass, axes)
    ElementTree.SubElement(inertial, "mass", value=repr(link.inertial.mass))
    zero = dict.fromkeys(("ixy", "ixz", "iyz"), "0")
    diagonal = dict(zip(("ixx", "iyy", "izz"), _numbers(moments).split()))
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
    element: ElementTree.Element, shape: Shape, path: Path | None
) -> None:
    """Add a collision shape; meshes become convex hulls in PyBullet."""
    collision = ElementTree.SubElement(element, "collision")
    _write_origin(collision, shape.pose[:3], to_axes(shape.pose[3:]))
    geometry = ElementTree.SubElement(collision, "geometry")
    if shape.kind == "box":
        ElementTree.SubElement(geometry, "box", size=_numbers(shape.size))
    elif shape.kind == "sphere":
        ElementTree.SubElement(geometry, "sphere", radius=repr(float(shape.size[0])))
    elif shape.kind == "cylinder":
        radius, length = (repr(float(size)) for size in shape.size)
        ElementTree.SubElement(geometry, "cylinder", radius=radius, length=length)
    else:
        scale = _numbers(shape.size)
        ElementTree.SubElement(geometry, "mesh", filename=str(path), scale=scale)


def _write_joint(robot: ElementTree.Element, joint: Joint) -> None:
    """Add a movable joint; mimic is left out, as Gazebo leaves it out."""
    element = ElementTree.SubElement(robot, "joint", name=joint.name, type=joint.kind)
    ElementTree.SubElement(element, "parent", link=joint.parent)
    ElementTree.SubElement(element, "child", link=joint.child)
    _write_origin(element, joint.pose[:3], to_axes(joint.pose[3:]))
    ElementTree.SubElement(element, "axis", xyz=_numbers(joint.axis))
    limit = {
        "lower": joint.lower,
        "upper": joint.upper,
        "effort": joint.effort,
        "velocity": joint.velocity,
    }
    finite = {
        name: repr(value) for name, value in limit.items() if math.isfinite(value)
    }
    ElementTree.SubElement(element, "limit", finite)
    ElementTree.SubElement(
        element, "dynamics", damping=repr(joint.damping), friction=repr(joint.friction)
    )


def load(
    client: BulletClient,
    description: Description,
    text: str,
    pose: np.ndarray,
    fixed: bool,
) -> int:
    """Load a prepared robot.

    Args:
        client: PyBullet.
        description: The robot.
        text: What ``prepared_urdf`` wrote of it.
        pose: Pose of the root link frame in the world, shape (7,).
        fixed: Whether the root does not move.

    Returns:
        PyBullet's number for the body.

    Raises:
        DescriptionError: If PyBullet refuses the robot.
    """
    with tempfile.NamedTemporaryFile("w", suffix=".urdf", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        try:
            body = client.loadURDF(
                file.name,
                pose[:3],
                pose[3:],
                useFixedBase=fixed,
                flags=client.URDF_USE_INERTIA_FROM_FILE,
            )
        except client.error as error:
            raise DescriptionError(f"PyBullet cannot load the robot: {error}.") from (
                error
            )
    _write_inertias(client, body, description)
    return body


def _write_inertias(client: BulletClient, body: int, description: Description) -> None:
    """Give the links their principal moments.

    PyBullet sets all three to zero where the largest exceeds the sum of the other
    two, as rounded figures in many files make it.
    """
    inertials = {link.name: link.inertial for link in description.links}
    for index in range(-1, client.getNumJoints(body)):
        root = index == -1
        name = (
            description.root if root else client.getJointInfo(body, index)[12].decode()
        )
        inertial = inertials[name]
        if inertial is not None:
            moments, _ = principal_axes(inertial.inertia)
            client.changeDynamics(body, index, localInertiaDiagonal=moments)


def check_mass(
    client: BulletClient, body: int, description: Description, fixed: bool
) -> None:
    """Check that PyBullet gave the body the mass its file says.

    Args:
        client: PyBullet.
        body: The loaded body.
        description: What was to be loaded.
        fixed: Whether the root does not move: PyBullet forgets its mass then.

    Raises:
        DescriptionError: If the masses differ by more than a gram.
    """
    first = 0 if fixed else -1
    loaded = sum(
        client.getDynamicsInfo(body, link)[0]
        for link in range(first, client.getNumJoints(body))
    )
    root = next(link for link in description.links if link.name == description.root)
    expected = description.mass
    if fixed and root.inertial is not None:
        expected -= root.inertial.mass
    if abs(loaded - expected) > MASS_TOLERANCE:
        raise DescriptionError(
            f"Robot '{description.name}' weighs {expected:.3f} kg by its file, "
            f"but PyBullet loaded {loaded:.3f} kg."
        )
