"""What the <gazebo> elements of a URDF say is done as Gazebo does it."""

import pytest

from g1_description.core.lumping import lump_fixed_joints
from g1_description.core.urdf import parse_urdf

MASS = (
    '<inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" '
    'iyz="0"/></inertial>'
)


def link(name, inside=MASS):
    return f'<link name="{name}">{inside}</link>'


def joint(name, parent, child, kind="fixed"):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{child}"/></joint>'
    )


def gazebo(inside, reference=None):
    named = f' reference="{reference}"' if reference else ""
    return f"<gazebo{named}>{inside}</gazebo>"


def lump(*parts, is_dynamic=True):
    robot = parse_urdf(f'<robot name="r">{"".join(parts)}</robot>')
    return lump_fixed_joints(robot, is_dynamic)


@pytest.mark.parametrize(
    ("blocks", "static"),
    [
        (gazebo("<static>true</static>"), True),
        (gazebo("<static> Yes </static>"), True),
        (gazebo('<static value="1"/>'), True),
        (gazebo("<static>false</static>"), False),
        (gazebo("<static>true</static>") + gazebo("<static>0</static>"), False),
        (gazebo("<static>true</static>") + gazebo("<plugin/>"), True),
        (gazebo("<static>true</static>", "a"), False),
        ("<static>true</static>", False),
    ],
)
def test_a_robot_is_static_where_its_file_says_so_last(blocks, static):
    assert lump(link("a"), blocks).static is static


def test_the_joints_of_a_static_robot_hold_still():
    static = gazebo("<static>true</static>")
    links = [link(name) for name in "abcd"]
    turns = joint("ab", "a", "b", "continuous")
    lumped = lump(
        static, *links, turns, joint("bc", "b", "c"), joint("ad", "a", "d", "floating")
    )
    assert lumped.link_names == ("a", "b", "d")
    assert [(j.name, j.kind, j.listed) for j in lumped.description.joints] == [
        ("ab", "fixed", True),
        ("ad", "fixed", False),
    ]
    assert len(lumped.description.trees) == 1
    assert lumped.left_out == ()


OFF = "<turnGravityOff>true</turnGravityOff>"
ON = "<turnGravityOff>false</turnGravityOff>"


@pytest.mark.parametrize(
    ("blocks", "pulled"),
    [
        ("", True),
        (gazebo(OFF, "a"), False),
        (gazebo("<turnGravityOff value='yes'/>", "a"), False),
        (gazebo("<gravity>0</gravity>", "a"), False),
        (gazebo("<gravity>false</gravity>", "a"), False),
        (gazebo("<gravity>true</gravity>", "a"), True),
        (gazebo(OFF, "a") + gazebo("<material/>", "a"), False),
        (gazebo(OFF, "a") + gazebo(ON, "a"), True),
        (gazebo(ON, "a") + gazebo(OFF, "a"), False),
        (gazebo(OFF, "b") + gazebo(OFF), True),
    ],
)
def test_a_link_has_no_gravity_where_the_file_says_so_last(blocks, pulled):
    turns = joint("ab", "a", "b", "continuous")
    first, _ = lump(link("a"), link("b"), turns, blocks).description.links
    assert first.has_gravity is pulled


@pytest.mark.parametrize(
    ("blocks", "pulled"),
    [
        (gazebo(OFF, "c"), False),
        (gazebo(OFF, "c") + gazebo(ON, "a"), False),
        (gazebo(ON, "c") + gazebo(OFF, "a"), True),
        (gazebo(OFF, "c") + gazebo(ON, "b"), False),
        (gazebo(OFF, "c") + gazebo(ON, "d"), True),
    ],
)
def test_what_is_said_of_a_lumped_link_is_said_of_its_body(blocks, pulled):
    """After what is said of the body itself; from the body down, by joints' names."""
    links = [link(name) for name in "dcba"]
    joints = joint("1", "a", "b"), joint("2", "b", "c"), joint("3", "a", "d")
    (body,) = lump(*links, *joints, blocks).description.links
    assert (body.name, body.has_gravity) == ("a", pulled)
