"""Where nothing moves by itself nothing needs a mass, and all begins within limits."""

from dataclasses import replace

import numpy as np
import pytest

from g1_description.gazebo.node import figures
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.urdf import parse_urdf

HIGH = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
BOX = '<collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision>'
MASS = (
    '<inertial><mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" '
    'ixz="0" iyz="0"/></inertial>'
)
LIMIT = '<axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="9" velocity="9"/>'


def arm(root="", middle="", tip=""):
    """A root, a middle and a tip, 1 m apart, with a wart fixed to the tip."""
    links = {"root": root, "middle": middle, "tip": tip, "wart": ""}
    bodies = "".join(f'<link name="{n}">{inside}</link>' for n, inside in links.items())
    ways = [("a", "revolute"), ("b", "revolute"), ("c", "fixed")]
    joints = "".join(
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{child}"/><origin xyz="1 0 0"/>{LIMIT}</joint>'
        for (name, kind), parent, child in zip(ways, links, [*links][1:])
    )
    return f'<robot name="r">{bodies}{joints}</robot>'


@pytest.mark.parametrize("inside", [{}, {"root": MASS, "tip": MASS}])
def test_links_without_mass_are_there_and_move(make_world, inside):
    world = make_world()
    world.spawn_urdf("m", arm(**inside), HIGH)
    assert world.model("m").link_names == ("root", "middle", "tip")
    report = world.set_joint_positions("m", {"a": 0.5 * np.pi, "b": 0.5})
    assert not report.unknown
    tip = world.link_state("tip")[0]
    np.testing.assert_allclose(tip[:3], [1, 1, 1], atol=1e-12)
    world.put("m", HIGH + np.eye(7)[0], np.zeros(6))
    np.testing.assert_allclose(world.link_state("tip")[0][:3], [2, 1, 1], atol=1e-12)
    world.reset()
    np.testing.assert_allclose(world.link_state("tip")[0][:3], [2, 0, 1], atol=1e-12)


@pytest.mark.parametrize(
    ("inside", "told"),
    [
        ({"root": MASS, "tip": MASS}, "middle has no mass and tip, wart are below it"),
        ({"root": MASS}, "middle, tip, wart have no mass"),
    ],
)
def test_one_warning_names_what_gazebo_would_leave_out(make_world, inside, told):
    (line,) = make_world().spawn_urdf("m", arm(**inside), HIGH)
    assert line.startswith(told) and line.endswith(": Gazebo would ignore them")


def test_at_the_start_no_mass_is_told_where_the_file_gives_none():
    some, none = (
        lump_fixed_joints(parse_urdf(text), is_dynamic=False)
        for text in (arm(root=MASS), arm())
    )
    assert (
        figures(some, "kinematic")
        == "2 joints, 3 links, 2.000 kg, kinematic, no profile"
    )
    assert figures(none, "kinematic") == "2 joints, 3 links, kinematic, no profile"


def test_where_things_move_they_vanish_as_in_gazebo(make_world):
    world = make_world("limp")
    world.spawn_urdf("m", arm(root=MASS, tip=MASS), HIGH)
    assert world.model("m").link_names == ("root",)
    world.spawn_urdf("none", arm(), HIGH)
    assert world.model("none").link_names == ()


def test_contacts_of_what_has_no_mass_are_found(make_world):
    world = make_world()
    world.spawn_urdf("m", arm(middle=BOX), HIGH * [1, 1, 0, 1, 1, 1, 1])
    assert world.engine.contacts() == {("ground_plane::link", "m::middle")}


CALF = arm(MASS, MASS, MASS).replace('lower="-2" upper="2"', 'lower="-2" upper="-0.5"')


def test_joints_that_cannot_be_at_zero_begin_inside_their_limits(make_world):
    world = make_world()
    told = world.spawn_urdf("m", CALF, HIGH)
    assert told == (
        "0 is outside the limits of some joints, which begin at the nearest limit: a "
        "at -0.5, b at -0.5",
    )
    begin = [-0.5, -0.5]
    np.testing.assert_array_equal(world.model("m").position, begin)
    world.set_joint_positions("m", {"a": -1.0})
    world.reset()
    np.testing.assert_array_equal(world.model("m").position, begin)


def test_a_pose_that_is_asked_for_wins(make_world):
    world = make_world()
    assembly = lump_fixed_joints(parse_urdf(CALF))
    world.spawn("m", replace(assembly, positions={"a": -1.0}), HIGH)
    np.testing.assert_array_equal(world.model("m").position, [-1.0, -0.5])


def test_where_things_move_joints_begin_at_zero_as_in_gazebo(make_world):
    world = make_world("limp")
    assert world.spawn_urdf("m", CALF, HIGH) == ()
    np.testing.assert_array_equal(world.model("m").position, [0.0, 0.0])
