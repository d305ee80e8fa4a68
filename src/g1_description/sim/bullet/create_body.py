"""A robot made in PyBullet from our arrays: the one place that knows its form there.

PyBullet's links sit where their joint's axis is; a joint whose axis misses its child's
origin moves the child's content instead. It needs no visuals: ``scene`` draws them.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from g1_description.bounds import MAX_VALUE
from g1_description.errors import DescriptionError
from g1_description.robot.assembly import WORLD
from g1_description.robot.description import Description, Inertial, Joint, Link
from g1_description.robot.lumping import is_positive
from g1_description.robot.rotation import axes_to_rpy, from_rpy, rotate
from g1_description.robot.transform import IDENTITY
from g1_description.robot.tree import depth_first
from g1_description.sim.bullet.client import BulletClient, pybullet
from g1_description.sim.bullet.collision import MAX_TOGETHER, Form, Forms, create_shapes
from g1_description.sim.meshes.shapes import Mesh
from g1_description.sim.model import Model

ROOT = -1
"""PyBullet's number for a body's root link."""

MAX_JOINTS = 127
"""Links of one body in PyBullet, without its root: it leaves out more in silence."""

MAX_LINKS = 1000
"""Links of one model: more could not be published a thousand times a second."""

MAX_SHAPES = 1000
"""Collision shapes of one model: a step with ten thousand takes minutes."""

UNKNOWN = Inertial(1.0, np.zeros(3), np.eye(3))
"""In the place of mass properties that a file does not give. Nothing moves by itself
where there are such links; without a mass PyBullet finds no contacts."""

NO_MASS = Inertial(0.0, np.zeros(3), np.zeros((3, 3)))

JOINTS = {
    "revolute": pybullet.JOINT_REVOLUTE,
    "continuous": pybullet.JOINT_REVOLUTE,
    "prismatic": pybullet.JOINT_PRISMATIC,
    "fixed": pybullet.JOINT_FIXED,
}


class TooManyLinksError(DescriptionError):
    """PyBullet has no room for the links of a tree."""


@dataclass(frozen=True)
class Loaded:
    """A body in PyBullet."""

    number: int
    """PyBullet's number for it."""

    links: tuple[str, ...]
    """Names by PyBullet's numbers for its links from ``ROOT`` on. Where one has more
    shapes than PyBullet takes together, the next ones are of the same name."""

    deviations: Mapping[str, float]
    """As ``Forms.deviations``."""


@dataclass(frozen=True)
class _Row:
    """A link as PyBullet has it."""

    name: str
    parent: int
    """Row of the link that carries it."""

    joint: Joint | None
    """What carries it; None for the root, and for what holds more shapes of a link."""

    position: np.ndarray
    """In the frame that PyBullet has for the parent, in [m], shape (3,)."""

    anchor: np.ndarray
    """Where PyBullet has its frame, in the link frame, in [m], shape (3,)."""

    inertial: Inertial
    forms: Sequence[Form] = field(repr=False)


def create_body(
    client: BulletClient, model: Model, meshes: Mapping[str, Mesh], tree: int = 0
) -> Loaded:
    """Make a tree of a model where it is.

    Args:
        client: PyBullet.
        model: The model.
        meshes: The meshes of its collision shapes, by their names as written; shapes of
            others are left out.
        tree: Which of the model's trees.

    Returns:
        The body.

    Raises:
        TooManyLinksError: If PyBullet has no room for all links.
        DescriptionError: If PyBullet refuses the model.
    """
    description, fixed = model.assembly.description.trees[tree], model.trees[tree].fixed
    with tempfile.TemporaryDirectory(dir=_temporary_folder()) as folder:
        forms = Forms(meshes, Path(folder), model.assembly.static)
        rows = _rows(description, forms)
        _check_room(description.name, rows)
        try:
            number = _create(client, rows, model.root_poses[tree], fixed)
        except client.error as error:
            raise DescriptionError(
                f"PyBullet cannot load the robot: {error}."
            ) from error
    _check_count(client, number, description.name, rows)
    _set_moments_and_limits(client, number, rows)
    return Loaded(number, tuple(row.name for row in rows), forms.deviations)


def _temporary_folder() -> str:
    """Return a folder for temporary files; PyBullet dies of names beyond ASCII."""
    usual = tempfile.gettempdir()
    return usual if usual.isascii() else "/tmp"


def _rows(description: Description, forms: Forms) -> list[_Row]:
    """List the links of a tree as PyBullet numbers them: depth first.

    A link with too many shapes is followed by others without mass that are fixed to it.
    """
    above = {joint.child: joint for joint in description.joints}
    links = {link.name: link for link in description.links}
    rows: list[_Row] = []
    places: dict[str, int] = {}
    for name in depth_first(description.root, description.joints):
        joint = above.get(name)
        parent, position, anchor = 0, np.zeros(3), np.zeros(3)
        if joint is not None:
            parent, anchor = places[joint.parent], joint.joint_origin
            position = joint.pose[:3] + rotate(joint.pose[3:], anchor)
            position = position - rows[parent].anchor
        places[name] = place = len(rows)
        inertial = _inertial(links[name], joint is None)
        all_forms = forms.of(links[name].collisions, anchor)
        first, *others = _groups(all_forms)
        rows.append(_Row(name, parent, joint, position, anchor, inertial, first))
        rows += [
            _Row(name, place, None, np.zeros(3), anchor, NO_MASS, group)
            for group in others
        ]
    return rows


def _groups(forms: Sequence[Form]) -> list[Sequence[Form]]:
    """Divide shapes into groups that PyBullet takes together; at least one."""
    begins = range(0, max(len(forms), 1), MAX_TOGETHER)
    return [forms[begin : begin + MAX_TOGETHER] for begin in begins]


def _inertial(link: Link, is_root: bool) -> Inertial:
    """Return the mass properties that PyBullet is given for a link."""
    if is_root and link.name == WORLD:
        return NO_MASS
    inertial = link.inertial or UNKNOWN
    if is_positive(inertial.inertia):
        return inertial
    return replace(inertial, inertia=np.eye(3))  # as Gazebo's ODE


def _create(
    client: BulletClient, rows: Sequence[_Row], pose: np.ndarray, fixed: bool
) -> int:
    """Make a body with its root link at a pose; return PyBullet's number for it."""
    centers = [_center(row) for row in rows]
    shapes = [create_shapes(client, row.forms) for row in rows]
    root, *below = rows
    poses = [row.joint.pose if row.joint else IDENTITY for row in below]
    number = client.createMultiBody(
        baseMass=0.0 if fixed else root.inertial.mass,
        baseCollisionShapeIndex=shapes[0],
        basePosition=pose[:3],
        baseOrientation=pose[3:],
        baseInertialFramePosition=centers[0][:3],
        baseInertialFrameOrientation=centers[0][3:],
        linkMasses=[row.inertial.mass for row in below],
        linkCollisionShapeIndices=shapes[1:],
        linkVisualShapeIndices=[-1] * len(below),
        linkPositions=[row.position for row in below],
        linkOrientations=[pose[3:] for pose in poses],
        linkInertialFramePositions=[center[:3] for center in centers[1:]],
        linkInertialFrameOrientations=[center[3:] for center in centers[1:]],
        linkParentIndices=[row.parent for row in below],
        linkJointTypes=[
            JOINTS[row.joint.kind if row.joint else "fixed"] for row in below
        ],
        linkJointAxis=[row.joint.axis if row.joint else np.zeros(3) for row in below],
        # Without visuals PyBullet would read the meshes again and draw those.
        flags=client.URDF_IGNORE_VISUAL_SHAPES,
    )
    return int(number)


def _center(row: _Row) -> np.ndarray:
    """Place the principal axes in PyBullet's frame of a link, shape (7,)."""
    _, axes = principal_axes(row.inertial.inertia)
    center = row.inertial.center_of_mass - row.anchor
    return np.concatenate([center, from_rpy(axes_to_rpy(axes))])


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


def _set_moments_and_limits(
    client: BulletClient, number: int, rows: Sequence[_Row]
) -> None:
    """Set what ``createMultiBody`` does not take: moments of inertia and limits."""
    for index, row in enumerate(rows, ROOT):
        moments, _ = principal_axes(row.inertial.inertia)
        client.changeDynamics(number, index, localInertiaDiagonal=moments)
        joint = row.joint
        if joint and joint.kind in ("revolute", "prismatic"):
            # PyBullet wants both limits, or a joint has none.
            client.changeDynamics(
                number,
                index,
                jointLowerLimit=max(joint.lower, -MAX_VALUE),
                jointUpperLimit=min(joint.upper, MAX_VALUE),
            )


def _check_room(name: str, rows: Sequence[_Row]) -> None:
    """Check that PyBullet has room for the links of a tree.

    Raises:
        TooManyLinksError: If it has not.
    """
    if len(rows) > MAX_JOINTS + 1:
        raise TooManyLinksError(
            f"Robot '{name}' needs {len(rows)} links, at least one for each "
            f"{MAX_TOGETHER} collision shapes of a link; hold and limp have room for "
            f"{MAX_JOINTS + 1}."
        )


def _check_count(
    client: BulletClient, number: int, name: str, rows: Sequence[_Row]
) -> None:
    """Check that PyBullet made all links.

    Raises:
        DescriptionError: If there are fewer.
    """
    made = client.getNumJoints(number) + 1
    if made != len(rows):
        raise DescriptionError(
            f"Robot '{name}' has {len(rows)} links, but PyBullet made {made} of them."
        )


def check_size(description: Description, is_dynamic: bool) -> None:
    """Refuse what PyBullet has no room for, or takes too long for.

    Raises:
        DescriptionError: If the model has too many links, joints or shapes.
    """
    links = len(description.links)
    joints = max(len(tree.movable_joints) for tree in description.trees)
    if links > MAX_LINKS:
        raise DescriptionError(
            f"Robot '{description.name}' has {links} links that are not fixed to "
            f"others; there is room for {MAX_LINKS}."
        )
    if is_dynamic and joints > MAX_JOINTS:
        raise DescriptionError(
            f"Robot '{description.name}' has {joints} movable joints; only kinematic "
            f"physics has room for more than {MAX_JOINTS}."
        )
    shapes = sum(len(link.collisions) for link in description.links)
    if shapes > MAX_SHAPES:
        raise DescriptionError(
            f"Robot '{description.name}' has {shapes} collision shapes; there is room "
            f"for {MAX_SHAPES}."
        )
