"""Joints that can be measured from the links a simulator publishes, as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from g1_description.core.robot.description import Description, Joint
from g1_description.core.robot.rigid import reference_links
from g1_description.core.rotation import rotate
from g1_description.core.transform import compose, inverse

OVERSHOOT = 0.1
"""Largest angle in [rad] by which physics pushes a joint beyond its stop."""

TOLERANCE = 1e-4
"""Largest error in [rad] of a simulator's poses and of a joint that rests at its
stop."""


@dataclass(frozen=True)
class MeasuredJoints:
    """The joints that can be measured from the available links, a row per joint."""

    names: tuple[str, ...]
    """Joint names, in the order of the robot description."""

    missing: tuple[str, ...]
    """Links that are neither available nor fixed to an available one. Their joints
    are left out."""

    parent: np.ndarray
    """Index of the reference link of each joint's parent, shape (n_joints,)."""

    child: np.ndarray
    """Index of the reference link of each joint's child, shape (n_joints,)."""

    T_parent_zero: np.ndarray
    """Frame of ``child`` in the frame of ``parent`` at position zero, shape
    (n_joints, 7)."""

    axis: np.ndarray
    """Unit axis of each joint in the frame of ``child``, shape (n_joints, 3)."""

    turns: np.ndarray
    """True where the joint turns, False where it slides, shape (n_joints,)."""

    lower: np.ndarray
    upper: np.ndarray
    """Limits in [rad] or [m], infinite for continuous joints, shape (n_joints,)."""

    middle: np.ndarray
    """Middle in [rad] of the turn that a first measurement is put in: the one inside
    the limits that is nearest zero, shape (n_joints,)."""

    needs_unwrapping: np.ndarray
    """True where several turns lie within the limits, so that an angle is ambiguous
    without the previous one, shape (n_joints,)."""

    @cached_property
    def twist_axis(self) -> np.ndarray:
        """Axis of each joint's rotation, zero where it slides, shape (n_joints, 3)."""
        return self.axis * self.turns[:, np.newaxis]

    @cached_property
    def all_turn(self) -> bool:
        """Whether no joint slides."""
        return bool(self.turns.all())

    @cached_property
    def any_needs_unwrapping(self) -> bool:
        """Whether the angle of any joint is ambiguous."""
        return bool(self.needs_unwrapping.any())

    @classmethod
    def joined(
        cls, parts: Sequence[MeasuredJoints], first_links: Sequence[int]
    ) -> MeasuredJoints:
        """Concatenate the joints of several robots.

        Args:
            parts: Joints of each robot.
            first_links: Index of each robot's first link among the links of all.
        """
        values: dict[str, Any] = {}
        for field in fields(cls):
            columns = [getattr(part, field.name) for part in parts]
            if field.name in ("names", "missing"):
                values[field.name] = tuple(entry for rows in columns for entry in rows)
                continue
            if field.name in ("parent", "child"):
                columns = [rows + first for rows, first in zip(columns, first_links)]
            values[field.name] = np.concatenate(columns)
        return cls(**values)


def measured_joints(
    description: Description, link_names: Sequence[str]
) -> MeasuredJoints:
    """Find the links from which each movable joint can be measured.

    A link that is not available is replaced by one that fixed joints connect it to,
    its reference link; the constant transform between the two comes from the
    description.

    Args:
        description: The robot as in its file, with its fixed joints.
        link_names: Available links, in the order of the poses to come. Of equal names
            the first counts.

    Returns:
        The joints whose two links have reference links, and the links without one.
    """
    index = {name: row for row, name in reversed([*enumerate(link_names)])}
    reference = reference_links(description, index)
    rows, missing = [], []
    for joint in description.movable_joints:
        absent = [link for link in (joint.parent, joint.child) if link not in reference]
        if absent:
            missing += absent
            continue
        parent, T_reference_parent = reference[joint.parent]
        child, T_reference_child = reference[joint.child]
        T_parent_reference = compose(joint.pose, inverse(T_reference_child))
        zero = compose(T_reference_parent, T_parent_reference)
        axis = rotate(T_reference_child[3:], joint.axis)
        rows.append((joint, index[parent], index[child], zero, axis))
    joints = [joint for joint, *_ in rows]
    lower = np.array([joint.lower for joint in joints])
    upper = np.array([joint.upper for joint in joints])
    turns = np.array([joint.kind != "prismatic" for joint in joints], dtype=bool)
    return MeasuredJoints(
        names=tuple(joint.name for joint in joints),
        missing=tuple(dict.fromkeys(missing)),
        parent=np.array([parent for _, parent, *_ in rows], dtype=int),
        child=np.array([child for _, _, child, *_ in rows], dtype=int),
        T_parent_zero=np.array([zero for *_, zero, _ in rows]).reshape(-1, 7),
        axis=np.array([axis for *_, axis in rows]).reshape(-1, 3),
        turns=turns,
        lower=lower,
        upper=upper,
        middle=np.array([_middle(joint) for joint in joints]),
        needs_unwrapping=turns & (upper - lower > 2.0 * (np.pi - OVERSHOOT)),
    )


def _middle(joint: Joint) -> float:
    """Compute the middle of the turn inside a joint's limits that is nearest zero.

    It is the middle of the limits where they are less than a whole turn apart.
    """
    if joint.upper - joint.lower < 2.0 * np.pi:
        return 0.5 * (joint.lower + joint.upper)
    # Without the tolerance a joint that rests at its stop would read a turn further.
    first = joint.lower + np.pi - TOLERANCE
    last = joint.upper - np.pi + TOLERANCE
    return float(np.clip(0.0, first, last))
