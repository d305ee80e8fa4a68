"""Putting a link somewhere by the joint that it hangs on, as near as that goes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from g1_description.errors import InvalidValueError
from g1_description.robot.assembly import WORLD
from g1_description.robot.description import MOVABLE, Joint
from g1_description.robot.joint_angles import measure, measured_joints
from g1_description.robot.rotation import angle_between, cross, rotate
from g1_description.robot.transform import compose, inverse
from g1_description.sim.entities import LinkEntity


class Placed(NamedTuple):
    """How near a link was brought to where it was wanted."""

    joint: str
    """The joint that was set."""

    distance: float
    """From the link's frame to where it was wanted, in [m]."""

    angle: float
    """Between its orientation and the one that was wanted, in [rad]."""


def joint_above(entity: LinkEntity) -> Joint | None:
    """Find the joint that a link hangs on; None for what moves with the whole model.

    A link that is fixed to the world carries its tree as a root does, if it is the
    first.
    """
    for joint in entity.model.assembly.description.joints:
        if joint.child == entity.name:
            is_first = entity.model.tree_below(entity.row) is not None
            return None if is_first and joint.kind not in MOVABLE else joint
    return None


def place_link(
    entity: LinkEntity, joint: Joint, pose: np.ndarray, twist: np.ndarray
) -> Placed:
    """Set a joint so that the link on it comes nearest to a pose.

    A joint that turns takes the turn about its axis from the orientation, one that
    slides the way along its axis from the place. What hangs below moves rigidly.

    Args:
        entity: The link; its model is changed.
        joint: The joint that the link hangs on.
        pose: Where the link is wanted in the world, shape (7,).
        twist: Velocity wanted of its center of mass and angular velocity, along the
            world's axes, shape (6,). The joint takes what is along its axis.

    Raises:
        InvalidValueError: If the joint cannot move; nothing is changed.
    """
    model = entity.model
    row = model.joint_row(joint.name)
    if row is None:
        raise InvalidValueError(
            f"{joint.child} of {model.name} is fixed to {joint.parent} by {joint.name}"
        )
    lever = rotate(pose[3:], model.centers[entity.row])
    linear = twist[:3] - cross(twist[3:], lever)
    twist_at_origin = np.concatenate([linear, twist[3:]])
    model.set_joint(row, *_joint_state(entity, joint, pose, twist_at_origin))
    T_reached_wanted = compose(inverse(entity.pose), pose)
    return Placed(
        joint.name,
        float(np.linalg.norm(T_reached_wanted[:3])),
        float(angle_between(entity.pose[3:], pose[3:])),
    )


def _joint_state(
    entity: LinkEntity, joint: Joint, pose: np.ndarray, twist: np.ndarray
) -> tuple[float, float]:
    """Measure a joint as if the link on it were where, and as fast as, it is wanted.

    Args:
        entity: The link.
        joint: The movable joint that the link hangs on.
        pose: Where the link is wanted in the world, shape (7,).
        twist: Velocity wanted of its frame's origin and angular velocity, along the
            world's axes, shape (6,).

    Returns:
        Position in [rad] or [m] and velocity in [rad/s] or [m/s].
    """
    model = entity.model
    names = (*model.link_names, WORLD)
    poses = np.vstack([model.poses, model.root_poses[0]])
    twists = np.vstack([model.twists, np.zeros(6)])
    poses[entity.row], twists[entity.row] = pose, twist
    tree = next(
        tree
        for tree in model.assembly.description.trees
        if joint.child in tree.link_names
    )
    joints = measured_joints(tree, names)
    position, velocity, _ = measure(poses, twists, joints)
    index = joints.names.index(joint.name)
    return float(position[index]), float(velocity[index])
