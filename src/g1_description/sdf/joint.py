"""Joints of an SDF model.

SDF places a joint in its child link. The pose of the child in the parent follows from
the poses of both links.
"""

from __future__ import annotations

from collections.abc import Container
from dataclasses import replace

import numpy as np
from lxml import etree

from g1_description.bounds import MAX_VALUE, position_limits
from g1_description.errors import DescriptionError
from g1_description.robot.assembly import WORLD
from g1_description.robot.description import MOVABLE, Joint
from g1_description.robot.rotation import rotate
from g1_description.robot.transform import inverse
from g1_description.robot.xml_values import flag, number, numbers, text_of, unit, vector
from g1_description.sdf.frames import MODEL, Frames, Scope

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
