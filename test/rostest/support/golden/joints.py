"""Joint positions from the poses of links, with scipy and nothing of ours."""

from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation


def measure_joints(urdf, link_pose):
    """Find all joint positions of a robot; whole turns cannot be seen.

    Args:
        urdf: The robot's description.
        link_pose: Gives a link's position and rotation in the world.

    Returns:
        Positions in [rad] or [m] by the names of the joints that move.
    """
    joints = ElementTree.fromstring(urdf).findall("joint")
    above = {joint.find("child").get("link"): joint for joint in joints}
    poses, positions = {}, {}
    for child, joint in above.items():
        if joint.get("type") == "fixed":
            continue
        parent, place = lumped_into(joint, above)
        for link in (parent, child):
            if link not in poses:
                poses[link] = link_pose(link)
        place = compose(poses[parent], place)
        positions[joint.get("name")] = joint_position(joint, place, poses[child])
    return positions


def numbers(element, attribute):
    """Read three numbers of an element that may be absent."""
    text = None if element is None else element.get(attribute)
    return None if text is None else [float(part) for part in text.split()]


def compose(first, second):
    """Chain two poses of position and rotation."""
    return first[0] + first[1].apply(second[0]), first[1] * second[1]


def origin_of(joint):
    """Give a joint's place in its parent."""
    origin = joint.find("origin")
    rotation = Rotation.from_euler("xyz", numbers(origin, "rpy") or [0.0, 0.0, 0.0])
    return np.array(numbers(origin, "xyz") or [0.0, 0.0, 0.0]), rotation


def lumped_into(joint, above):
    """Give the link that a joint's parent is fixed to, and the joint's place in it."""
    place = origin_of(joint)
    parent = joint.find("parent").get("link")
    while parent in above and above[parent].get("type") == "fixed":
        grandparent = above[parent].find("parent").get("link")
        if grandparent == "world":
            break
        place = compose(origin_of(above[parent]), place)
        parent = grandparent
    return parent, place


def joint_position(joint, place, child):
    """Measure a joint: how far its child is from its place, along its axis."""
    axis = np.array(numbers(joint.find("axis"), "xyz") or [1.0, 0.0, 0.0])
    axis = axis / np.linalg.norm(axis)
    if joint.get("type") == "prismatic":
        return float(place[1].inv().apply(child[0] - place[0]) @ axis)
    return float((place[1].inv() * child[1]).as_rotvec() @ axis)
