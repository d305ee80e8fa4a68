"""Makers of robots."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.urdf import parse_urdf

BASE = np.array([0.0, 0.0, 0.7634, 0.0, 0.0, 0.0, 1.0])
"""Pose of the G1's base in which it stands in the pose ``stand``."""

_NUMBER = st.floats(-3.0, 3.0).map(lambda value: round(value, 6))
_VECTOR = st.tuples(_NUMBER, _NUMBER, _NUMBER)
_AXIS = _VECTOR.filter(lambda axis: np.linalg.norm(axis) > 0.1)
_KIND = st.sampled_from(["revolute", "continuous", "prismatic", "fixed"])


MASS = (
    '<inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" '
    'iyz="0"/></inertial>'
)
BOX = '<collision><geometry><box size="1 1 1"/></geometry></collision>'


SLIDER = """
<robot name="slider">
  <link name="rail"/><link name="cart"/>
  <joint name="x" type="prismatic">
    <parent link="rail"/><child link="cart"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="0.5"/>
  </joint>
</robot>
"""


def link(name, inside=MASS):
    """Write a link of a URDF, with mass."""
    return f'<link name="{name}">{inside}</link>'


def lump(*parts, is_dynamic=True):
    """Make what a simulator builds of a URDF's links and joints."""
    robot = parse_urdf(f'<robot name="r">{"".join(parts)}</robot>')
    return lump_fixed_joints(robot, is_dynamic)


def _text(vector):
    return " ".join(repr(float(value)) for value in vector)


def robot(*links):
    """Make a chain of continuous joints."""
    joints = "".join(
        f'<joint name="to_{child}" type="continuous"><parent link="{parent}"/>'
        f'<child link="{child}"/><axis xyz="0 0 1"/></joint>'
        for parent, child in zip(links, links[1:])
    )
    bodies = "".join(f'<link name="{link}"/>' for link in links)
    return parse_urdf(f'<robot name="r">{bodies}{joints}</robot>')


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
