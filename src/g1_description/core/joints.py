"""The measurement: link poses and twists in, joint positions and velocities out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .description import Description, Joint
from .rotation import conjugate, multiply, rotate, twist_angle
from .transform import IDENTITY, compose

TURN = 2.0 * np.pi


@dataclass(frozen=True)
class MeasuredJoints:
    """The joints that can be measured from the links at hand, a row per joint."""

    names: tuple[str, ...]
    """Joint names, in the order of the robot description."""

    missing: tuple[str, ...]
    """Links that are not at hand, so that a joint of theirs is left out."""

    parent: np.ndarray
    """Index of the link that holds each parent link, shape (n_joints,)."""

    child: np.ndarray
    """Index of each child link, shape (n_joints,)."""

    T_parent_zero: np.ndarray
    """Child frame in the frame of ``parent`` at position zero, shape (n_joints, 7)."""

    axis: np.ndarray
    """Unit axis of each joint in its child frame, shape (n_joints, 3)."""

    turns: np.ndarray
    """True where the joint turns, False where it slides, shape (n_joints,)."""

    reference: np.ndarray
    """Middle of each joint's limits, NaN for continuous ones, shape (n_joints,)."""


def measured_joints(
    description: Description, link_names: Sequence[str]
) -> MeasuredJoints:
    """Find each movable joint's links among those a simulator publishes.

    Where fixed joints were lumped away, the parent of a joint is the nearest
    ancestor that is there, and the constant transform to it comes from the
    description.

    Args:
        description: The robot as its file tells it, fixed joints and all.
        link_names: Links at hand, in the order of the poses to come.

    Returns:
        The joints whose two links are at hand, and the links that are not.
    """
    index = {name: place for place, name in enumerate(link_names)}
    above = description.joint_above()
    rows, missing = [], []
    for joint in description.movable_joints:
        body, T_body_parent = joint.parent, IDENTITY
        while body not in index and body in above and above[body].kind == "fixed":
            T_body_parent = compose(above[body].pose, T_body_parent)
            body = above[body].parent
        absent = [link for link in (body, joint.child) if link not in index]
        if absent:
            missing += absent
            continue
        rows.append((joint, index[body], compose(T_body_parent, joint.pose)))
    return MeasuredJoints(
        names=tuple(joint.name for joint, _, _ in rows),
        missing=tuple(dict.fromkeys(missing)),
        parent=np.array([parent for _, parent, _ in rows], dtype=int),
        child=np.array([index[joint.child] for joint, _, _ in rows], dtype=int),
        T_parent_zero=np.array([zero for _, _, zero in rows]).reshape(-1, 7),
        axis=np.array([joint.axis for joint, _, _ in rows]).reshape(-1, 3),
        turns=np.array([joint.kind != "prismatic" for joint, _, _ in rows], dtype=bool),
        reference=np.array([_reference(joint) for joint, _, _ in rows]),
    )


def _reference(joint: Joint) -> float:
    """Find the middle of a joint's limits; there is none where there are none."""
    bounded = np.isfinite(joint.lower) and np.isfinite(joint.upper)
    return 0.5 * (joint.lower + joint.upper) if bounded else np.nan


def joint_positions(
    poses: np.ndarray, joints: MeasuredJoints, last: np.ndarray | None = None
) -> np.ndarray:
    """Measure joint positions from link poses.

    A joint turns its child link about one axis, or slides it along one. We undo
    the transform the child has at position zero, and read the turn about the
    axis, or the way along it, of what remains. Of the turns that are whole turns
    apart, the one nearest the middle of the limits is taken; for a continuous
    joint the one nearest its last position.

    Args:
        poses: Poses of the links in the world, shape (n_links, 7). The sign of a
            quaternion does not matter.
        joints: Joints to measure; ``parent`` and ``child`` index the links.
        last: Positions measured last, which continuous joints go on from; zero
            where there are none, shape (n_joints,).

    Returns:
        Joint positions in [rad] or [m], in the order of ``joints.names``, shape
        (n_joints,).

    Raises:
        ValueError: If ``poses`` is not 7 wide.
    """
    if poses.shape[-1] != 7:
        raise ValueError(f"poses must be 7 wide, got the shape {poses.shape}")
    world_parent, world_child = poses[joints.parent], poses[joints.child]
    q_world_zero = multiply(world_parent[:, 3:], joints.T_parent_zero[:, 3:])
    q_zero_child = multiply(conjugate(q_world_zero), world_child[:, 3:])
    angle = twist_angle(q_zero_child, joints.axis)
    before = np.zeros(len(angle)) if last is None else last
    reference = np.where(np.isnan(joints.reference), before, joints.reference)
    turned = angle + TURN * np.round((reference - angle) / TURN)
    if joints.turns.all():
        return turned
    p_world_zero = world_parent[:, :3] + rotate(
        world_parent[:, 3:], joints.T_parent_zero[:, :3]
    )
    axis_world = rotate(q_world_zero, joints.axis)
    slid = np.sum((world_child[:, :3] - p_world_zero) * axis_world, axis=-1)
    return np.where(joints.turns, turned, slid)


def joint_velocities(
    poses: np.ndarray, twists: np.ndarray, joints: MeasuredJoints
) -> np.ndarray:
    """Measure joint velocities from link twists.

    A turning joint's velocity is the difference of the two links' angular
    velocities along its axis; a sliding joint's is how fast the child's origin
    moves along the axis, seen from the turning parent.

    Args:
        poses: Poses of the links in the world, shape (n_links, 7).
        twists: Velocity of each link frame's origin and angular velocity, along
            the world's axes, in [m/s] and [rad/s], shape (n_links, 6).
        joints: Joints to measure.

    Returns:
        Joint velocities in [rad/s] or [m/s], in the order of ``joints.names``,
        shape (n_joints,).
    """
    parent, child = twists[joints.parent], twists[joints.child]
    axis_world = rotate(poses[joints.child, 3:], joints.axis)
    turning = np.sum((child[:, 3:] - parent[:, 3:]) * axis_world, axis=-1)
    if joints.turns.all():
        return turning
    lever = poses[joints.child, :3] - poses[joints.parent, :3]
    seen = child[:, :3] - parent[:, :3] - np.cross(parent[:, 3:], lever)
    return np.where(joints.turns, turning, np.sum(seen * axis_world, axis=-1))
