"""A link put somewhere by the joint that it hangs on, as near as that goes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from g1_description.core.bridge.joints import measured_joints
from g1_description.core.bridge.measurement import measure
from g1_description.core.errors import InvalidValueError
from g1_description.core.robot.assembly import WORLD
from g1_description.core.robot.description import MOVABLE, Joint
from g1_description.core.rotation import angle_between
from g1_description.core.transform import compose, inverse

from .model import Model


class Placed(NamedTuple):
    """What became of a link that was to be put somewhere."""

    joint: str
    """The joint that was set."""

    distance: float
    """From the link's frame to where it was wanted, in [m]."""

    angle: float
    """Between its orientation and the one that was wanted, in [rad]."""


def joint_above(model: Model, link: str) -> Joint | None:
    """Find the joint that a link hangs on; none for what moves with the whole model.

    A link that is fixed to the world carries its tree as a root does, if it is the
    first.
    """
    for joint in model.assembly.description.joints:
        if joint.child == link:
            row = model.link_names.index(link)
            first = model.tree_below(row) is not None
            return None if first and joint.kind not in MOVABLE else joint
    return None


def place_link(
    model: Model, joint: Joint, pose: np.ndarray, twist: np.ndarray
) -> Placed:
    """Set a joint so that the link on it comes nearest to a pose.

    A joint that turns takes the turn about its axis from the orientation, one that
    slides the way along its axis from the place. What hangs below moves rigidly.

    Args:
        model: The model, which is changed.
        joint: The joint that the link hangs on.
        pose: Where the link is wanted in the world, shape (7,).
        twist: Velocity wanted of the link frame's origin and angular velocity, along
            the world's axes, shape (6,). The joint takes what is along its axis.

    Raises:
        InvalidValueError: If the joint cannot move; nothing is changed.
    """
    if joint.kind not in MOVABLE:
        raise InvalidValueError(
            f"{joint.child} of {model.name} is fixed to {joint.parent} by {joint.name}"
        )
    names = (*model.link_names, WORLD)
    poses = np.vstack([model.poses, model.root_poses[0]])
    twists = np.vstack([model.twists, np.zeros(6)])
    row = names.index(joint.child)
    poses[row], twists[row] = pose, twist
    tree = next(
        tree
        for tree in model.assembly.description.trees
        if joint.child in tree.link_names
    )
    joints = measured_joints(tree, names)
    measured = measure(poses, twists, joints)
    index = joints.names.index(joint.name)
    model.set_joint(joint.name, measured.position[index], measured.velocity[index])
    reached = model.poses[row]
    T_reached_wanted = compose(inverse(reached), pose)
    return Placed(
        joint.name,
        float(np.linalg.norm(T_reached_wanted[:3])),
        float(angle_between(reached[3:], pose[3:])),
    )
