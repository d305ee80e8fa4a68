"""Joints of an SDF model, written as the description wants them.

SDF places a joint in its child link, at zero, and says nothing of where the child
is in its parent: that follows from the poses of both links.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from lxml import etree

from .assembly import WORLD
from .description import MOVABLE, Joint
from .errors import LARGEST, DescriptionError
from .rotation import rotate
from .sdf_frames import MODEL, Frames, Scope
from .sdf_text import flag, number, numbers, text_of, unit, vector
from .transform import inverse

KINDS = (*MOVABLE, "fixed")
"""Types of joints that can be simulated."""


def carried_by(element: etree._Element, name: str, scope: Scope) -> tuple[str, str]:
    """Tell which links a joint joins.

    Args:
        element: The joint.
        name: Its full name, for the sentences.
        scope: The model that holds it.

    Returns:
        Full names of the parent, which may be ``WORLD``, and of the child.

    Raises:
        DescriptionError: If one is missing.
    """
    for role in ("parent", "child"):
        if not text_of(element, role):
            raise DescriptionError(f"Joint {name} has no {role}.")
    parent, child = text_of(element, "parent"), text_of(element, "child")
    if child == WORLD:
        raise DescriptionError(f"Joint {name} has the world as its child.")
    return (WORLD if parent == WORLD else scope.full(parent)), scope.full(child)


def fixed_joint(
    name: str, ends: tuple[str, str], frames: Frames, listed: bool = True
) -> Joint:
    """Join two links as they stand.

    Args:
        name: Name of the joint.
        ends: Names of its parent, which may be ``WORLD``, and of its child.
        frames: Where the links are.
        listed: Whether the file names the joint.
    """
    parent, child = ends
    pose = frames.between(MODEL if parent == WORLD else parent, child)
    return Joint(name, "fixed", parent, child, pose, listed=listed)


def turned_around(joint: Joint) -> Joint:
    """Give the same joint with its parent as its child.

    The links stand to each other as before at each position of the joint.
    """
    axes = joint.pose[3:]
    return replace(
        joint,
        parent=joint.child,
        child=joint.parent,
        pose=inverse(joint.pose),
        axis=-rotate(axes, joint.axis),
        anchor=joint.pose[:3] + rotate(axes, joint.anchor),
    )


def read_joint(
    element: etree._Element, joint: Joint, frame: str, scope: Scope
) -> Joint:
    """Read how a joint moves.

    Args:
        element: The joint, of one of the ``KINDS``.
        joint: The same one as if it were fixed.
        frame: Full name of its frame.
        scope: The model that holds it.

    Raises:
        DescriptionError: If a number is wrong.
    """
    kind = element.get("type", "")
    if kind == "fixed":
        return joint
    owner, axis = f"joint {joint.name}", element.find("axis")
    lower, upper = _bounds(axis, owner) if kind != "continuous" else (-np.inf, np.inf)
    free = np.isinf([lower, upper]).all()
    dynamics = None if axis is None else axis.find("dynamics")
    limit = None if axis is None else axis.find("limit")
    return replace(
        joint,
        kind="continuous" if kind == "revolute" and free else kind,
        axis=_axis(axis, joint, frame, scope),
        anchor=scope.frames.between(joint.child, frame)[:3],
        lower=lower,
        upper=upper,
        effort=_most(limit, "effort", owner),
        velocity=_most(limit, "velocity", owner),
        damping=number(dynamics, "damping", 0.0, owner, 0.0),
        friction=number(dynamics, "friction", 0.0, owner, 0.0),
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


def _bounds(axis: etree._Element | None, owner: str) -> tuple[float, float]:
    """Read the limits of a position, infinite where SDF's numbers mean none."""
    limit = None if axis is None else axis.find("limit")
    lower = _limit(limit, "lower", -np.inf, owner)
    upper = _limit(limit, "upper", np.inf, owner)
    if not lower <= upper or lower == np.inf or upper == -np.inf:
        raise DescriptionError(
            f"The limits of {owner} are {lower:g} to {upper:g}: no position is left."
        )
    return lower, upper


def _most(limit: etree._Element | None, tag: str, owner: str) -> float:
    """Read a limit of effort or velocity, where a negative one is none."""
    most = _limit(limit, tag, np.inf, owner)
    return most if most >= 0.0 else np.inf


def _limit(limit: etree._Element | None, tag: str, none: float, owner: str) -> float:
    """Read a limit, which is no limit where it is too large to be one."""
    text, what = text_of(limit, tag), f"{tag} limit of {owner}"
    value = numbers(what, text, 1)[0] if text else none
    if np.isnan(value):
        raise DescriptionError(f"The {what} is '{text}', which is not a number.")
    return value if abs(value) <= LARGEST else np.copysign(np.inf, value)
