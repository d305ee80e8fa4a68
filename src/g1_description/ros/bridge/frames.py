"""The frames above a robot, and which node owns which edge."""

from __future__ import annotations

import numpy as np

from g1_description.core.robot.assembly import base_of
from g1_description.core.robot.description import Description

from .parameters import BridgeParameters


def base_child(parameters: BridgeParameters, description: Description) -> str | None:
    """Find the frame that moves in the map.

    Args:
        parameters: Names of the frames above.
        description: The robot; its frame names come from its file.

    Returns:
        base_link; the root, or what floats in the world, where base_link is a link
        below it, which has a parent already; None where the root itself is the world
        or the map and nothing floats in it.
    """
    p = parameters
    root, _ = base_of(description)
    if root in (p.world_frame, p.map_frame):
        return None
    below = p.base_frame in description.link_names and p.base_frame != root
    return root if below else p.base_frame


def fixed_edges(
    description: Description, prefix: str = ""
) -> list[tuple[str, str, np.ndarray]]:
    """List the fixed joints of a robot.

    Args:
        description: The robot.
        prefix: What stands before the names of the robot's own frames.

    Returns:
        Parent, child and the child's pose in the parent's frame, shape (7,).
    """
    return [
        (prefix + joint.parent, prefix + joint.child, joint.pose)
        for joint in description.joints
        if joint.kind == "fixed"
    ]


def static_edges(
    parameters: BridgeParameters, description: Description, prefix: str = ""
) -> list[tuple[str, str]]:
    """List the static edges around a robot, all of them identities.

    Args:
        parameters: Names of the frames above.
        description: The robot.
        prefix: What stands before the names of the robot's own frames.

    Returns:
        Parent and child of world -> map, base_link -> root where base_link is no
        link of the robot, world -> its own world where that has a prefix, and
        imu_in_torso -> body_imu where the robot has one.
    """
    p = parameters
    edges = [(p.world_frame, p.map_frame)]
    root, _ = base_of(description)
    if base_child(p, description) not in (None, root):
        edges.append((prefix + p.base_frame, prefix + root))
    if prefix and description.root in (p.world_frame, p.map_frame):
        edges.append((description.root, prefix + description.root))
    if p.imu_link in description.link_names:
        edges.append((prefix + p.imu_link, prefix + p.imu_frame))
    return edges
