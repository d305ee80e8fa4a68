"""Motions that come from a pose and end in one, with the feet on the floor."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from g1_description.errors import InvalidValueError, MotionError
from g1_description.motion.edit import between, joined, minimum_jerk, projected
from g1_description.motion.files.conventions import of_robot
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description
from g1_description.robot.kinematics import Kinematics
from g1_description.sim.standing import lowest_heights

PEAK = 1.875
"""Top speed of a minimum-jerk path, relative to its average."""

USUAL_PERIOD = 1.0 / 30.0
"""Time between samples before or after a single sample, in [s]."""


MAX_SAMPLES = 100_000
"""Most samples of a way."""


def padded(
    robot: Description,
    motion: Motion,
    begin: Mapping[str, float] | None = None,
    end: Mapping[str, float] | None = None,
    seconds: float = 1.0,
) -> Motion:
    """Let a motion come from a pose and end in one.

    On the way each joint moves with minimum jerk, so that the robot is at rest where
    the motion begins and ends. The link that is lowest there, such as the foot it
    stands on, stays at its place. In the poses the base is upright, at such a height
    that the robot stands on the floor, which is z = 0.

    Args:
        robot: The robot.
        motion: Its first and last samples stay as they are.
        begin: Positions by joint of the pose before; the motion's other joints are at
            0. None: nothing is added there.
        end: Like ``begin``, of the pose after.
        seconds: Shortest duration of each way, in [s]. A way takes longer where a joint
            would exceed its velocity limit.

    Returns:
        The motion from 0 s on.

    Raises:
        MotionError: If a moving joint has a velocity limit of 0.
        InvalidValueError: If the duration is not positive, or makes too many samples at
            the motion's rate.
    """
    if not 0.0 < seconds < math.inf:
        raise InvalidValueError(f"The time must be greater than 0 (got {seconds:g}).")
    n_gaps = len(motion.times) - 1
    period = motion.duration / n_gaps if n_gaps else USUAL_PERIOD
    parts = [motion.at_speed(1.0, motion.begin)]
    if begin is not None:
        parts.insert(0, _way(robot, motion, 0, begin, seconds, period))
    if end is not None:
        way = _way(robot, motion, -1, end, seconds, period)
        way = _in_order(way, np.arange(len(way.times))[::-1])
        if way.velocities is not None:
            way = replace(way, velocities=-way.velocities)
        parts.append(way)
    return joined(parts, follows=False)


def _way(
    robot: Description,
    motion: Motion,
    row: int,
    pose: Mapping[str, float],
    seconds: float,
    period: float,
) -> Motion:
    """Return the way from a pose to a sample of a motion, without that sample."""
    names = motion.joint_names
    goal = motion.positions[row]
    start = np.array([pose.get(name, 0.0) for name in names])
    limits = {joint.name: joint.velocity for joint in robot.movable_joints}
    needed = seconds
    for name, change in zip(names, np.abs(goal - start).tolist()):
        limit = limits.get(name, math.inf)
        if change and not limit:
            raise MotionError(f"{name} cannot move: its velocity limit is 0.")
        if change:
            needed = max(needed, PEAK * change / limit)
    if needed / period > MAX_SAMPLES:
        raise InvalidValueError(
            f"The transition would have {needed / period:.0f} samples at the motion's "
            f"{1.0 / period:g} Hz; the limit is {MAX_SAMPLES}. Resample the motion."
        )
    count = max(2, math.ceil(needed / period - 1e-9))
    fractions = np.arange(count + 1) / count
    seconds = count * period
    rates = 30.0 * fractions**2 * (1.0 - fractions) ** 2 / seconds
    zero, one = np.zeros(1), np.ones(1)
    weights = np.array([minimum_jerk(zero, one, f) for f in fractions.tolist()])
    way = Motion(
        fractions * seconds,
        names,
        start + weights * (goal - start),
        None if motion.velocities is None else np.outer(rates, goal - start),
    )
    if motion.base_poses is not None:
        base = motion.base_poses[row]
        bases = between(projected(base), np.tile(base, (count + 1, 1)), weights)
        bases[:, 2] = 0.0
        joints = of_robot(names, way.positions, robot)
        places = Kinematics(robot).link_poses(bases, joints)[..., :3]
        foot = places[:, np.argmin(places[-1, :, 2]), :2]
        bases[:, :2] += foot[-1] - foot
        lowest = lowest_heights(robot, replace(way, base_poses=bases))
        # From the floor to where the sample is: its feet may be in the air.
        bases[:, 2] = weights[:, 0] * (base[2] + lowest[-1]) - lowest
        way = replace(way, base_poses=bases)
    return _in_order(way, np.arange(count))


def _in_order(way: Motion, rows: np.ndarray) -> Motion:
    """Choose samples of evenly spaced ones."""
    velocities, poses = way.velocities, way.base_poses
    return replace(
        way,
        times=way.times[: len(rows)],
        positions=way.positions[rows],
        velocities=None if velocities is None else velocities[rows],
        base_poses=None if poses is None else poses[rows],
    )
