"""Hints that a motion's numbers may mean something else than was read.

They are no errors: the motion may be meant so.
"""

from __future__ import annotations

from typing import Dict, Tuple

import numpy as np

from g1_description.motion.mirror import other_side
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description
from g1_description.robot.rotation import rotate

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

Columns = Dict[str, np.ndarray]
"""Positions by joint, in [rad], each of shape (n_samples,)."""

Limits = Dict[str, Tuple[float, float]]
"""Lower and upper limit by joint, in [rad]."""


def hints(motion: Motion, robot: Description) -> tuple[str, ...]:
    """Tell what looks wrong, and why.

    Args:
        motion: Of joints of the robot, in radians.
        robot: The robot.
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
    of_joints = (_degrees, _knees, _sides)
    found = [tell(columns, limits) for tell in of_joints]
    return tuple(text for text in (*found, _base(motion)) if text)


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


def _base(motion: Motion) -> str:
    """Tell of a base that points down, or lies in the air."""
    poses = motion.base_poses
    if poses is None:
        return ""
    upward = float(np.median(rotate(poses[:, 3:], np.array([0.0, 0.0, 1.0]))[:, 2]))
    if upward < DOWN:
        return (
            "The base points down in most samples: the order of the quaternion, or the "
            "direction of its turn, may be another than was read."
        )
    height = float(np.median(poses[:, 2]))
    if abs(upward) < LYING and height > HIGH:
        return (
            f"The base lies at a height of {height:.2g} m in most samples: the order "
            "of the quaternion, or the axis that points up, may be another than was "
            "read."
        )
    return ""
