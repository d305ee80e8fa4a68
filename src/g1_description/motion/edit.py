"""Edited motions: cut, joined, mirrored, moved, with other times, samples or joints."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from g1_description.errors import InvalidValueError, MotionError
from g1_description.motion.motion import (
    SINGLE_TIME,
    SNAP,
    Motion,
    MotionLike,
    as_motion,
    sample,
)
from g1_description.robot.description import Description
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.rotation import multiply, rotate, shorter_turn
from g1_description.robot.transform import IDENTITY, compose, inverse
from g1_description.text import listed


def later(motion: Motion, lead_in: float) -> Motion:
    """Delay a motion, so that the robot can move to the first sample and rest there.

    Args:
        motion: The motion.
        lead_in: The delay in [s]; 0: the motion is returned unchanged.
    """
    if not lead_in:
        return motion
    velocities = motion.velocities
    if velocities is not None:
        velocities = np.vstack([np.zeros_like(velocities[:1]), velocities[1:]])
    return replace(motion, times=motion.times + lead_in, velocities=velocities)


def moved(motion: Motion, T_map_motion: np.ndarray) -> Motion:
    """Move the base of a motion as a whole.

    Args:
        motion: The motion.
        T_map_motion: New pose of the motion's origin in the map, shape (7,).
    """
    if motion.base_poses is None:
        return motion
    return replace(motion, base_poses=compose(T_map_motion, motion.base_poses))


def to_start_at(motion: Motion, pose: np.ndarray) -> Motion:
    """Move a motion so that it starts at a position and yaw.

    Height, roll and pitch of the motion are kept.

    Args:
        motion: The motion.
        pose: Pose of the base in the map, shape (7,).
    """
    if motion.base_poses is None:
        return motion
    T_map_motion = compose(projected(pose), inverse(projected(motion.base_poses[0])))
    return moved(motion, T_map_motion)


def projected(pose: np.ndarray) -> np.ndarray:
    """Project a pose to the floor.

    Args:
        pose: In the map, shape (7,).

    Returns:
        An upright pose at height 0, with the place and the heading of the x axis.
    """
    forward = rotate(pose[3:], np.array([1.0, 0.0, 0.0]))
    half = 0.5 * np.arctan2(forward[1], forward[0])
    return np.array([pose[0], pose[1], 0.0, 0.0, 0.0, np.sin(half), np.cos(half)])


def joined(
    motions: Sequence[MotionLike], blend: float = 0.0, follows: bool = True
) -> Motion:
    """Join motions, one after another.

    Args:
        motions: At least one. All have the joints of the first, in any order, and all
            or none have a base.
        blend: Time in which the end of a motion becomes the beginning of the next, in
            [s]; 0: the next one begins one sample later, at its own rate if it has one.
        follows: Whether a motion is moved to the place and heading at which the one
            before ends; its height and tilt stay.

    Returns:
        The motion, with velocities if all have them; blended parts have the samples of
        the next motion.

    Raises:
        MotionError: If joints or bases differ.
        InvalidValueError: If the blend is longer than a motion, or there is none.
    """
    if not motions:
        raise InvalidValueError("There are no motions to join.")
    whole, *others = map(as_motion, motions)
    for number, other in enumerate(others, 2):
        differ = {*whole.joint_names} ^ {*other.joint_names}
        if differ:
            raise MotionError(
                f"Motion {number} cannot be joined: these joints are only in it or in "
                f"those before: {listed(sorted(differ))}."
            )
        if (whole.base_poses is None) != (other.base_poses is None):
            raise MotionError(
                f"Motion {number} cannot be joined: all or none must have a base."
            )
        shorter = min(one.duration for one in (whole, other))
        if not 0.0 <= blend <= shorter:
            raise InvalidValueError(
                f"The blend must be from 0 to the shortest motion's {shorter:g} s (got "
                f"{blend:g})."
            )
        whole = _joined(whole, other.arranged(whole.joint_names), blend, follows)
    return whole


def _joined(before: Motion, after: Motion, blend: float, follows: bool) -> Motion:
    """Join two motions of the same joints."""
    periods = [m.duration / max(len(m.times) - 1, 1) for m in (after, before)]
    gap = periods[0] or periods[1] or SINGLE_TIME
    begin = before.end - blend if blend else before.end + gap
    if follows and before.base_poses is not None:
        place = sample(before, begin).base_poses
        assert place is not None
        after = to_start_at(after, place)
    after = replace(after, times=after.times - after.times[0] + begin)
    if blend:
        after = _blended(before, after, blend)
    kept = before.times < begin - SNAP

    def both(first: np.ndarray, second: np.ndarray) -> np.ndarray:
        return np.concatenate([first[kept], second])

    velocities, poses = before.velocities, before.base_poses
    if velocities is not None and after.velocities is not None:
        velocities = both(velocities, after.velocities)
    else:
        velocities = None
    if poses is not None and after.base_poses is not None:
        poses = both(poses, after.base_poses)
    return replace(
        before,
        times=both(before.times, after.times),
        positions=both(before.positions, after.positions),
        velocities=velocities,
        base_poses=poses,
        notes=(*dict.fromkeys((*before.notes, *after.notes)),),
        has_times=before.has_times and after.has_times,
    )


def _blended(before: Motion, after: Motion, blend: float) -> Motion:
    """Let the beginning of a motion come out of the end of another."""
    share = np.clip((after.times - after.times[0]) / blend, 0.0, 1.0)[:, np.newaxis]
    weight = minimum_jerk_fraction(share)
    left = 1.0 - weight  # exactly 0 after the blend
    old = sample(before, after.times)
    change = after.positions - old.positions
    velocities, poses = after.velocities, after.base_poses
    if velocities is not None:
        rate = 30.0 * share**2 * (1.0 - share) ** 2 / blend
        velocities = velocities - left * (velocities - old.velocities) + rate * change
    if poses is not None and old.base_poses is not None:
        poses = between(old.base_poses, poses, weight)
    return replace(
        after,
        positions=after.positions - left * change,
        velocities=velocities,
        base_poses=poses,
    )


def between(T_a_b: np.ndarray, T_a_c: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Interpolate between poses, straight and about one axis.

    Args:
        T_a_b: Poses at weight 0, shape (..., 7).
        T_a_c: Poses at weight 1, shape (..., 7).
        weight: From 0 to 1, shape (..., 1).
    """
    axis, half = shorter_turn(T_a_b[..., 3:], T_a_c[..., 3:])
    turn = np.concatenate([np.sin(weight * half) * axis, np.cos(weight * half)], -1)
    places = T_a_b[..., :3] + weight * (T_a_c[..., :3] - T_a_b[..., :3])
    return np.concatenate([places, multiply(T_a_b[..., 3:], turn)], axis=-1)


def joint_speeds(motion: Motion) -> np.ndarray:
    """Compute the top speeds of the joints, also between samples.

    Returns:
        In [rad/s] or [m/s], shape (n_joints,); 0 for a single sample without
        velocities.
    """
    rates, gaps = motion.velocities, np.diff(motion.times)[:, np.newaxis]
    slopes = np.diff(motion.positions, axis=0) / gaps
    if rates is None:
        return np.abs(slopes).max(axis=0, initial=0.0)
    # The velocity is a parabola of the share of a segment; its vertex may be inside.
    curve = 3.0 * (rates[:-1] + rates[1:] - 2.0 * slopes)
    middle = 3.0 * slopes - 2.0 * rates[:-1] - rates[1:]
    share = np.clip(-middle / np.where(curve == 0.0, np.inf, curve), 0.0, 1.0)
    vertex = rates[:-1] + share * (2.0 * middle + share * curve)
    return np.abs(np.concatenate([rates, vertex])).max(axis=0)


def base_speed(motion: Motion) -> float | None:
    """Compute the top speed of the base's origin in [m/s]; None without a base."""
    if motion.base_poses is None:
        return None
    steps = np.linalg.norm(np.diff(motion.base_poses[:, :3], axis=0), axis=1)
    return float((steps / np.diff(motion.times)).max(initial=0.0))


def highest_speed(motion: Motion, robot: Description) -> float:
    """Compute how fast a motion can be played within the velocity limits of the joints.

    Args:
        motion: The motion.
        robot: Its limits.

    Returns:
        The largest speed for ``at_speed``: at it, a joint is at its limit.

    Raises:
        MotionError: If no joint with a limit moves, or one whose limit is 0.
    """
    limits = {joint.name: joint.velocity for joint in robot.movable_joints}
    bounds = np.array([limits.get(name, np.inf) for name in motion.joint_names])
    speeds = joint_speeds(motion)
    for name, speed, bound in zip(motion.joint_names, speeds, bounds):
        if speed and not bound:
            raise MotionError(f"{name} cannot move: its velocity limit is 0.")
    share = (speeds / np.where(speeds == 0.0, 1.0, bounds)).max(initial=0.0)
    if not share > 0.0:
        raise MotionError("No joint with a velocity limit moves.")
    return float(1.0 / share)


SIDE = re.compile(r"(?<![a-z])(left|right|l|r)(?![a-z])", re.IGNORECASE)
"""A side in the name of a joint."""

OTHER_SIDE = {"left": "right", "right": "left", "l": "r", "r": "l"}

MIRROR = np.array([1.0, -1.0, 1.0])
"""Mirror image of a vector, at the plane between left and right."""

POSE_MIRROR = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0])
"""Mirror image of a pose."""

MAX_DISTANCE = 0.01
"""Largest distance of a joint from the mirror image of its counterpart, in [m]."""

MAX_ANGLE = np.radians(2.0)
"""Largest angle between their axes, in [rad]."""


def mirrored(motion: Motion, robot: Description) -> Motion:
    """Exchange left and right.

    The mirror is the plane y = 0 of the map, for the base that of the robot. Joints
    belong together by their names, such as ``left_knee`` and
    ``right_knee``; their axes give the sign.

    Args:
        motion: The motion, of joints of the robot.
        robot: The robot, symmetric at zero.

    Raises:
        MotionError: If the robot has no such joint, or is not symmetric.
    """
    signs = _signs(robot)
    unknown = [name for name in motion.joint_names if name not in signs]
    if unknown:
        raise MotionError(f"{robot.name} has no joints {listed(unknown)}.")
    new = [other_side(name) for name in motion.joint_names]
    own = motion.joint_names
    names = own if {*new} == {*own} else tuple(new)
    columns = [new.index(name) for name in names]
    factors = np.array([signs[name] for name in names])
    velocities, poses = motion.velocities, motion.base_poses
    return replace(
        motion,
        joint_names=names,
        positions=factors * motion.positions[:, columns],
        velocities=None if velocities is None else factors * velocities[:, columns],
        base_poses=None if poses is None else POSE_MIRROR * poses,
    )


def other_side(name: str) -> str:
    """Name the joint of the other side; one of no side is its own counterpart.

    Args:
        name: Such as ``left_knee`` or ``R_elbow``.
    """

    def exchanged(match: re.Match[str]) -> str:
        side = OTHER_SIDE[match[0].lower()]
        if match[0].isupper():
            return side.upper()
        return side.title() if match[0][0].isupper() else side

    return SIDE.sub(exchanged, name)


def _signs(robot: Description) -> dict[str, float]:
    """Find the signs of positions by joint, relative to the counterparts'."""
    joints = robot.movable_joints
    row = {joint.name: number for number, joint in enumerate(joints)}
    alone = [name for name in row if other_side(name) not in row]
    if alone:
        raise MotionError(
            f"{robot.name} cannot be mirrored: {listed(alone)} have no counterparts on "
            "the other side."
        )
    others = [row[other_side(name)] for name in row]
    _, origins, axes = Kinematics(robot).place(IDENTITY, np.zeros(len(joints)))
    apart = np.linalg.norm(origins[others] - MIRROR * origins, axis=1)
    along = np.einsum("ij,ij->i", axes[others], MIRROR * axes)
    wrong = (apart > MAX_DISTANCE) | (np.abs(along) < np.cos(MAX_ANGLE))
    if wrong.any():
        names = listed(name for name, is_wrong in zip(row, wrong) if is_wrong)
        raise MotionError(
            f"{robot.name} cannot be mirrored: it is not symmetric at zero ({names})."
        )
    # A mirror turns rotations around, but not displacements.
    turns = np.array([joint.kind != "prismatic" for joint in joints])
    signs = np.where(turns, -np.sign(along), np.sign(along))
    return dict(zip(row, signs.tolist()))


FloatOrArray = TypeVar("FloatOrArray", float, np.ndarray)

N_SAMPLES = 101
"""Samples of a path: cubic polynomials between them are within 1e-7 of its length."""


def minimum_jerk_fraction(time: FloatOrArray) -> FloatOrArray:
    """Compute the fraction of a minimum-jerk path at fractions of its time.

    Args:
        time: From 0 to 1, of any shape.

    Returns:
        From 0 to 1, of the same shape. Source: Flash and Hogan, J. Neurosci. 5, 1985.
    """
    return time**3 * (10.0 - 15.0 * time + 6.0 * time**2)


def minimum_jerk(start: np.ndarray, goal: np.ndarray, fraction: float) -> np.ndarray:
    """Compute a point of the minimum-jerk path between two configurations.

    Each joint stays between start and goal, so limits that hold at both ends hold
    everywhere.

    Args:
        start: Positions at the beginning in [rad] or [m], shape (n,).
        goal: Positions at the end, shape (n,).
        fraction: Fraction of the time, clamped to 0 to 1.

    Returns:
        Positions, shape (n,).
    """
    t = min(max(fraction, 0.0), 1.0)
    done = minimum_jerk_fraction(t)
    path = (1.0 - done) * start + done * goal
    return np.clip(path, np.minimum(start, goal), np.maximum(start, goal))


def minimum_jerk_trajectory(
    joint_names: Sequence[str], start: np.ndarray, goal: np.ndarray, seconds: float
) -> Motion:
    """Sample a minimum-jerk path of joints, with velocities.

    Args:
        joint_names: The joints.
        start: Their positions at the beginning in [rad] or [m], shape (n,).
        goal: Their positions at the end, shape (n,).
        seconds: Duration in [s].
    """
    fractions = np.linspace(0.0, 1.0, N_SAMPLES)
    rates = 30.0 * fractions**2 * (1.0 - fractions) ** 2 / seconds
    return Motion(
        fractions * seconds,
        tuple(joint_names),
        np.array(
            [minimum_jerk(start, goal, fraction) for fraction in fractions.tolist()]
        ),
        np.outer(rates, goal - start),
    )
