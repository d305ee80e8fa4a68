"""The measurement: link poses and twists in, joint positions and velocities out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from g1_description.core.rotation import cross, multiply, relative, rotate, swing_twist

from .joints import OVERSHOOT, TOLERANCE, MeasuredJoints

TURN = 2.0 * np.pi

MAX_STEP = 0.25 * TURN
"""Largest distance in [rad] from where its speed would have taken a joint. A joint
that is further away was set there by a command, and its turns are counted again."""

ROUNDING = 1e-14
"""Largest value in [rad] or [rad/s] that counts as zero. Joints of the G1 that stand at
zero are measured within 1e-15, whatever the base and the other joints do. The position
of a sliding joint is as exact as the links' positions, so there it is this share of
their distance from the origin, in [m]."""


class Previous(NamedTuple):
    """The previous measurement, from which angles are unwrapped; NaN where none is."""

    position: np.ndarray
    """In [rad] or [m], shape (n_joints,)."""

    velocity: np.ndarray
    """In [rad/s] or [m/s], shape (n_joints,)."""

    dt: np.ndarray
    """Time since then in [s], shape (n_joints,)."""


class Measured(NamedTuple):
    """Joint states, a row per joint."""

    position: np.ndarray
    """In [rad] or [m], shape (n_joints,)."""

    velocity: np.ndarray
    """In [rad/s] or [m/s], shape (n_joints,)."""

    axis_residual: np.ndarray
    """Squared sine of half the rotation that is left over off the joint's axis, 0 where
    there is none, shape (n_joints,)."""


def measure(
    poses: np.ndarray,
    twists: np.ndarray,
    joints: MeasuredJoints,
    previous: Previous | None = None,
) -> Measured:
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
        previous: The previous measurement; by default none.

    Returns:
        Positions, velocities and how well each joint keeps to its axis.

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
    return Measured(states[0], states[1], axis_residual)


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
    previous: Previous,
    joints: MeasuredJoints,
) -> np.ndarray:
    """Unwrap ambiguous angles from the previous measurement.

    Physics may push a joint a little beyond its stop, but only at the speed it has: a
    joint that a command has set is inside its limits.
    """
    # The lesser of the two speeds: a single wrong one must not wind a joint up.
    steady = 0.5 * (np.sign(velocity) + np.sign(previous.velocity))
    steady *= np.minimum(np.abs(velocity), np.abs(previous.velocity))
    expected = previous.position + steady * previous.dt
    unwrapped = position + TURN * np.round((expected - position) / TURN)
    away = np.abs(unwrapped - expected)
    # Twice the greater speed: it may have changed since the previous measurement.
    speed = np.maximum(np.abs(velocity), np.abs(previous.velocity))
    is_pushed = away <= TOLERANCE + 2.0 * speed * previous.dt
    allowed = np.where(is_pushed, OVERSHOOT, TOLERANCE)
    inside = _turned_inside(unwrapped, allowed, joints)
    # A comparison with NaN is false: without a previous angle the first guess stays.
    return np.where(joints.needs_unwrapping & (away <= MAX_STEP), inside, position)


def _turned_inside(
    position: np.ndarray, allowed: np.ndarray, joints: MeasuredJoints
) -> np.ndarray:
    """Move angles too far beyond a stop by a turn, where that is inside the limits.

    Args:
        position: Angles in [rad], shape (n_joints,).
        allowed: How far beyond its stop each may be, in [rad], shape (n_joints,).
        joints: The limits.
    """
    over, under = position - joints.upper, joints.lower - position
    down = (over > allowed) & (under + TURN <= TOLERANCE)
    up = (under > allowed) & (over + TURN <= TOLERANCE)
    return position + TURN * (up.astype(float) - down)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Compute the dot products of rows, shape (n,)."""
    return np.einsum("ij,ij->i", a, b)
