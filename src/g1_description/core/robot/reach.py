"""How far the links of a robot can be from its root, whatever its joints do."""

from __future__ import annotations

import numpy as np

from g1_description.core.rotation import rotate

from .description import Description, Joint


def origin_reaches(description: Description) -> dict[str, float]:
    """Bound how far each link's origin can be from the root's.

    Args:
        description: The robot.

    Returns:
        The length of the chain to each link in [m] by name: the ways from joint to
        joint, and how far those that slide can. No configuration has it farther away,
        few have it so far. Infinite below a joint that slides without limits.
    """
    above = {joint.child: joint for joint in description.joints}
    reaches = {description.root: 0.0}
    for link in description.link_names:
        chain = []
        while link not in reaches:
            chain.append(link)
            link = above[link].parent
        for child in reversed(chain):
            joint = above[child]
            reaches[child] = reaches[joint.parent] + _length(joint)
    return reaches


def _length(joint: Joint) -> float:
    """Bound how far a joint's child is from its parent, in [m]."""
    if joint.kind == "prismatic":
        travel = max(abs(joint.lower), abs(joint.upper))
        return float(np.linalg.norm(joint.pose[:3])) + travel
    # The child turns about a point of the axis.
    origin = joint.pose[:3] + rotate(joint.pose[3:], joint.joint_origin)
    return float(np.linalg.norm(origin) + np.linalg.norm(joint.joint_origin))
