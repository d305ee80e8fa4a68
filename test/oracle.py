"""Forward kinematics by scipy, from the URDF's text: it owes our code nothing."""

import xml.etree.ElementTree as ET
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation


def forward_kinematics(text, root_pose, positions):
    """Place every link of a URDF with scipy, joint by joint.

    Args:
        text: URDF.
        root_pose: Pose of the root link, shape (7,).
        positions: Joint positions by name; absent joints are at zero.

    Returns:
        Poses by link name, each shape (7,).
    """
    tree = ET.fromstring(text)
    joints = {joint.find("child").get("link"): joint for joint in tree.findall("joint")}

    def read(joint, tag, attribute, default):
        element = joint.find(tag)
        value = None if element is None else element.get(attribute)
        return np.array([float(part) for part in (value or default).split()])

    @lru_cache(maxsize=None)
    def place(link):
        if link not in joints:
            return root_pose[:3], Rotation.from_quat(root_pose[3:])
        joint = joints[link]
        position, rotation = place(joint.find("parent").get("link"))
        position = position + rotation.apply(read(joint, "origin", "xyz", "0 0 0"))
        rpy = read(joint, "origin", "rpy", "0 0 0")
        rotation = rotation * Rotation.from_euler("xyz", rpy)
        axis = read(joint, "axis", "xyz", "1 0 0")
        axis = axis / np.linalg.norm(axis)
        value = positions.get(joint.get("name"), 0.0)
        if joint.get("type") == "prismatic":
            return position + rotation.apply(axis * value), rotation
        if joint.get("type") == "fixed":
            return position, rotation
        return position, rotation * Rotation.from_rotvec(axis * value)

    poses = {}
    for link in tree.findall("link"):
        position, rotation = place(link.get("name"))
        poses[link.get("name")] = np.concatenate([position, rotation.as_quat()])
    return poses


def matrix_of(rotation):
    """Give the matrix of a scipy Rotation, shape (3, 3).

    Its own name for this is as_dcm before scipy 1.4, and as_matrix from there on.
    """
    return rotation.apply(np.eye(3)).T


def angle_of(rotation):
    """Give how far a scipy Rotation turns, in [rad]; scipy 1.3 has no magnitude."""
    return np.linalg.norm(rotation.as_rotvec())


def assert_poses_close(actual, expected, tolerance):
    """Compare poses in [m] and [rad]; q and -q are the same rotation."""
    np.testing.assert_allclose(actual[..., :3], expected[..., :3], atol=tolerance)
    difference = (
        Rotation.from_quat(np.atleast_2d(expected[..., 3:])).inv()
        * Rotation.from_quat(np.atleast_2d(actual[..., 3:]))
    ).as_rotvec()
    np.testing.assert_allclose(difference, 0.0, atol=tolerance)
