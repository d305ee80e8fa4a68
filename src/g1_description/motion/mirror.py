"""Motions with left and right exchanged."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from g1_description.errors import MotionError
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.transform import IDENTITY
from g1_description.text import listed

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
