"""A robot written for PyBullet: what its own URDF import gets wrong is settled first.

PyBullet gives a link without inertial 1 kg, so bodies are lumped before. It fails
the whole load for one missing mesh, so only meshes that exist are named, by
absolute paths. It needs no visuals: nothing is drawn here.
"""

from __future__ import annotations

import tempfile
from xml.etree import ElementTree

import numpy as np
from pybullet_utils.bullet_client import BulletClient

from ..core.description import Description
from ..core.errors import DescriptionError
from .urdf_text import principal_axes

MOST_JOINTS = 127
"""Degrees of freedom of one body in PyBullet, without its base."""

MASS_TOLERANCE = 1e-3
"""How far the loaded mass may be from the file's, in [kg]."""


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


def unread_shapes(
    client: BulletClient, body: int, description: Description, text: str
) -> tuple[str, ...]:
    """Find collision shapes that PyBullet passed over, such as a broken mesh.

    Args:
        client: PyBullet.
        body: The loaded body.
        description: The robot.
        text: What ``prepared_urdf`` wrote of it.

    Returns:
        A clause for each link that has fewer shapes than were written.
    """
    written = {
        link.get("name"): len(link.findall("collision"))
        for link in ElementTree.fromstring(text).findall("link")
    }
    clauses = []
    for index in range(-1, client.getNumJoints(body)):
        root = index == -1
        name = (
            description.root if root else client.getJointInfo(body, index)[12].decode()
        )
        read = len(client.getCollisionShapeData(body, index))
        if read < written[name]:
            clauses.append(
                f"{written[name] - read} of {written[name]} collision shapes of link "
                f"{name} cannot be read"
            )
    return tuple(clauses)


def check_size(description: Description) -> None:
    """Refuse what PyBullet loads but cannot step: its own calls fail then.

    Raises:
        DescriptionError: If the robot has too many joints.
    """
    joints = len(description.joints)
    if joints > MOST_JOINTS:
        raise DescriptionError(
            f"Robot '{description.name}' has {joints} movable joints; only kinematic "
            f"physics has room for more than {MOST_JOINTS}."
        )


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
