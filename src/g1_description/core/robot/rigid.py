"""Links that fixed joints hold together, and where they are in each other's frames."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from g1_description.core.transform import IDENTITY, compose, inverse

from .assembly import WORLD
from .description import Description
from .tree import below


def rigid_frames(
    description: Description, as_lumped: bool = False
) -> dict[str, tuple[str, np.ndarray]]:
    """Find the uppermost link that each link is rigidly connected to.

    Args:
        description: Any robot.
        as_lumped: Whether only what Gazebo lumps counts: the world holds nothing then,
            nor does a joint that the file wants to be kept.

    Returns:
        For each link the uppermost link that fixed joints hold it to, and its pose
        in that link's frame, shape (7,).
    """
    root = description.root
    apart = WORLD if as_lumped and root == WORLD else None
    frames: dict[str, tuple[str, np.ndarray]] = {root: (root, IDENTITY)}
    for joint in below([root], description.joints):
        is_kept = joint.parent == apart or (as_lumped and joint.kept_as)
        if joint.kind == "fixed" and not is_kept:
            body, pose = frames[joint.parent]
            frames[joint.child] = (body, compose(pose, joint.pose))
        else:
            frames[joint.child] = (joint.child, IDENTITY)
    return frames


def reference_links(
    description: Description, available: Collection[str]
) -> dict[str, tuple[str, np.ndarray]]:
    """Find for each link an available link that it is fixed to.

    A simulator publishes some links of a robot: one that lumps fixed joints leaves
    out the children of these joints, others leave out other links.

    Args:
        description: The robot as in its file, with its fixed joints.
        available: Names of the links whose poses are known.

    Returns:
        For each link that is available or fixed to an available one: the name of that
        link, and its own pose in that link's frame, shape (7,).
    """
    frames = rigid_frames(description)
    known: dict[str, tuple[str, np.ndarray]] = {}
    for link in description.link_names:
        body, pose = frames[link]
        if link in available and body not in known:
            known[body] = (link, inverse(pose))
    found = {}
    for link in description.link_names:
        body, pose = frames[link]
        if link in available:
            found[link] = (link, IDENTITY)
        elif body in known:
            reference, T_reference_body = known[body]
            found[link] = (reference, compose(T_reference_body, pose))
    return found
