"""Which joints can be measured from the links at hand, as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from g1_description.core.robot.description import Description, Joint
from g1_description.core.robot.rigid import seen_through
from g1_description.core.rotation import rotate
from g1_description.core.transform import compose, inverse

OVERSHOOT = 0.1
"""How far physics may push a joint beyond its stop, in [rad]."""

BLUR = 1e-4
"""How exactly a simulator keeps to stops and tells poses, in [rad]."""


@dataclass(frozen=True)
class MeasuredJoints:
    """The joints that can be measured from the links at hand, a row per joint."""

    names: tuple[str, ...]
    """Joint names, in the order of the robot description."""

    missing: tuple[str, ...]
    """Links that neither are at hand nor are fixed to one that is, so that a joint of
    theirs is left out."""

    parent: np.ndarray
    """Index of the link that each joint's parent is seen through, shape (n_joints,)."""

    child: np.ndarray
    """Index of the link that each joint's child is seen through, shape (n_joints,)."""

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
    """The middle of the turn that is the first guess, the one inside the limits and
    nearest zero, shape (n_joints,)."""

    goes_on: np.ndarray
    """True where the limits do not tell one turn from the next, so that a position
    goes on from the last one, shape (n_joints,)."""

    @cached_property
    def all_turn(self) -> bool:
        """Whether none slides."""
        return bool(self.turns.all())

    @cached_property
    def some_go_on(self) -> bool:
        """Whether any goes on from its last position."""
        return bool(self.goes_on.any())

    @classmethod
    def joined(
        cls, parts: Sequence[MeasuredJoints], first_links: Sequence[int]
    ) -> MeasuredJoints:
        """Put the joints of several robots into one.

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
    """Find each movable joint's links among those a simulator publishes.

    A link that is not at hand is seen through any other that fixed joints hold to
    it; the constant transform between the two comes from the description.

    Args:
        description: The robot as its file tells it, fixed joints and all.
        link_names: Links at hand, in the order of the poses to come. Of equal names
            the first counts.

    Returns:
        The joints whose two links are known, and the links that are not.
    """
    index = {name: row for row, name in reversed([*enumerate(link_names)])}
    seen = seen_through(description, index)
    rows, missing = [], []
    for joint in description.movable_joints:
        absent = [link for link in (joint.parent, joint.child) if link not in seen]
        if absent:
            missing += absent
            continue
        parent, T_through_parent = seen[joint.parent]
        child, T_through_child = seen[joint.child]
        T_parent_through = compose(joint.pose, inverse(T_through_child))
        zero = compose(T_through_parent, T_parent_through)
        axis = rotate(T_through_child[3:], joint.axis)
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
        goes_on=turns & (upper - lower > 2.0 * (np.pi - OVERSHOOT)),
    )


def _middle(joint: Joint) -> float:
    """Find the middle of a turn inside a joint's limits, as near zero as can be.

    The middle of the limits where they are no whole turn apart.
    """
    if joint.upper - joint.lower < 2.0 * np.pi:
        return 0.5 * (joint.lower + joint.upper)
    # A joint at its stop is not a turn further.
    first, last = joint.lower + np.pi - BLUR, joint.upper - np.pi + BLUR
    return float(np.clip(0.0, first, last))
