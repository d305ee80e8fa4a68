"""A model of an SDF document, as it is simulated.

Nested models become part of it, with names like ``inner::link``. A joint to the world
makes the world the root. Joints that close a loop are ignored, and those of unsupported
types are fixed. SDF places a joint in its child link; the pose of the child in the
parent follows from the poses of both links.
"""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass, replace

import numpy as np
from lxml import etree

from g1_description.bounds import MAX_VALUE, position_limits
from g1_description.errors import DescriptionError
from g1_description.robot.assembly import SCOPE, WORLD, Assembly
from g1_description.robot.description import MOVABLE, Description, Joint, Link
from g1_description.robot.rotation import rotate
from g1_description.robot.transform import inverse
from g1_description.robot.tree import find_roots
from g1_description.robot.xml_values import (
    flag,
    name_of,
    number,
    numbers,
    text_of,
    unit,
    vector,
)
from g1_description.sdf.document import INCLUDED
from g1_description.sdf.frames import MODEL, Frames, Scope
from g1_description.sdf.link import drop_wrong_inertial, read_link, touching
from g1_description.sdf.unsupported import unread

KINDS = (*MOVABLE, "fixed")
"""Types of joints that can be simulated."""


def ends_of(
    element: etree._Element, scope: Scope, links: Container[str]
) -> tuple[str, str] | str:
    """Find the links of a joint.

    Gazebo accepts the world on either side, and ignores a joint whose links do not
    exist.

    Args:
        element: The joint.
        scope: The model that holds it.
        links: Full names of all links.

    Returns:
        Full names of parent and child, or ``WORLD``; or a message on why the joint is
        ignored.
    """
    ends = []
    for role in ("parent", "child"):
        written = text_of(element, role)
        if not written:
            return f"it has no {role}"
        link = WORLD if written == WORLD else scope.full(written)
        if link != WORLD and link not in links:
            return f"its {role} {link} is not a link of the model"
        ends.append(link)
    parent, child = ends
    return (parent, child) if {*ends} != {WORLD} else "both of its links are the world"


def fixed_joint(
    name: str, ends: tuple[str, str], frames: Frames, listed: bool = True
) -> Joint:
    """Make a fixed joint of two links.

    Args:
        name: Name of the joint.
        ends: Names of its parent and of its child, one of them may be ``WORLD``.
        frames: Where the links are.
        listed: Whether the joint is in the file.
    """
    pose = frames.between(*(MODEL if end == WORLD else end for end in ends))
    return Joint(name, "fixed", *ends, pose, listed=listed)


def turned_around(joint: Joint) -> Joint:
    """Swap parent and child of a joint.

    The relative pose of the links at each joint position is unchanged.
    """
    axes = joint.pose[3:]
    return replace(
        joint,
        parent=joint.child,
        child=joint.parent,
        pose=inverse(joint.pose),
        axis=-rotate(axes, joint.axis),
        joint_origin=joint.pose[:3] + rotate(axes, joint.joint_origin),
    )


def read_joint(
    element: etree._Element, joint: Joint, frame: str, scope: Scope
) -> Joint:
    """Read axis, limits and dynamics of a joint.

    Args:
        element: The joint, of one of the ``KINDS``.
        joint: The joint as a fixed joint.
        frame: Full name of its frame.
        scope: The model that holds it.

    Raises:
        DescriptionError: If a number is invalid.
    """
    kind = element.get("type", "")
    if kind == "fixed":
        return joint
    owner, axis = f"joint {joint.name}", element.find("axis")
    limit = None if axis is None else axis.find("limit")
    lower, upper, remark = -np.inf, np.inf, ""
    if kind != "continuous":
        lower, upper, remark = position_limits(
            owner,
            _limit(limit, "lower", -np.inf, owner),
            _limit(limit, "upper", np.inf, owner),
        )
    free = np.isinf([lower, upper]).all()
    dynamics = None if axis is None else axis.find("dynamics")
    return replace(
        joint,
        kind="continuous" if kind == "revolute" and free else kind,
        axis=_axis(axis, joint, frame, scope),
        joint_origin=scope.frames.between(joint.child, frame)[:3],
        lower=lower,
        upper=upper,
        effort=_most(limit, "effort", owner),
        velocity=_most(limit, "velocity", owner),
        damping=number(dynamics, "damping", 0.0, owner, 0.0),
        friction=number(dynamics, "friction", 0.0, owner, 0.0),
        remark=remark,
    )


def _axis(
    axis: etree._Element | None, joint: Joint, frame: str, scope: Scope
) -> np.ndarray:
    """Read the axis of a joint, in the child link frame, shape (3,)."""
    owner = f"joint {joint.name}"
    xyz = vector(axis, "xyz", [0.0, 0.0, 1.0], owner)
    element = None if axis is None else axis.find("xyz")
    other = "" if element is None else element.get("expressed_in", "")
    if axis is not None and flag(axis, "use_parent_model_frame", False, owner):
        other = other or MODEL
    given_in = scope.full(other) if other else frame
    T_child_given = scope.frames.between(joint.child, given_in)
    return rotate(T_child_given[3:], unit(f"axis of {owner}", xyz))


def _most(limit: etree._Element | None, tag: str, owner: str) -> float:
    """Read a limit of effort or velocity; negative means none."""
    most = _limit(limit, tag, np.inf, owner)
    return most if most >= 0.0 else np.inf


def _limit(limit: etree._Element | None, tag: str, none: float, owner: str) -> float:
    """Read a limit; very large numbers mean none."""
    text, label = text_of(limit, tag), f"{tag} limit of {owner}"
    value = numbers(label, text, 1)[0] if text else none
    if np.isnan(value):
        raise DescriptionError(f"The {label} must be a number (got '{text}').")
    return value if abs(value) <= MAX_VALUE else np.copysign(np.inf, value)


def closes_loop(joints: Sequence[tuple[str, str]]) -> list[bool]:
    """Find the joints that would close a loop.

    Args:
        joints: The two links of each joint, in any order.

    Returns:
        For each joint, whether its links are already connected by those before it.
    """
    above: dict[str, str] = {}

    def top(link: str) -> str:
        path = [link]
        while path[-1] in above:
            path.append(above[path[-1]])
        above.update((passed, path[-1]) for passed in path[:-1])
        return path[-1]

    closing = []
    for ends in joints:
        first, second = map(top, ends)
        closing.append(first == second)
        if first != second:
            above[second] = first
    return closing


def hung(links: Sequence[str], joints: Sequence[Joint]) -> tuple[Joint, ...]:
    """Orient joints away from the root.

    The root of a tree is the world, else the first link without a parent joint.

    Args:
        links: Names of all links.
        joints: Joints without loops.

    Returns:
        The joints in the same order, each with another child.
    """
    result = list(joints)
    at: dict[str, list[int]] = {}
    for row, joint in enumerate(joints):
        at.setdefault(joint.parent, []).append(row)
        at.setdefault(joint.child, []).append(row)
    carried = {joint.child for joint in joints}
    reached: set[str] = set()
    for root in (WORLD, *(link for link in links if link not in carried)):
        waiting = [] if root in reached else [root]
        reached.add(root)
        for link in waiting:
            for row in at.get(link, ()):
                joint = result[row]
                other = joint.child if joint.parent == link else joint.parent
                if other in reached:
                    continue
                if joint.child == link:
                    result[row] = turned_around(joint)
                reached.add(other)
                waiting.append(other)
    return tuple(result)


@dataclass(frozen=True)
class SdfModel:
    """A model of an SDF document."""

    name: str
    """As in the file."""

    pose: np.ndarray
    """Pose of the model frame in the world, shape (7,)."""

    assembly: Assembly
    """The model as it is simulated."""


def read_model_element(element: etree._Element, pose: np.ndarray) -> SdfModel:
    """Read a model element.

    Args:
        element: The model, with includes resolved.
        pose: Pose of the model frame in the world, shape (7,).

    Raises:
        DescriptionError: If something in it is invalid.
    """
    name = name_of(element)
    static = flag(element, "static", False, f"model {name}")
    scopes = _scopes(element, name)
    frames = scopes[0][0].frames
    elements = [
        (link, scope) for scope, model in scopes for link in model.findall("link")
    ]
    wrong = [drop_wrong_inertial(*one) for one in elements] if static else []
    read = [read_link(*one) for one in elements]
    links = tuple(link for link, _ in read)
    _check_links(name, links, static)
    joints, odd = _joints(scopes, {link.name for link in links}, static)
    joints = hung([link.name for link in links], joints)
    if static:
        joints = _held_together(links, joints, frames)
    elif any(joint.parent == WORLD for joint in joints):
        links = (Link(WORLD), *links)
    description = Description(name, find_roots(name, links, joints)[0], links, joints)
    # The frame of the model moves with the first link in the file.
    first = next(link.name for link in links if link.name != WORLD)
    roots = [MODEL if root == WORLD else root for root in description.roots]
    assembly = Assembly(
        description=description,
        root_poses=np.array([*map(frames.pose, roots)]),
        canonical=first if first != description.root else "",
        static=static,
        may_touch={n.name: touching(e) for (n, _), (e, _) in zip(read, elements)},
        nested=tuple(
            scope.prefix[: -len(SCOPE)]
            for scope, inner in scopes[1:]
            if inner.get(INCLUDED) is None
        ),
        left_out=(
            *unread(element),
            *filter(None, wrong),
            *(message for _, ignored in read for message in ignored),
            *odd,
            *_static_inside(scopes, static),
        ),
    )
    return SdfModel(name, pose, assembly)


def _scopes(model: etree._Element, name: str) -> list[tuple[Scope, etree._Element]]:
    """List a model and its nested models, and add their frames."""
    frames = Frames(f"model '{name}'", MODEL)
    scopes = [(Scope("", frames), model)]
    for scope, element in scopes:
        for link in element.findall("link"):
            scope.add(scope.full(name_of(link)), link, MODEL)
        for frame in element.findall("frame"):
            attached_to = frame.get("attached_to") or MODEL
            scope.add(scope.full(name_of(frame)), frame, attached_to)
        for inner in element.findall("model"):
            prefix = f"{scope.full(name_of(inner))}::"
            scope.add(f"{prefix}{MODEL}", inner, MODEL)
            scopes.append((Scope(prefix, frames), inner))
    return scopes


def _check_links(model: str, links: tuple[Link, ...], static: bool) -> None:
    """Check that there are links, and that they have a mass if they can move."""
    if not links:
        raise DescriptionError(f"Model '{model}' has no links.")
    for link in links:
        if link.name == WORLD:
            raise DescriptionError(
                f"Model '{model}' has a link called {WORLD}, which is reserved."
            )
        if not static and link.inertial is not None and link.inertial.mass == 0.0:
            raise DescriptionError(
                f"The mass of link {link.name} of model '{model}' must not be 0."
            )


@dataclass(frozen=True, eq=False)
class _Written:
    """A joint in the file."""

    element: etree._Element
    name: str
    ends: tuple[str, str]
    """Parent and child."""

    frame: str
    scope: Scope

    @property
    def odd(self) -> str:
        """Why it is not supported; empty if it is."""
        kind = self.element.get("type", "")
        if kind not in KINDS:
            return kind or "of no type"
        # Its axis would be fixed in the world.
        if self.ends[1] == WORLD and kind != "fixed":
            return f"{kind} with the world as its child"
        return ""


def _joints(
    scopes: list[tuple[Scope, etree._Element]], links: set[str], static: bool
) -> tuple[tuple[Joint, ...], list[str]]:
    """Read the joints of a model, without loops; all fixed if it is static."""
    written, left_out = _written_joints(scopes, links)
    # Unsupported joints come last: they fix links that nothing else connects.
    in_order = sorted(written, key=lambda joint: joint.odd != "")
    loops = dict(zip(in_order, closes_loop([joint.ends for joint in in_order])))
    joints = []
    for one in written:
        parent, child = one.ends
        odd = "" if static else one.odd
        why = f"is {odd}, which is not simulated" if odd else ""
        if loops[one]:
            why = why or f"closes a loop of joints at {child}, which is not simulated"
            why = f"it {why}" if parent != child else f"both of its links are {child}"
            left_out.append(f"joint {one.name} is ignored: {why}")
            continue
        joint = fixed_joint(one.name, one.ends, one.scope.frames, listed=not odd)
        if odd:
            held = f"{parent} is fixed to {child}" if child == WORLD else ""
            held = held or f"{child} is fixed to {parent}"
            left_out.append(f"joint {one.name} {why}: {held}")
        elif not static:
            joint = read_joint(one.element, joint, one.frame, one.scope)
            left_out += [joint.remark] if joint.remark else []
        joints.append(joint)
    return tuple(joints), left_out


def _written_joints(
    scopes: list[tuple[Scope, etree._Element]], links: set[str]
) -> tuple[list[_Written], list[str]]:
    """List the joints of a model, and add their frames."""
    written, left_out = [], []
    for scope, owner in scopes:
        for element in owner.findall("joint"):
            name = scope.full(name_of(element))
            ends = ends_of(element, scope, links)
            if isinstance(ends, str):
                left_out.append(f"joint {name} is ignored: {ends}")
                continue
            # Before version 1.7 a joint and a link may have the same name.
            frame = f"{name}::__joint__" if name in scope.frames else name
            child = text_of(element, "child")
            scope.add(frame, element, MODEL if child == WORLD else child)
            written.append(_Written(element, name, ends, frame, scope))
    return written, left_out


def _held_together(
    links: tuple[Link, ...], joints: tuple[Joint, ...], frames: Frames
) -> tuple[Joint, ...]:
    """Connect the links of a static model to one tree.

    The root is a link with a joint to the world, else the first one without a parent
    joint. All others without a parent joint are fixed to it.
    """
    carried = {joint.child for joint in joints}
    anchored = [joint.child for joint in joints if joint.parent == WORLD]
    loose = [link.name for link in links if link.name not in carried]
    root = [*anchored, *loose, links[0].name][0]
    kept = [
        fixed_joint(joint.name, (root, joint.child), frames)
        if joint.parent == WORLD
        else joint
        for joint in joints
        if (joint.parent, joint.child) != (WORLD, root)
    ]
    hung = [
        fixed_joint(f"static::{link}", (root, link), frames, listed=False)
        for link in loose
        if link != root
    ]
    return (*kept, *hung)


def _static_inside(
    scopes: list[tuple[Scope, etree._Element]], static: bool
) -> tuple[str, ...]:
    """Report static models nested in a model that moves."""
    inner = [] if static else scopes[1:]
    names = [(element, scope.prefix[: -len("::")]) for scope, element in inner]
    return tuple(
        f"static of model {name} is not simulated"
        for element, name in names
        if flag(element, "static", False, f"model {name}")
    )
