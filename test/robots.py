"""Makers of random robots and a forward kinematics that owes us nothing."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

_NUMBER = st.floats(-3.0, 3.0).map(lambda value: round(value, 6))
_VECTOR = st.tuples(_NUMBER, _NUMBER, _NUMBER)
_AXIS = _VECTOR.filter(lambda axis: np.linalg.norm(axis) > 0.1)
_KIND = st.sampled_from(["revolute", "continuous", "prismatic", "fixed"])


def _text(vector):
    return " ".join(repr(float(value)) for value in vector)


@st.composite
def chains(draw, kinds=_KIND, max_joints=8):
    """Draw a random tree as URDF text with a value inside the limits per joint.

    Any axis, any origin, branches, fixed joints between movable ones; each link
    has mass. The root is called ``root``.
    """
    links = ["root"]
    parts = []
    positions = {}
    for number in range(draw(st.integers(1, max_joints))):
        kind = draw(kinds)
        parent = draw(st.sampled_from(links))
        name, child = f"joint_{number}", f"link_{number}"
        links.append(child)
        lower = draw(st.floats(-6.0, 5.0))
        span = draw(st.floats(0.01, 6.0))
        parts.append(
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/>'
            f'<child link="{child}"/>'
            f'<origin xyz="{_text(draw(_VECTOR))}" rpy="{_text(draw(_VECTOR))}"/>'
            f'<axis xyz="{_text(draw(_AXIS))}"/>'
            f'<limit lower="{lower!r}" upper="{lower + span!r}" effort="10" '
            'velocity="5"/></joint>'
        )
        if kind == "continuous":
            positions[name] = draw(st.floats(-3.1, 3.1))
        elif kind != "fixed":
            positions[name] = lower + span * draw(st.floats(0.0, 1.0))
    bodies = "".join(
        f'<link name="{link}"><inertial><origin xyz="{_text(draw(_VECTOR))}"/>'
        '<mass value="1.5"/><inertia ixx="2" iyy="2.5" izz="3" ixy="0.1" ixz="0.2" '
        'iyz="0.3"/></inertial></link>'
        for link in links
    )
    return f'<robot name="random">{bodies}{"".join(parts)}</robot>', positions


@st.composite
def world_poses(draw):
    """Draw a pose anywhere in the world, shape (7,)."""
    position = np.array(draw(_VECTOR))
    rotation = Rotation.from_rotvec(np.array(draw(_VECTOR)))
    return np.concatenate([position, rotation.as_quat()])


def forward_kinematics(text, root_pose, positions):
    """Place every link of a URDF with scipy, joint by joint.

    Args:
        text: URDF.
        root_pose: Pose of the root link, shape (7,).
        positions: Joint positions by name; absent joints are at zero.

    Returns:
        Poses by link name, each shape (7,).
    """
    joints = {}
    for joint in ET.fromstring(text).findall("joint"):
        joints[joint.find("child").get("link")] = joint

    def read(joint, tag, attribute, default):
        element = joint.find(tag)
        value = None if element is None else element.get(attribute)
        return np.array([float(part) for part in (value or default).split()])

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
    for link in ET.fromstring(text).findall("link"):
        position, rotation = place(link.get("name"))
        poses[link.get("name")] = np.concatenate([position, rotation.as_quat()])
    return poses


def assert_poses_close(actual, expected, tolerance):
    """Compare poses in [m] and [rad]; q and -q are the same rotation."""
    np.testing.assert_allclose(actual[..., :3], expected[..., :3], atol=tolerance)
    difference = (
        Rotation.from_quat(np.atleast_2d(expected[..., 3:])).inv()
        * Rotation.from_quat(np.atleast_2d(actual[..., 3:]))
    ).as_rotvec()
    np.testing.assert_allclose(difference, 0.0, atol=tolerance)
