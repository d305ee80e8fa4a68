"""Fixed joints lumped away, as Gazebo does it when it loads a URDF.

The child link of a fixed joint becomes part of the parent link: masses add up by the
parallel-axis theorem, shapes and child joints move to the parent. Gravity flags apply
to the whole body; the last one in Gazebo's order wins. ``assembly.rigid_frames``
computes the poses of lumped links.

Fixed joints that the file preserves are kept. A root link called "world" is the world
itself; all joints to it are kept. In a dynamic simulation, a link without mass on a
kept joint is removed with all links below. Floating and planar joints are ignored:
their child links are free. All joints of a static model are fixed.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from g1_description.robot.assembly import WORLD, Assembly, rigid_frames
from g1_description.robot.description import (
    FREE,
    Description,
    Inertial,
    Joint,
    Link,
    Shape,
)
from g1_description.robot.rotation import to_axes
from g1_description.robot.transform import IDENTITY, compose
from g1_description.robot.tree import below, depth_first
from g1_description.text import listed

TOLERANCE = 1e-9
"""Relative rounding error of the moments: for plates, the triangle inequality is an
equality, and the least moment of a singular tensor is not exactly zero."""


def is_positive(inertia: np.ndarray) -> bool:
    """Return whether a tensor, shape (3, 3), is positive definite."""
    least, _, most = np.linalg.eigvalsh(inertia)
    return bool(least > max(TOLERANCE * most, 0.0))


def impossible_inertias(links: Iterable[Link]) -> tuple[str, ...]:
    """Return messages on links with impossible inertias.

    Gazebo's ODE replaces tensors that are not positive definite by 1 kg m^2 about each
    axis, and uses others unchanged.
    """
    found: dict[bool, list[str]] = {False: [], True: []}
    for link in links:
        if link.inertial and fault_of(link.inertial):
            found[is_positive(link.inertial.inertia)].append(link.name)
    why = {
        False: "is not positive definite; 1 kg m^2 about each axis is used, as in "
        "Gazebo",
        True: "violates the triangle inequality; it is used unchanged",
    }
    return tuple(
        f"inertia of {listed(names)} {why[positive]}"
        for positive, names in found.items()
        if names
    )


def fault_of(inertial: Inertial) -> str:
    """Return a message on an invalid inertial; empty if it is valid."""
    if inertial.mass == 0.0:
        return "mass 0 with an inertia" if inertial.inertia.any() else ""
    moments = np.linalg.eigvalsh(inertial.inertia)
    listed = ", ".join(f"{moment:.6g}" for moment in moments)
    if not is_positive(inertial.inertia):
        return (
            "inertia is not physical: principal moments must be positive (got "
            f"{listed})"
        )
    if moments[2] > (moments[0] + moments[1]) * (1.0 + TOLERANCE):
        return (
            "inertia is not physical: principal moments must satisfy the triangle "
            f"inequality (got {listed})"
        )
    return ""


def combine_inertials(
    parts: Iterable[tuple[Inertial, np.ndarray]],
) -> Inertial | None:
    """Combine inertials of rigidly connected links (parallel-axis theorem).

    Args:
        parts: Inertials with the pose, shape (7,), of their link in the body.

    Returns:
        The inertial of the body, or None without mass.
    """
    placed = []
    for part, pose in parts:
        if part.mass > 0.0:
            axes = to_axes(pose[3:])
            center = pose[:3] + axes @ part.center_of_mass
            placed.append((part.mass, center, axes @ part.inertia @ axes.T))
    if not placed:
        return None
    mass = sum(part[0] for part in placed)
    center = np.sum([part[0] * part[1] for part in placed], axis=0) / mass
    inertia = np.zeros((3, 3))
    for part_mass, part_center, part_inertia in placed:
        offset = part_center - center
        steiner = offset @ offset * np.eye(3) - np.outer(offset, offset)
        inertia += part_inertia + part_mass * steiner
    return Inertial(mass, center, inertia)


def lump_fixed_joints(description: Description, is_dynamic: bool = True) -> Assembly:
    """Merge each link on a fixed joint into the link above it.

    Args:
        description: Any robot.
        is_dynamic: Whether physics moves the links; else links without mass are kept.

    Returns:
        The robot as Gazebo would simulate it.
    """
    frames = rigid_frames(description, as_lumped=True)
    bodies = {
        name: _merge(name, parts) for name, parts in _parts(description, frames).items()
    }
    joints = tuple(
        _rehang(joint, frames)
        for joint in description.joints
        if frames[joint.child][0] == joint.child
    )
    if description.static:  # joints that Gazebo ignores are not listed
        joints = tuple(
            replace(joint, kind="fixed", listed=joint.kind not in FREE)
            for joint in joints
        )
    massless = _massless(description.root, bodies, joints)
    if is_dynamic:
        bodies = {name: body for name, body in bodies.items() if name not in massless}
    robot = _robot(description, bodies, joints)
    poses = {description.root: IDENTITY}
    for joint in below([description.root], joints):
        poses[joint.child] = compose(poses[joint.parent], joint.pose)
    return Assembly(
        description=robot,
        root_poses=np.array([poses[name] for name in robot.roots]),
        static=description.static,
        lumped={link: body for link, (body, _) in frames.items() if link != body},
        left_out=(
            *description.unread,
            *description.left_out,
            *_mass_clauses(description, frames, massless, is_dynamic),
            *(
                f"joint {joint.name} is {joint.kind}, {joint.child} is free"
                for joint in joints
                if joint.child in bodies and joint.kind in FREE
            ),
            *(joint.remark for joint in robot.joints if joint.remark),
        ),
    )


def _robot(
    description: Description, bodies: dict[str, Link], joints: tuple[Joint, ...]
) -> Description:
    """Make a robot from the remaining bodies.

    Joints that Gazebo ignores leave their child links free. Without joints to the
    world, the first free link is the root.

    Args:
        description: The robot as its file has it.
        bodies: Remaining bodies by name.
        joints: Joints between all bodies, including removed ones.
    """
    names = [name for name in description.link_names if name in bodies]
    held = tuple(j for j in joints if j.child in bodies and j.kind not in FREE)
    free = {j.child for j in joints if j.child in bodies and j.kind in FREE}
    root = description.root
    if root == WORLD and free and not any(joint.parent == WORLD for joint in held):
        names.remove(WORLD)
        root = next(name for name in names if name in free)
    return Description(
        name=description.name,
        root=root,
        links=tuple(bodies[name] for name in names),
        joints=held,
        urdf=description.urdf,
        given_profile=description.profile,  # it may have lost joints by which it fits
    )


def _mass_clauses(
    description: Description,
    frames: dict[str, tuple[str, np.ndarray]],
    massless: dict[str, str],
    is_dynamic: bool,
) -> list[str]:
    """Return messages on links without mass, or below one without mass.

    Args:
        description: The robot.
        frames: Body of each link, and pose in it, as by ``rigid_frames``.
        massless: Bodies without mass and those below, as by ``_massless``.
        is_dynamic: Whether they are removed; else they are kept, unlike in Gazebo.
    """
    why = {
        name: massless[frames[name][0]]
        for name in description.link_names
        if frames[name][0] in massless
    }
    if is_dynamic:
        return [
            f"link {name} has no mass"
            if frames[name][0] == body
            else f"link {name} is below {body}, which has no mass"
            for name, body in why.items()
        ]
    bare = [name for name, body in why.items() if frames[name][0] == body]
    hanging = [name for name, body in why.items() if frames[name][0] != body]
    if not why:
        return []
    one, alone = len(bare) == 1, len(bare) + len(hanging) == 1
    words = f"{listed(bare)} {'has' if one else 'have'} no mass"
    if hanging:
        verb = "is" if len(hanging) == 1 else "are"
        words += f" and {listed(hanging)} {verb} below {'it' if one else 'them'}"
    return [f"{words}: Gazebo would ignore {'it' if alone else 'them'}"]


def _parts(
    description: Description, frames: dict[str, tuple[str, np.ndarray]]
) -> dict[str, list[tuple[Link, np.ndarray]]]:
    """Group the links by body, in Gazebo's order."""
    links = {link.name: link for link in description.links}
    parts: dict[str, list[tuple[Link, np.ndarray]]] = {}
    for name in depth_first(description.root, description.joints):
        body, pose = frames[name]
        parts.setdefault(body, []).append((links[name], pose))
    return parts


def _merge(name: str, parts: list[tuple[Link, np.ndarray]]) -> Link:
    """Merge rigidly connected links."""
    shapes = [(link.name, s, pose) for link, pose in parts for s in link.collisions]
    collisions = []
    for number, (link_name, shape, pose) in enumerate(shapes):
        count = f"_{number}" if number else ""
        own = f"{shape.name or link_name}_collision{count}"
        # As Gazebo names them: even the body's own collisions get the prefix.
        if not own.startswith(name):
            own = f"{name}_fixed_joint_lump__{own}"
        collisions.append(replace(_moved(shape, pose), name=own))
    said = [link.gravity for link, _ in parts if link.gravity is not None]
    return Link(
        name=name,
        inertial=combine_inertials(
            (link.inertial, pose) for link, pose in parts if link.inertial is not None
        ),
        visuals=tuple(_moved(s, pose) for link, pose in parts for s in link.visuals),
        collisions=tuple(collisions),
        gravity=said[-1] if said else None,
    )


def _moved(shape: Shape, pose: np.ndarray) -> Shape:
    """Transform a shape to the frame of the body."""
    return replace(shape, pose=compose(pose, shape.pose))


def _rehang(joint: Joint, frames: dict[str, tuple[str, np.ndarray]]) -> Joint:
    """Attach a joint to the body of its parent link.

    A fixed joint that is kept as revolute has SDF's default axis.
    """
    body, pose = frames[joint.parent]
    joint = replace(joint, parent=body, pose=compose(pose, joint.pose))
    if joint.kept_as != "revolute":
        return joint
    axis = np.array([0.0, 0.0, 1.0])
    return replace(joint, kind="revolute", axis=axis, lower=0.0, upper=0.0)


def _massless(
    root: str, bodies: dict[str, Link], joints: tuple[Joint, ...]
) -> dict[str, str]:
    """Find the bodies without mass, and all below them."""
    found: dict[str, str] = {}
    if root != WORLD and bodies[root].inertial is None:
        found[root] = root
    for joint in below([root], joints):
        if bodies[joint.child].inertial is None:
            found[joint.child] = joint.child
        elif joint.parent in found:
            found[joint.child] = found[joint.parent]
    return found
