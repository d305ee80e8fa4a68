"""Named poses: joint positions by name, whether they exist and suit a robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from g1_description.core.errors import InvalidValueError, UnknownNameError
from g1_description.core.robot.description import Description, Joint
from g1_description.core.text import listed, similar_first

ZERO = "zero"
"""The pose that needs no file: every robot has it."""


@dataclass(frozen=True)
class Pose:
    """Where some joints of a robot are."""

    name: str

    positions: dict[str, float] = field(default_factory=dict)
    """Positions in [rad] or [m] by joint; the others are at 0.0."""

    about: str = ""
    """A line of text."""

    place: str = ""
    """The file it is from."""


def find_pose(name: str, poses: Mapping[str, Pose]) -> Pose:
    """Find a pose by its name.

    Raises:
        UnknownNameError: If there is none; its words begin with the nearest names.
    """
    if name not in poses:
        known = listed(similar_first(name, poses)) or "none"
        raise UnknownNameError(f"There is no pose '{name}'; there are {known}.")
    return poses[name]


def check_pose(pose: Pose, description: Description) -> None:
    """Check that a robot can take a pose.

    Args:
        pose: The pose.
        description: The robot.

    Raises:
        UnknownNameError: If it names a joint that the robot does not have, or that
            does not move.
        InvalidValueError: If a position is outside the joint's limits.
    """
    joints = {joint.name: joint for joint in description.movable_joints}
    owner = f"Pose {pose.name} of {pose.place}"
    for name, position in pose.positions.items():
        if name not in joints:
            known = listed(similar_first(name, joints)) or "none"
            raise UnknownNameError(
                f"{owner} names {name}, which is no movable joint of "
                f"'{description.name}'; there are {known}."
            )
        check_limits(owner, joints[name], position)


def check_limits(owner: str, joint: Joint, position: float) -> None:
    """Check that a joint can be somewhere.

    Args:
        owner: What has the position, for the message.
        joint: The joint.
        position: In [rad] or [m].

    Raises:
        InvalidValueError: If it cannot.
    """
    if not joint.lower <= position <= joint.upper:
        raise InvalidValueError(
            f"{owner} has {joint.name} at {position:g}, its limits are "
            f"{joint.lower:g} and {joint.upper:g}."
        )


def pose_positions(pose: Pose, description: Description) -> np.ndarray:
    """Give the positions of all joints of a robot in a pose.

    Args:
        pose: A pose that the robot can take.
        description: The robot.

    Returns:
        Positions in [rad] or [m], in the order of its movable joints; where a joint
        that is not named cannot be at 0.0, its nearest limit, shape (n_joints,).
    """
    joints = description.movable_joints
    positions = np.array([pose.positions.get(joint.name, 0.0) for joint in joints])
    lower = np.array([joint.lower for joint in joints])
    upper = np.array([joint.upper for joint in joints])
    return np.clip(positions, lower, upper)
