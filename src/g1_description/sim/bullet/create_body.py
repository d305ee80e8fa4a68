"""Creates PyBullet bodies from our arrays.

The frame of a PyBullet link is on its joint's axis; if the axis misses the origin of
the child link, the shapes are offset. There are no visuals.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Dict

import numpy as np

from g1_description.bounds import MAX_VALUE
from g1_description.errors import DescriptionError
from g1_description.robot.assembly import WORLD
from g1_description.robot.description import Description, Inertial, Joint, Shape
from g1_description.robot.rotation import axes_to_rpy, from_rpy, rotate
from g1_description.robot.transform import IDENTITY
from g1_description.robot.tree import depth_first
from g1_description.sim.bullet.client import BulletClient, pybullet
from g1_description.sim.drives import Drives
from g1_description.sim.meshes.hulls import cylinder_points, thinned_hulls
from g1_description.sim.meshes.shapes import Mesh, is_there
from g1_description.sim.meshes.stl import write_stl
from g1_description.sim.model import Model
from g1_description.sim.substance import inertial_of, principal_axes

ROOT = -1
"""PyBullet's number for a body's root link."""

MAX_JOINTS = 127
"""PyBullet's limit of links per body, without the root; it drops others silently."""

NO_MASS = Inertial(0.0, np.zeros(3), np.zeros((3, 3)))

MAX_TOGETHER = 16
"""Collision shapes that PyBullet accepts in one call; it crashes with one more."""

Form = Dict[str, Any]
"""A collision shape as arguments of ``createCollisionShapeArray``."""

MIN_RADIUS = 1e-9
"""Smallest radius of a sphere in [m]: PyBullet refuses zero."""

KINDS = {
    "box": pybullet.GEOM_BOX,
    "sphere": pybullet.GEOM_SPHERE,
    "cylinder": pybullet.GEOM_MESH,
    "capsule": pybullet.GEOM_CAPSULE,
    "mesh": pybullet.GEOM_MESH,
    "plane": pybullet.GEOM_PLANE,
}

JOINTS = {
    "revolute": pybullet.JOINT_REVOLUTE,
    "continuous": pybullet.JOINT_REVOLUTE,
    "prismatic": pybullet.JOINT_PRISMATIC,
    "fixed": pybullet.JOINT_FIXED,
}


class TooManyLinksError(DescriptionError):
    """A tree has more links than PyBullet supports."""


@dataclass(frozen=True)
class _Row:
    """A link in PyBullet."""

    name: str
    parent: int
    """Row of its parent."""

    joint: Joint | None
    """Joint to the parent; None for the root, and for a row of additional shapes."""

    position: np.ndarray
    """Position in PyBullet's frame of the parent, in [m], shape (3,)."""

    anchor: np.ndarray
    """Origin of PyBullet's frame in the link frame, in [m], shape (3,)."""

    inertial: Inertial
    forms: Sequence[Form] = field(repr=False)


def create_body(
    client: BulletClient,
    model: Model,
    drives: Drives,
    meshes: Mapping[str, Mesh],
    tree: int = 0,
) -> tuple[int, list[str]]:
    """Create the body of a tree of a model, at its state.

    Args:
        client: PyBullet.
        model: The model.
        drives: The drives of its joints.
        meshes: The meshes of its collision shapes, by their names in the file; shapes
            of other meshes are ignored.
        tree: Index of the tree.

    Returns:
        PyBullet's number of the body, and the names of its links from ``ROOT`` on. A
        link with more than ``MAX_TOGETHER`` shapes is there several times.

    Raises:
        TooManyLinksError: If PyBullet does not support that many links.
        DescriptionError: If PyBullet refuses the model.
    """
    description, fixed = model.assembly.description.trees[tree], model.trees[tree].fixed
    usual = tempfile.gettempdir()
    parent = usual if usual.isascii() else "/tmp"  # else PyBullet crashes
    with tempfile.TemporaryDirectory(dir=parent) as folder:
        forms = _Forms(meshes, Path(folder), model.assembly.static)
        rows = _rows(description, forms, drives.armature_by_name)
        if len(rows) > MAX_JOINTS + 1:
            raise TooManyLinksError(
                f"Robot '{description.name}' must have at most {MAX_JOINTS + 1} links "
                f"in hold and limp (got {len(rows)}, with one for each {MAX_TOGETHER} "
                "collision shapes of a link)."
            )
        try:
            number = _create(client, rows, model.root_poses[tree], fixed)
        except client.error as error:
            raise DescriptionError(
                f"PyBullet cannot load the robot: {error}."
            ) from error
    made = client.getNumJoints(number) + 1
    if made != len(rows):
        raise DescriptionError(
            f"Robot '{description.name}' has {len(rows)} links, but PyBullet made "
            f"{made} of them."
        )
    _set_dynamics(client, number, rows)
    model.hull_deviations.update(forms.deviations)
    return number, [row.name for row in rows]


def _rows(
    description: Description, forms: _Forms, armature: Mapping[str, float]
) -> list[_Row]:
    """List the links of a tree as PyBullet numbers them: depth first.

    A link with too many shapes is followed by massless links fixed to it.

    Args:
        description: The tree.
        forms: Makes the shapes.
        armature: Inertia of rotors in [kg m^2], by joint.
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
        is_world = joint is None and name == WORLD
        inertial = NO_MASS if is_world else inertial_of(links[name])
        rotor = 0.0 if joint is None else armature.get(joint.name, 0.0)
        if joint is not None and joint.kind != "prismatic" and rotor:
            # PyBullet has no rotors. These also resist turns of the link above, which
            # those of real gears do not.
            unit = joint.axis / np.linalg.norm(joint.axis)
            inertia = inertial.inertia + rotor * np.outer(unit, unit)
            inertial = replace(inertial, inertia=inertia)
        own = forms.of(links[name].collisions, anchor)
        begins = range(0, max(len(own), 1), MAX_TOGETHER)
        first, *others = (own[begin : begin + MAX_TOGETHER] for begin in begins)
        rows.append(_Row(name, parent, joint, position, anchor, inertial, first))
        rows += [
            _Row(name, place, None, np.zeros(3), anchor, NO_MASS, group)
            for group in others
        ]
    return rows


def _create(
    client: BulletClient, rows: Sequence[_Row], pose: np.ndarray, fixed: bool
) -> int:
    """Make a body with its root link at a pose; return PyBullet's number for it."""
    centers = [_center(row) for row in rows]
    shapes = [_create_shapes(client, row.forms) for row in rows]
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


def _set_dynamics(client: BulletClient, number: int, rows: Sequence[_Row]) -> None:
    """Set moments of inertia and limits, which ``createMultiBody`` does not accept."""
    for index, row in enumerate(rows, ROOT):
        moments, _ = principal_axes(row.inertial.inertia)
        client.changeDynamics(number, index, localInertiaDiagonal=moments)
        joint = row.joint
        if joint and joint.kind in ("revolute", "prismatic"):
            # PyBullet ignores a single limit.
            client.changeDynamics(
                number,
                index,
                jointLowerLimit=max(joint.lower, -MAX_VALUE),
                jointUpperLimit=min(joint.upper, MAX_VALUE),
            )


class _Forms:
    """Converts collision shapes for PyBullet, and writes their meshes to files.

    PyBullet accepts the points of a hull directly only for a link without other shapes.
    """

    def __init__(
        self, meshes: Mapping[str, Mesh], folder: Path, is_static: bool
    ) -> None:
        self._meshes = meshes
        self._folder = folder
        self._is_static = is_static  # then meshes may be concave
        self._files: dict[tuple[str, float], str] = {}
        self.deviations: dict[str, float] = {}
        """Largest deviation of a simplified hull in [m], by mesh."""
        self._n_files = 0

    def of(self, shapes: Sequence[Shape], anchor: np.ndarray) -> list[Form]:
        """Return the forms of a link's shapes, without meshes that were not found.

        Args:
            shapes: Collision shapes of the link.
            anchor: Origin of PyBullet's frame in the link frame, in [m], shape (3,).
        """
        return [
            self._form(shape, anchor, self._file_of(shape))
            for shape in shapes
            if is_there(shape, self._meshes)
        ]

    def _form(self, shape: Shape, anchor: np.ndarray, file: str) -> Form:
        """Convert a shape with its mesh file."""
        form: Form = {
            "shapeTypes": KINDS[shape.kind],
            "halfExtents": [1.0, 1.0, 1.0],
            "radii": 1.0,
            "lengths": 1.0,
            "fileNames": file,
            "meshScales": [1.0, 1.0, 1.0],
            "planeNormals": [0.0, 0.0, 1.0],
            "flags": 0,
            "collisionFramePositions": (shape.pose[:3] - anchor).tolist(),
            "collisionFrameOrientations": shape.pose[3:].tolist(),
        }
        if shape.kind == "box":
            form["halfExtents"] = [size / 2.0 for size in shape.size]
        elif shape.kind in ("sphere", "capsule"):
            form["radii"] = max(shape.size[0], MIN_RADIUS)
            form["lengths"] = shape.size[-1]
        elif shape.kind == "plane":
            form["planeNormals"] = list(shape.size)
        elif shape.kind == "mesh":
            form["meshScales"] = list(shape.size)
            if self._is_static:
                form["flags"] = pybullet.GEOM_FORCE_CONCAVE_TRIMESH
        return form

    def _file_of(self, shape: Shape) -> str:
        """Return the file of a shape; an empty name if it needs none."""
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
        """Write a mesh of a largest scale to a file; return its name."""
        mesh = self._meshes[name]
        if not self._is_static:
            hulls, deviation = thinned_hulls(mesh, scale)
            if deviation:
                known = self.deviations.get(name, 0.0)
                self.deviations[name] = max(known, deviation)
            return self._write(hulls)
        if mesh.parts:
            corners = [part.corners.reshape(-1, 3) for part in mesh.parts]
            return self._write([np.concatenate(corners)])
        path = self._new_path(".stl")
        path.symlink_to(mesh.path.resolve())
        return str(path)

    def _write(self, hulls: Sequence[np.ndarray]) -> str:
        """Write the points of hulls, each with shape (n, 3); return the file's name."""
        triangles = []
        for points in hulls:  # padded with the last one
            padding = np.repeat(points[-1:], -len(points) % 3, axis=0)
            triangles.append(np.concatenate([points, padding]).reshape(-1, 3, 3))
        if len(hulls) == 1:
            path = self._new_path(".stl")
            path.write_bytes(write_stl(triangles[0]))
        else:
            path = self._new_path(".obj")
            path.write_text(_obj_text(triangles))
        return str(path)

    def _new_path(self, suffix: str) -> Path:
        """Return a new file name, in ASCII."""
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


def _create_shapes(client: BulletClient, forms: Sequence[Form]) -> int:
    """Create the collision shapes of a link.

    Args:
        client: PyBullet.
        forms: At most ``MAX_TOGETHER``.

    Returns:
        PyBullet's number of the compound; -1 if there are none.
    """
    if not forms:
        return -1
    columns = {name: [form[name] for form in forms] for name in forms[0]}
    return int(client.createCollisionShapeArray(**columns))
