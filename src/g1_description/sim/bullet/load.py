"""A robot written for PyBullet: what its own URDF import gets wrong is settled first.

PyBullet gives a link without inertial 1 kg, so bodies are lumped before. It fails
the whole load for one missing mesh, so only meshes that were read are named, by
absolute paths. It needs no visuals: ``scene`` draws them.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from g1_description.core.errors import DescriptionError
from g1_description.core.robot.description import Description
from g1_description.sim.model import Model

from .client import BulletClient
from .urdf_text import prepared_urdf, principal_axes

ROOT = -1
"""PyBullet's number for a body's root link."""

MOST_JOINTS = 127
"""Degrees of freedom of one body in PyBullet, without its base."""

MOST_LINKS = 1000
"""Links of one model: more could not be published a thousand times a second."""

MOST_SHAPES = 1000
"""Collision shapes of one model: a step with ten thousand takes minutes."""

MASS_TOLERANCE = 1e-3
"""How far the loaded mass may be from the file's, in [kg]."""


def load_model(
    client: BulletClient,
    model: Model,
    tree: int = 0,
) -> tuple[int, tuple[str, ...]]:
    """Load a tree of a model where it is.

    Args:
        client: PyBullet.
        model: The model.
        tree: Which of the model's trees.

    Returns:
        PyBullet's number for the body, and a clause for each shape left out.

    Raises:
        DescriptionError: If PyBullet refuses the model or loads something else.
    """
    description, fixed = model.assembly.description.trees[tree], model.trees[tree].fixed
    with tempfile.TemporaryDirectory() as folder:
        text, left_out = prepared_urdf(description, Path(folder), model.assembly.static)
        file = Path(folder) / "robot.urdf"
        file.write_text(text, encoding="utf-8")
        number = _load(client, file, model.root_poses[tree], fixed)
    _write_inertias(client, number, description)
    _check_mass(client, number, description, fixed)
    return number, left_out + _unread_shapes(client, number, description, text)


def _load(client: BulletClient, file: Path, pose: np.ndarray, fixed: bool) -> int:
    """Load a prepared URDF; give PyBullet's number for the body."""
    try:
        return client.loadURDF(
            str(file),
            pose[:3],
            pose[3:],
            useFixedBase=fixed,
            flags=client.URDF_USE_INERTIA_FROM_FILE,
        )
    except client.error as error:
        raise DescriptionError(f"PyBullet cannot load the robot: {error}.") from error


def links_of(
    client: BulletClient, body: int, description: Description
) -> list[tuple[int, str]]:
    """List a body's links by PyBullet's numbers; ``ROOT`` is the root."""
    infos = (client.getJointInfo(body, n) for n in range(client.getNumJoints(body)))
    below = ((info[0], info[12].decode()) for info in infos)
    return [(ROOT, description.root), *below]


def _write_inertias(client: BulletClient, body: int, description: Description) -> None:
    """Give the links their principal moments.

    PyBullet sets all three to zero where the largest exceeds the sum of the other
    two, as rounded figures in many files make it.
    """
    inertials = {link.name: link.inertial for link in description.links}
    for index, name in links_of(client, body, description):
        inertial = inertials[name]
        if inertial is not None:
            moments, _ = principal_axes(inertial.inertia)
            client.changeDynamics(body, index, localInertiaDiagonal=moments)


def _unread_shapes(
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
    for index, name in links_of(client, body, description):
        read = len(client.getCollisionShapeData(body, index))
        if read < written[name]:
            clauses.append(
                f"{written[name] - read} of {written[name]} collision shapes of link "
                f"{name} cannot be read"
            )
    return tuple(clauses)


def check_size(description: Description, is_dynamic: bool) -> None:
    """Refuse what PyBullet loads but cannot step: its own calls fail then.

    Raises:
        DescriptionError: If the model has too many links, joints or shapes.
    """
    links = len(description.links)
    joints = max(len(tree.movable_joints) for tree in description.trees)
    if links > MOST_LINKS:
        raise DescriptionError(
            f"Robot '{description.name}' has {links} links that are not fixed to "
            f"others; there is room for {MOST_LINKS}."
        )
    if is_dynamic and joints > MOST_JOINTS:
        raise DescriptionError(
            f"Robot '{description.name}' has {joints} movable joints; only kinematic "
            f"physics has room for more than {MOST_JOINTS}."
        )
    shapes = sum(len(link.collisions) for link in description.links)
    if shapes > MOST_SHAPES:
        raise DescriptionError(
            f"Robot '{description.name}' has {shapes} collision shapes; there is room "
            f"for {MOST_SHAPES}."
        )


def _check_mass(
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
    masses = {
        link.name: link.inertial.mass
        for link in description.links
        if link.inertial and not (fixed and link.name == description.root)
    }
    loaded = sum(
        client.getDynamicsInfo(body, index)[0]
        for index, name in links_of(client, body, description)
        if name in masses
    )
    expected = sum(masses.values())
    if abs(loaded - expected) > MASS_TOLERANCE:
        raise DescriptionError(
            f"Robot '{description.name}' weighs {expected:.3f} kg by its file, "
            f"but PyBullet loaded {loaded:.3f} kg."
        )
