"""Hints that a motion's numbers may mean something else than was read.

They are no errors: the motion may be meant so.
"""

from __future__ import annotations

from typing import Dict, Tuple

import numpy as np

from g1_description.motion.edit import other_side
from g1_description.motion.files.conventions import (
    MAX_TILT,
    SAME_TILT,
    W_FIRST_COLUMNS,
    breadth_first,
    has_soles,
    lower_feet,
    tilt,
    tilt_on_floor,
)
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description
from g1_description.robot.rotation import rotate

USUAL, LEAST_SAMPLES = 99.0, 20
"""Percentile of the speeds of joints that indicates the rate, and how many samples it
needs."""

TURN = 3.3
"""Angles that no revolute joint of the G1 has, in [rad]."""

BACKWARD = 0.1
"""Knees that bend further below their lower limit bend backwards, in [rad]."""

INWARD = -0.15
"""Shoulders that roll less turn the arms into the body, in the median, in [rad]."""

BEYOND, WITHIN = 0.2, 0.05
"""Excess over limits as read, and with the sides swapped, of swapped sides, in
[rad]."""

DOWN = -0.5
"""Upward part of the base's z axis, in the median, of a base that is upside down."""

LYING, HIGH = 0.5, 0.5
"""Upward part of that axis, and height in [m], of a base that lies in the air."""

AWAY = 0.15
"""Heights in [m] of the lower ankle, in all samples, of a robot that is never near the
floor. Their lowest is 0.03 to 0.05 m in three clips of G1 Moves, and 0.16 m and more
where these have a base 1.3 times as high and the 27 joints in the order of an H1-2."""

OTHER_UNITS = 10.0
"""Heights in [m] that may be in other units."""

OTHERS = {
    "wxyz": ("x y z w", [0, 1, 2, 6, 3, 4, 5]),
    "xyzw": ("w x y z", W_FIRST_COLUMNS),
}
"""The other order by the order of quaternions that were read, and the columns of poses
that have it."""

Columns = Dict[str, np.ndarray]
"""Positions by joint, in [rad], each of shape (n_samples,)."""

Limits = Dict[str, Tuple[float, float]]
"""Lower and upper limit by joint, in [rad]."""


def hints(
    motion: Motion, robot: Description, order: str | None = None, may_lie: bool = False
) -> tuple[str, ...]:
    """Report what looks wrong, and why.

    Args:
        motion: Motion of joints of the robot, in radians.
        robot: The robot.
        order: Order of the file's quaternions as they were read, xyzw or wxyz, if its
            format fixes it; None: it has none, or the user gives it.
        may_lie: Whether a hint is given if the robot does not stand.
    """
    limits = {
        joint.name: (joint.lower, joint.upper)
        for joint in robot.movable_joints
        if joint.kind == "revolute"
    }
    columns = {
        name: motion.positions[:, number]
        for number, name in enumerate(motion.joint_names)
        if name in limits
    }
    other = _joint_order(columns, limits, robot)
    if other:  # all else follows from it
        return (other,)
    of_joints = (_degrees, _knees, _sides)
    found = [hint(columns, limits) for hint in of_joints]
    if not motion.has_times:
        found.append(_rate(motion, robot))
    if motion.base_poses is not None:
        found.append(_base(motion, motion.base_poses, robot, order, may_lie))
    return tuple(text for text in found if text)


def _rate(motion: Motion, robot: Description) -> str:
    """Tell of joints that are too fast at a rate that is not in the file."""
    limits = {joint.name: joint.velocity for joint in robot.movable_joints}
    if len(motion.times) < LEAST_SAMPLES:
        return ""
    speeds = np.abs(np.diff(motion.positions, axis=0)) / np.diff(motion.times)[:, None]
    usual = np.percentile(speeds, USUAL, axis=0)  # above it are jumps
    most = max(
        (speed / limits.get(name, np.inf) if limits.get(name) else 0.0)
        for name, speed in zip(motion.joint_names, usual.tolist())
    )
    if most <= 1.0:
        return ""
    rate = 1.0 / np.diff(motion.times).mean()
    return (
        f"Joints are up to {most:.2g} times as fast as their limits allow: the rate "
        f"may be lower than {rate:.4g} Hz; --fps sets it."
    )


def _joint_order(columns: Columns, limits: Limits, robot: Description) -> str:
    """Tell of joints that keep their limits only in another order."""
    beyond = _excess(columns, limits)
    if beyond <= BEYOND:
        return ""
    own = tuple(joint.name for joint in robot.movable_joints if joint.name in columns)
    orders = (
        ("isaaclab", "Isaac Lab", breadth_first(robot, columns)),
        ("mujoco", "MuJoCo, that of the robot's file", own),
    )
    for name, title, order in orders:
        moved = dict(zip(order, columns.values()))
        if order != (*columns,) and _excess(moved, limits) < WITHIN:
            return (
                f"Joints are up to {beyond:.2g} rad beyond their limits, and within "
                f"them in the order of {title}: check and motion read them so "
                f"with --input-joint-order {name}, unless the file names them."
            )
    return ""


def _degrees(columns: Columns, limits: Limits) -> str:
    """Tell of angles that may be degrees."""
    for name, values in columns.items():
        largest = float(values[np.argmax(np.abs(values))])
        if abs(largest) > TURN and _excess({name: values}, limits) > BEYOND:
            lower, upper = limits[name]
            return (
                f"{name} turns to {largest:.3g} rad, beyond limits of {lower:.3g} and "
                f"{upper:.3g}: the file may be in degrees, or of another robot."
            )
    return ""


def _knees(columns: Columns, limits: Limits) -> str:
    """Tell of knees that bend backwards."""
    for name, values in columns.items():
        if "knee" in name and values.min() < limits[name][0] - BACKWARD:
            return (
                f"{name} bends backwards, to {values.min():.3g} rad: signs or the "
                "order of joints may be wrong."
            )
    return ""


def _sides(columns: Columns, limits: Limits) -> str:
    """Tell of left and right that may be swapped."""
    left, right = (
        columns.get(f"{side}_shoulder_roll_joint", np.zeros(1))
        for side in ("left", "right")
    )
    outward = 0.5 * float(np.median(left - right))
    if outward < INWARD:
        return (
            f"The arms are rolled into the body, by {-outward:.2g} rad in the median: "
            "left and right may be swapped, or signs wrong."
        )
    swapped = {other_side(name): values for name, values in columns.items()}
    fits = {*swapped} == {*columns} and _excess(swapped, limits) < WITHIN
    if fits and _excess(columns, limits) > BEYOND:
        return (
            "Joints are within their limits only with the sides swapped: left and "
            "right may be swapped."
        )
    return ""


def _excess(columns: Columns, limits: Limits) -> float:
    """Return the largest excess of positions over limits, in [rad]."""
    return max(
        (
            float(max(limits[name][0] - values.min(), values.max() - limits[name][1]))
            for name, values in columns.items()
        ),
        default=0.0,
    )


def _base(
    motion: Motion,
    base: np.ndarray,
    robot: Description,
    order: str | None,
    may_lie: bool,
) -> str:
    """Report a base and feet that are not those of a standing robot."""
    lower = None
    if has_soles(robot):
        title, columns = OTHERS[order or "xyzw"]
        lower, other = lower_feet(motion, robot, columns)
        tilted = tilt_on_floor(other)
        is_flatter = tilted <= MAX_TILT and tilted + SAME_TILT < tilt_on_floor(lower)
        if is_flatter and order is not None:
            return (
                f"The feet are flat only if the base's quaternions are {title}, not as "
                f"in other files of this format: --order {title.replace(' ', '')} "
                "reads them so."
            )
    upward = float(np.median(rotate(base[:, 3:], np.array([0.0, 0.0, 1.0]))[:, 2]))
    if upward < DOWN:
        return (
            "The base points down in most samples: the order of the quaternion, or the "
            "direction of its turn, may differ from what was assumed."
        )
    height = float(np.median(base[:, 2]))
    if abs(upward) < LYING and OTHER_UNITS > height > HIGH:
        return (
            f"The base lies at a height of {height:.2g} m in most samples: the order "
            "of the quaternion, or the axis that points up, may differ from what was "
            "assumed."
        )
    if lower is None or not base[:, :3].any():
        return ""
    return _feet(lower, may_lie)


def _feet(lower: np.ndarray, may_lie: bool) -> str:
    """Tell of feet that are seldom flat, or never near the floor."""
    if may_lie and tilt(lower) > MAX_TILT:
        return (
            "The robot does not stand in most samples: it lies, or the order of the "
            "quaternion or of the joints, or the axis that points up, differs from "
            "what was assumed."
        )
    lowest, highest = float(lower[:, 2].min()), float(lower[:, 2].max())
    if lowest < AWAY and highest > -AWAY:
        return ""
    side, away = ("above", lowest) if lowest > 0.0 else ("below", -highest)
    units = " in cm or mm," if away > OTHER_UNITS else ""
    return (
        f"The feet are always at least {away:.3g} m {side} the floor, z = 0: the "
        f"motion may be{units} of another robot, or of another ground; motion floor "
        "puts it on the floor."
    )
