"""What the <gazebo> elements of a URDF say is done as Gazebo does it."""

import numpy as np
import pytest
from robots import BOX, MASS, link, lump

from g1_description.importer.importing import massless_links
from g1_description.robot.joint_angles import measured_joints
from g1_description.robot.urdf import parse_urdf


def joint(name, parent, child, kind="fixed"):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{child}"/></joint>'
    )


def gazebo(inside, reference=None):
    named = f' reference="{reference}"' if reference else ""
    return f"<gazebo{named}>{inside}</gazebo>"


@pytest.mark.parametrize(
    ("blocks", "static"),
    [
        (gazebo("<static>true</static>"), True),
        (gazebo('<static value="1"/>'), True),
        (gazebo("<static>true</static>") + gazebo("<static>0</static>"), False),
        (gazebo("<static>true</static>", "a"), False),
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
        (gazebo(OFF, "a"), False),
        (gazebo("<gravity>0</gravity>", "a"), False),
        (gazebo(OFF, "a") + gazebo("<material/>", "a"), False),
        (gazebo(OFF, "a") + gazebo(ON, "a"), True),
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
        (gazebo(ON, "c") + gazebo(OFF, "a"), True),
        (gazebo(OFF, "c") + gazebo(ON, "d"), True),
    ],
)
def test_what_is_said_of_a_lumped_link_is_said_of_its_body(blocks, pulled):
    """After what is said of the body itself; from the body down, by joints' names."""
    links = [link(name) for name in "dcba"]
    joints = joint("1", "a", "b"), joint("2", "b", "c"), joint("3", "a", "d")
    (body,) = lump(*links, *joints, blocks).description.links
    assert (body.name, body.has_gravity) == ("a", pulled)


STAYS = "<disableFixedJointLumping>true</disableFixedJointLumping>"
FIXED = "<preserveFixedJoint>1</preserveFixedJoint>"
GOES = "<disableFixedJointLumping>false</disableFixedJointLumping>"


@pytest.mark.parametrize(
    ("blocks", "kind"),
    [
        (gazebo(STAYS, "ab"), "revolute"),
        (gazebo(FIXED, "ab"), "fixed"),
        (gazebo(FIXED, "ab") + gazebo(STAYS, "ab"), "fixed"),
    ],
)
def test_a_fixed_joint_is_kept_where_the_file_says_so(blocks, kind):
    """With what is fixed to its link, and what moves on that."""
    links = [link(name, MASS + BOX) for name in "abcd"]
    joints = joint("ab", "a", "b"), joint("bc", "b", "c")
    lumped = lump(*links, *joints, joint("cd", "c", "d", "continuous"), blocks)
    first, second = lumped.description.joints
    assert lumped.link_names == ("a", "b", "d")
    assert [shape.name for shape in lumped.description.links[1].collisions] == [
        "b_collision",
        "b_fixed_joint_lump__c_collision_1",
    ]
    assert (first.name, first.kind, second.parent) == ("ab", kind, "b")


@pytest.mark.parametrize("block", [gazebo(GOES, "ab"), gazebo(STAYS, "x")])
def test_other_fixed_joints_are_lumped(block):
    lumped = lump(link("a"), link("b"), joint("ab", "a", "b"), block)
    assert lumped.link_names == ("a",)


def test_a_joint_to_the_world_is_made_to_turn_too():
    parts = link("world", ""), link("a"), joint("wa", "world", "a")
    assert [j.kind for j in lump(*parts).description.joints] == ["fixed"]
    (only,) = lump(*parts, gazebo(STAYS, "wa")).description.joints
    assert (only.kind, only.parent) == ("revolute", "world")


def test_a_kept_joint_is_fixed_for_the_bridge():
    """It sees through it what the simulator has lumped all the same."""
    moving = joint("ab", "a", "b"), joint("bc", "b", "c", "continuous")
    text = "".join((*map(link, "abc"), *moving, gazebo(STAYS, "ab")))
    robot = parse_urdf(f'<robot name="r">{text}</robot>')
    measured = measured_joints(robot, ["a", "c"])
    assert (measured.names, measured.missing) == (("bc",), ())


def test_a_link_without_mass_on_a_kept_joint_is_left_out():
    """The mass of the body above is not its own."""
    parts = link("a"), link("b", ""), joint("ab", "a", "b"), gazebo(FIXED, "ab")
    assert lump(*parts).link_names == ("a",)
    assert lump(*parts).left_out == ("link b has no mass",)
    robot = parse_urdf(f'<robot name="r">{"".join(parts)}</robot>')
    assert massless_links(robot) == ([], ["b"])


@pytest.mark.parametrize(
    ("blocks", "own", "lumped"),
    [
        (gazebo("<mu1>0.3</mu1>", "a"), 0.3, None),
        (gazebo("<mu1>0.3</mu1>", "a") + gazebo("<mu1>2</mu1>", "a"), 2.0, None),
        (gazebo("<mu1>-1</mu1>", "a"), np.inf, None),
        (gazebo("<mu2>0.3</mu2>", "a"), None, None),
    ],
)
def test_mu1_is_the_friction_of_the_shapes_of_its_link(blocks, own, lumped):
    links = link("a", MASS + BOX * 2), link("b", BOX)
    (body,) = lump(*links, joint("ab", "a", "b"), blocks).description.links
    assert [shape.friction for shape in body.collisions] == [own, own, lumped]


@pytest.mark.parametrize(
    ("blocks", "clauses"),
    [
        (gazebo("<plugin/><sensor/>") + gazebo("<material>m</material>", "a"), ()),
        (gazebo("<selfCollide>false</selfCollide><laserRetro/>", "a"), ()),
        (gazebo("<mu1>0.5</mu1><mu2>0.7</mu2>", "a"), ("mu2",)),
        (gazebo("<kp>1</kp><kd>1</kd>", "a") + gazebo("<kp>2</kp>", "b"), ("kp, kd",)),
        (gazebo(STAYS, "a"), ("disableFixedJointLumping",)),
    ],
)
def test_what_is_not_simulated_is_named_once(blocks, clauses):
    lumped = lump(link("a"), link("b"), joint("ab", "a", "b"), blocks)
    begin = "unsupported <gazebo> elements: "
    assert lumped.left_out == tuple(begin + tags for tags in clauses)


@pytest.mark.parametrize(
    ("block", "clause"),
    [
        (
            gazebo("<static>maybe</static>"),
            "static is ignored: static must be true or false (got 'maybe')",
        ),
        (
            gazebo("<mu1>much</mu1>", "a"),
            "mu1 of a is ignored: The mu1 must be a number (got 'much')",
        ),
        (
            gazebo(OFF, "arm") + gazebo(OFF, "leg") + gazebo("<material/>", "eye"),
            "<gazebo> refers to an unknown link or joint: arm, leg",
        ),
    ],
)
def test_what_is_wrong_is_left_out_by_name(block, clause):
    """The robot is as it is without."""
    lumped = lump(link("a", MASS + BOX), block)
    (body,) = lumped.description.links
    assert lumped.left_out == (clause,)
    assert not lumped.static
    assert body.has_gravity
    assert body.collisions[0].friction is None
