"""Measurement of joint positions and velocities from link poses and twists."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from g1_description.robot.assembly import reference_links
from g1_description.robot.description import Description, Joint, limits_of
from g1_description.robot.rotation import cross, multiply, relative, rotate, swing_twist
from g1_description.robot.transform import compose, inverse

OVERSHOOT = 0.1
"""Largest angle in [rad] by which physics pushes a joint beyond its limit."""

TOLERANCE = 1e-4
"""Largest error in [rad] of a simulator's poses, and of a joint at rest at its
limit."""


@dataclass(frozen=True)
class MeasuredJoints:
    """The joints that can be measured from the available links, a row per joint."""

    names: tuple[str, ...]
    """Joint names, in the order of the robot description."""

    missing: tuple[str, ...]
    """Links that are neither available nor fixed to an available one. Their joints are
    excluded."""

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
    """Middle in [rad] of the turn of a first measurement, the one inside the limits
    nearest to zero, shape (n_joints,)."""

    needs_unwrapping: np.ndarray
    """Whether several turns lie within the limits, so that an angle is ambiguous
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
        link_names: Available links, in the order of the poses. Of equal names, the
            first is used.

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
    lower, upper = limits_of(joints)
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

    If the limits are less than a full turn apart, it is their middle.
    """
    if joint.upper - joint.lower < 2.0 * np.pi:
        return 0.5 * (joint.lower + joint.upper)
    # Without the tolerance a joint at rest at its limit would be off by a turn.
    first = joint.lower + np.pi - TOLERANCE
    last = joint.upper - np.pi + TOLERANCE
    return float(np.clip(0.0, first, last))


TURN = 2.0 * np.pi

MAX_STEP = 0.25 * TURN
"""Largest distance in [rad] from the extrapolated position. A joint farther away was
set by a command, and its turns are counted again."""

ROUNDING = 1e-14
"""Largest value in [rad] or [rad/s] that counts as zero. Joints of the G1 that stand at
zero are measured within 1e-15, whatever the base and the other joints do. The position
of a sliding joint is as exact as the links' positions, so there it is this fraction of
their distance from the origin, in [m]."""


def measure(
    poses: np.ndarray,
    twists: np.ndarray,
    joints: MeasuredJoints,
    previous: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Measure joints from link poses and twists.

    A joint turns its child link about one axis, or slides it along one. Undo the
    transform of the child at position zero; the position is the twist about the axis,
    or the distance along it, of what remains. Angles are unwrapped with the limits
    where only one turn lies within them, otherwise from the previous measurement.

    Args:
        poses: Poses of the links in the world, unit quaternions, shape (n_links, 7).
            The sign of a quaternion does not matter.
        twists: Velocity of each link frame's origin and angular velocity, along
            the world's axes, in [m/s] and [rad/s], shape (n_links, 6).
        joints: Joints to measure; ``parent`` and ``child`` index the links.
        previous: The previous measurement, from which angles are unwrapped: positions,
            velocities and the time since then in [s], NaN where there is none, shape
            (3, n_joints).

    Returns:
        Positions in [rad] or [m] and velocities in [rad/s] or [m/s]; and the squared
        sine of half the remaining rotation off each joint's axis. Shape (n_joints,)
        each.

    Raises:
        ValueError: If ``poses`` is not 7 wide.
    """
    if poses.shape[-1] != 7:
        raise ValueError(f"poses must be 7 wide, got the shape {poses.shape}")
    q_world_parent, q_world_child = poses[joints.parent, 3:], poses[joints.child, 3:]
    q_world_zero = multiply(q_world_parent, joints.T_parent_zero[:, 3:])
    q_zero_child = relative(q_world_zero, q_world_child)
    position, axis_residual = swing_twist(q_zero_child, joints.twist_axis)
    position += TURN * np.round((joints.middle - position) / TURN)
    axis_world = rotate(q_world_child, joints.axis)
    spin = twists[joints.child, 3:] - twists[joints.parent, 3:]
    velocity = np.einsum("ij,ij->i", spin, axis_world)
    if not joints.all_turn:
        slid, speed = _slide(poses, twists, joints, q_world_zero)
        position = np.where(joints.turns, position, slid)
        velocity = np.where(joints.turns, velocity, speed)
    if previous is not None and joints.any_needs_unwrapping:
        with np.errstate(invalid="ignore"):  # NaN stands for no measurement
            position = _unwrap(position, velocity, previous, joints)
    states = np.array([position, velocity])
    states[np.abs(states) <= ROUNDING] = 0.0  # -0.0 as well
    return states[0], states[1], axis_residual


def _slide(
    poses: np.ndarray,
    twists: np.ndarray,
    joints: MeasuredJoints,
    q_world_zero: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Measure how far and how fast child links move along their axes.

    The velocity is that of the child's origin as seen from the turning parent.

    Returns:
        Positions in [m] and velocities in [m/s], shape (n_joints,), of all joints;
        those of joints that turn have no meaning.
    """
    parent, child = poses[joints.parent], poses[joints.child]
    lever = child[:, :3] - parent[:, :3]
    offset = rotate(parent[:, 3:], joints.T_parent_zero[:, :3])
    position = _dot(lever - offset, rotate(q_world_zero, joints.axis))
    far = np.abs(child[:, :3]).max(axis=1, initial=0.0)
    position[np.abs(position) <= ROUNDING * (1.0 + far)] = 0.0
    apart = twists[joints.child, :3] - twists[joints.parent, :3]
    apart -= cross(twists[joints.parent, 3:], lever)
    return position, _dot(apart, rotate(child[:, 3:], joints.axis))


def _unwrap(
    position: np.ndarray,
    velocity: np.ndarray,
    previous: np.ndarray,
    joints: MeasuredJoints,
) -> np.ndarray:
    """Unwrap ambiguous angles from the previous measurement.

    Physics may push a joint a little beyond its limit, at its current speed. A joint
    that was set by a command is inside its limits.
    """
    last_position, last_velocity, dt = previous
    # The smaller of the two speeds: a single wrong one must not add turns.
    steady = 0.5 * (np.sign(velocity) + np.sign(last_velocity))
    steady *= np.minimum(np.abs(velocity), np.abs(last_velocity))
    expected = last_position + steady * dt
    unwrapped = position + TURN * np.round((expected - position) / TURN)
    away = np.abs(unwrapped - expected)
    # Twice the greater speed: it may have changed since the previous measurement.
    speed = np.maximum(np.abs(velocity), np.abs(last_velocity))
    is_pushed = away <= TOLERANCE + 2.0 * speed * dt
    allowed = np.where(is_pushed, OVERSHOOT, TOLERANCE)
    inside = _turned_inside(unwrapped, allowed, joints)
    # A comparison with NaN is false: without a previous angle the first guess stays.
    return np.where(joints.needs_unwrapping & (away <= MAX_STEP), inside, position)


def _turned_inside(
    position: np.ndarray, allowed: np.ndarray, joints: MeasuredJoints
) -> np.ndarray:
    """Shift angles too far beyond a limit by a turn, if that is inside the limits.

    Args:
        position: Angles in [rad], shape (n_joints,).
        allowed: Allowed excess over the limits, in [rad], shape (n_joints,).
        joints: The limits.
    """
    over, under = position - joints.upper, joints.lower - position
    down = (over > allowed) & (under + TURN <= TOLERANCE)
    up = (under > allowed) & (over + TURN <= TOLERANCE)
    return position + TURN * (up.astype(float) - down)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Compute the dot products of rows, shape (n,)."""
    return np.einsum("ij,ij->i", a, b)
