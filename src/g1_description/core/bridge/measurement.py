"""The measurement: link poses and twists in, joint positions and velocities out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from g1_description.core.rotation import conjugate, cross, multiply, rotate

from .joints import BLUR, OVERSHOOT, MeasuredJoints

TURN = 2.0 * np.pi
JUMP = 0.25 * TURN
"""A joint that is further than this from where its speed would have taken it was put
there, in [rad]: its turns are counted anew."""


ROUNDING = 1e-14
"""What is less, in [rad] or [rad/s], is rounding: zero. Joints of the G1 that stand at
zero are measured within 1e-15 of it, whatever its base and its other joints do. A way
along an axis is as exact as where the links are: so much of their distance, in [m]."""


class Before(NamedTuple):
    """What was measured last, which turns go on from; NaN where nothing was."""

    position: np.ndarray
    """In [rad] or [m], shape (n_joints,)."""

    velocity: np.ndarray
    """In [rad/s] or [m/s], shape (n_joints,)."""

    passed: np.ndarray
    """Time since then in [s], shape (n_joints,)."""


class Measured(NamedTuple):
    """What the link states tell of joints, a row per joint."""

    position: np.ndarray
    """In [rad] or [m], shape (n_joints,)."""

    velocity: np.ndarray
    """In [rad/s] or [m/s], shape (n_joints,)."""

    alignment: np.ndarray
    """Squared cosine of half the rotation that is left over off the axis: 1 where
    there is none, shape (n_joints,)."""


def measure(
    poses: np.ndarray,
    twists: np.ndarray,
    joints: MeasuredJoints,
    before: Before | None = None,
) -> Measured:
    """Measure joints from link poses and twists.

    A joint turns its child link about one axis, or slides it along one. We undo
    the transform the child has at position zero, and read the turn about the
    axis, or the way along it, of what remains. Of the turns that are whole turns
    apart the one inside the limits is taken; where several are or there are no
    limits, the one that goes on from the last position.

    Args:
        poses: Poses of the links in the world, unit quaternions, shape (n_links, 7).
            The sign of a quaternion does not matter.
        twists: Velocity of each link frame's origin and angular velocity, along
            the world's axes, in [m/s] and [rad/s], shape (n_links, 6).
        joints: Joints to measure; ``parent`` and ``child`` index the links.
        before: What was measured last; by default nothing.

    Returns:
        Positions, velocities and how well each joint keeps to its axis.

    Raises:
        ValueError: If ``poses`` is not 7 wide.
    """
    if poses.shape[-1] != 7:
        raise ValueError(f"poses must be 7 wide, got the shape {poses.shape}")
    parent, child = poses[joints.parent], poses[joints.child]
    q_world_zero = multiply(parent[:, 3:], joints.T_parent_zero[:, 3:])
    q_zero_child = multiply(conjugate(q_world_zero), child[:, 3:])
    axis_world = rotate(child[:, 3:], joints.axis)
    half_sin = _dot(q_zero_child[:, :3], joints.axis)
    half_cos = q_zero_child[:, 3]
    angle = 2.0 * np.arctan2(half_sin, half_cos)  # or a whole turn more: see below
    velocity = _velocity(parent, child, twists, joints, axis_world)
    if joints.all_turn:
        position, alignment = angle, half_sin**2 + half_cos**2
        rounding: float | np.ndarray = ROUNDING
    else:
        way = child[:, :3] - parent[:, :3]
        way -= rotate(parent[:, 3:], joints.T_parent_zero[:, :3])
        slid = _dot(way, rotate(q_world_zero, joints.axis))
        position = np.where(joints.turns, angle, slid)
        alignment = joints.turns * half_sin**2 + half_cos**2
        far = np.abs(child[:, :3]).max(axis=1, initial=0.0)
        rounding = ROUNDING * np.where(joints.turns, 1.0, 1.0 + far)
    position = _near(position, joints.middle, joints)
    if before is not None and joints.some_go_on:
        position = _go_on(position, velocity, before, joints)
    return Measured(
        _without_rounding(position, rounding),
        _without_rounding(velocity, ROUNDING),
        alignment,
    )


def _without_rounding(values: np.ndarray, rounding: float | np.ndarray) -> np.ndarray:
    """Put 0.0 for what is nothing but rounding, and for -0.0."""
    return np.where(np.abs(values) <= rounding, 0.0, values)


def _velocity(
    parent: np.ndarray,
    child: np.ndarray,
    twists: np.ndarray,
    joints: MeasuredJoints,
    axis_world: np.ndarray,
) -> np.ndarray:
    """Measure joint velocities from link twists.

    A turning joint's velocity is the difference of the two links' angular
    velocities along its axis; a sliding joint's is how fast the child's origin
    moves along the axis, seen from the turning parent.
    """
    difference = twists[joints.child] - twists[joints.parent]
    if joints.all_turn:
        return _dot(difference[:, 3:], axis_world)
    lever = child[:, :3] - parent[:, :3]
    seen = difference[:, :3] - cross(twists[joints.parent, 3:], lever)
    moving = np.where(joints.turns[:, np.newaxis], difference[:, 3:], seen)
    return _dot(moving, axis_world)


def _go_on(
    position: np.ndarray, velocity: np.ndarray, before: Before, joints: MeasuredJoints
) -> np.ndarray:
    """Let the positions that limits don't tell go on from the last ones.

    A joint may be a little beyond its stop, but only if it came there at the speed it
    has: one that was put elsewhere is inside its limits.
    """
    # The lesser of the two speeds: a single wrong one must not wind a joint up.
    steady = 0.5 * (np.sign(velocity) + np.sign(before.velocity))
    steady *= np.minimum(np.abs(velocity), np.abs(before.velocity))
    expected = before.position + steady * before.passed
    chosen = _near(position, expected, joints)
    away = np.abs(chosen - expected)
    speed = np.maximum(np.abs(velocity), np.abs(before.velocity))
    beyond = np.where(away <= BLUR + 2.0 * speed * before.passed, OVERSHOOT, BLUR)
    inside = _turned_inside(chosen, beyond, joints)
    # NaN is not within a quarter turn of anything.
    return np.where(joints.goes_on & (away <= JUMP), inside, position)


def _turned_inside(
    position: np.ndarray, beyond: np.ndarray, joints: MeasuredJoints
) -> np.ndarray:
    """Bring positions too far beyond a stop inside the limits by a turn, if it does."""
    over, under = position - joints.upper, joints.lower - position
    down = (over > beyond) & (under + TURN <= BLUR)
    up = (under > beyond) & (over + TURN <= BLUR)
    return position + TURN * (up.astype(float) - down)


def _near(
    position: np.ndarray, place: np.ndarray, joints: MeasuredJoints
) -> np.ndarray:
    """Add the whole turns that bring turning joints nearest to a place."""
    return position + TURN * joints.turns * np.round((place - position) / TURN)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Multiply vectors row by row."""
    return np.einsum("ij,ij->i", a, b)
