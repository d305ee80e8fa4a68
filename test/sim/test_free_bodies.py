"""What no joint holds moves on its own, and is still part of its model."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.transform import compose
from g1_description.robot.urdf import parse_urdf
from g1_description.sim.forces import Span
from g1_description.sim.standing import hanging_height, standing_height

ONE = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
TILTED = np.array([0.5, -0.2, 2.0, 0.0, 0.6, 0.0, 0.8])
HIGH = np.array([0.0, 0.0, 50.0, 0.0, 0.0, 0.0, 1.0])
STILL = np.zeros(6)
MS = 1_000_000
MASS = (
    '<inertial><mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" '
    'ixz="0" iyz="0"/></inertial>'
)
BOX = f'{MASS}<collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision>'


def link(name, inside=BOX):
    return f'<link name="{name}">{inside}</link>'


def joint(name, kind, parent, child, xyz="0 0 0", rpy="0 0 0"):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{child}"/><origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="0 0 1"/>'
        '<limit lower="-2" upper="2" effort="9" velocity="9"/></joint>'
    )


def robot(*parts):
    return f'<robot name="r">{"".join(parts)}</robot>'


TWO = robot(
    link("puck"),
    link("base"),
    link("arm"),
    link("knob"),
    joint("turn", "revolute", "base", "arm", "1 0 0"),
    joint("free", "floating", "arm", "puck", "0 1 0", "0 0 1.5707963267948966"),
    joint("grip", "prismatic", "puck", "knob", "0 0 0.5"),
)
"""A puck with a knob that floats above an arm; the file begins with it."""

FLYING = robot(
    link("world", ""),
    link("base"),
    link("arm"),
    joint("floating_base_joint", "floating", "world", "base", "0 0 1"),
    joint("turn", "revolute", "base", "arm", "1 0 0"),
)
"""As the vendors' files for MuJoCo."""


def link_pose(world, name):
    return world.link_state(name)[0]


def test_the_links_stand_in_the_order_of_the_file_where_it_has_them(make_world):
    world = make_world()
    world.spawn_urdf("m", TWO, TILTED)
    assert world.link_names[1:] == ("m::puck", "m::base", "m::arm", "m::knob")
    half = np.sqrt(0.5)
    expected = {
        "base": ONE,
        "arm": [1, 0, 0, 0, 0, 0, 1],
        "puck": [1, 1, 0, 0, 0, half, half],
        "knob": [1, 1, 0.5, 0, 0, half, half],
    }
    for name, pose in expected.items():
        found = link_pose(world, f"m::{name}")
        np.testing.assert_allclose(found, compose(TILTED, np.array(pose)), atol=1e-15)
    model = world.model("m")
    assert model.joint_names == ("turn", "grip")


@pytest.mark.both_engines
@pytest.mark.parametrize("physics", ["kinematic", "hold"])
def test_a_joint_moves_only_what_it_holds(make_world, physics):
    world = make_world(physics, gravity=(0.0, 0.0, 0.0))
    world.spawn_urdf("m", TWO, TILTED)
    before = {name: link_pose(world, name) for name in ("base", "puck")}
    world.set_joint_positions("m", {"turn": 1.0, "grip": 0.25})
    for _ in range(20):
        world.step()
    for name, pose in before.items():
        np.testing.assert_allclose(link_pose(world, name), pose, atol=2e-3)
    knob = world.link_state("knob", "puck")[0]
    assert knob[2] == pytest.approx(0.75, abs=1e-3)
    turned = world.link_state("arm", "base")[0]
    np.testing.assert_allclose(turned[5:], [np.sin(0.5), np.cos(0.5)], atol=1e-3)


@pytest.mark.both_engines
def test_all_falls_and_what_is_fixed_does_not(make_world):
    """Free fall: half g t squared, for each tree alike."""
    world = make_world("limp")
    world.spawn_urdf("falls", TWO, HIGH)
    beside = np.array([0.0, 9.0, 50.0, 0.0, 0.0, 0.0, 1.0])
    world.spawn_urdf("held", TWO, beside, fixed_base=True)
    world.run(0.5)
    for name in ("falls::base", "falls::puck", "held::puck"):
        pose, twist = world.link_state(name)
        assert pose[2] == pytest.approx(50.0 - 0.5 * 9.8 * 0.25, abs=0.01)
        assert twist[2] == pytest.approx(-4.9, abs=0.01)
    assert link_pose(world, "held::base")[2] == 50.0


@pytest.mark.both_engines
def test_links_of_one_model_pass_through_each_other_and_others_do_not(make_world):
    world = make_world("limp")
    ball = link("ball", BOX)
    above = robot(link("a"), ball, joint("free", "floating", "a", "ball", "0 0 0.5"))
    at = np.array([0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0])
    world.spawn_urdf("one", above, at)
    world.run(1.5)
    assert link_pose(world, "one::ball")[2] == pytest.approx(0.1, abs=0.01)
    assert ("ground_plane::link", "one::ball") in world.engine.contacts()
    assert ("one::a", "one::ball") not in world.engine.contacts()


@pytest.mark.both_engines
def test_of_many_models_each_touches_all_others_and_the_ground(make_world):
    """MuJoCo has 32 bits for that."""
    world = make_world("limp")
    two = robot(link("a"), link("b"), joint("turn", "revolute", "a", "b"))
    for number in range(31):
        world.spawn_urdf(f"two{number}", two, ONE)
    world.spawn_urdf("one", robot(link("a")), ONE)
    names = [*(f"two{number}::{end}" for number in range(31) for end in "ab"), "one::a"]
    expected = {
        tuple(sorted(pair))
        for pair in combinations([*names, "ground_plane::link"], 2)
        if pair[0].split("::")[0] != pair[1].split("::")[0]
    }
    assert world.engine.contacts() == expected


@pytest.mark.parametrize("physics", ["kinematic", "limp"])
def test_a_model_is_moved_with_all_that_is_free_in_it(make_world, physics):
    world = make_world(physics, gravity=(0.0, 0.0, 0.0))
    world.spawn_urdf("m", TWO, ONE)
    world.set_root_state(world.model("m"), TILTED, STILL, 1)
    seen = world.link_state("puck", "base")[0]
    world.put("m", TILTED, np.array([0.1, 0, 0, 0, 0, 0.3]))
    np.testing.assert_allclose(world.link_state("puck", "base")[0], seen, atol=1e-12)
    np.testing.assert_allclose(world.model_state("m")[0], TILTED, atol=1e-12)
    world.step()
    moved = physics == "limp"
    for name in ("base", "puck", "knob"):
        assert world.link_state(name)[1].any() == moved


@pytest.mark.both_engines
def test_one_free_body_is_set_and_the_others_stay(make_world):
    world = make_world("limp", gravity=(0.0, 0.0, 0.0))
    world.spawn_urdf("m", TWO, HIGH)
    base, puck = link_pose(world, "base"), world.entities.link("puck")
    assert not world.set_link_state(puck, TILTED, np.array([0, 0, 1.0, 0, 0, 0]))
    np.testing.assert_allclose(link_pose(world, "puck"), TILTED, atol=1e-12)
    np.testing.assert_array_equal(link_pose(world, "base"), base)
    world.step()
    assert world.link_state("knob")[1][2] == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_allclose(link_pose(world, "base"), base, atol=1e-9)


@pytest.mark.both_engines
def test_resets_bring_free_bodies_back_and_the_same_again(make_world):
    world = make_world("limp")
    world.spawn_urdf("m", TWO, TILTED)
    begin = {name: link_pose(world, name) for name in world.link_names}
    world.run(0.3)
    first = world.link_states()
    world.reset_models()
    for name in ("m::base", "m::puck"):
        np.testing.assert_allclose(link_pose(world, name), begin[name], atol=1e-12)
        assert not world.link_state(name)[1].any()
    world.reset()
    for name, pose in begin.items():
        np.testing.assert_array_equal(link_pose(world, name), pose)
    world.run(0.3)
    for again, before in zip(world.link_states(), first):
        np.testing.assert_array_equal(again, before)


@pytest.mark.both_engines
def test_pushes_efforts_masses_and_deletion_find_the_right_body(make_world):
    world = make_world("limp", gravity=(0.0, 0.0, 0.0))
    world.spawn_urdf("m", TWO, TILTED)
    knob, now = world.entities.link("knob"), Span(0, MS)
    world.forces.apply_wrench(knob, now, np.array([0, 0, 4000.0, 0, 0, 0]), 0)
    world.step()
    assert world.link_state("puck")[1][:3].any()
    assert not world.link_state("base")[1].any()
    world.put("m", TILTED, STILL)
    world.forces.apply_effort(world.entities.joint("turn"), Span(MS, 2 * MS), 1.0)
    world.step()
    assert world.link_state("base")[1].any()
    assert not world.link_state("puck")[1].any()
    entity = world.entities.link("puck")
    heavy = replace(entity.link.inertial, mass=9.0)
    world.set_link_properties(entity, heavy, False)
    assert world.entities.link("puck").link.inertial.mass == 9.0
    world.step()
    bodies = world.client.getNumBodies()
    world.delete("m")
    assert world.client.getNumBodies() == bodies - 2


@pytest.mark.both_engines
def test_below_the_world_the_base_is_free(make_world):
    world = make_world("limp")
    world.spawn_urdf("m", FLYING, np.array([0, 0, 20.0, 0, 0, 0, 1]))
    model = world.model("m")
    assert model.link_names == ("base", "arm")
    assert model.joint_names == ("turn",)
    assert link_pose(world, "base")[2] == 21.0
    world.run(0.5)
    assert link_pose(world, "base")[2] < 20.0
    np.testing.assert_allclose(world.model_state("m")[0][2] + 1, model.poses[0, 2])


def test_the_free_joints_are_told():
    assert lump_fixed_joints(parse_urdf(TWO)).left_out == (
        "joint free is floating, puck is free",
    )
    planar = TWO.replace("floating", "planar")
    assert lump_fixed_joints(parse_urdf(planar)).left_out == (
        "joint free is planar, puck is free",
    )


def test_it_stands_on_the_lowest_and_only_the_base_hangs():
    low = TWO.replace('xyz="0 1 0"', 'xyz="0 1 -0.4"')
    assembly = lump_fixed_joints(parse_urdf(low))
    assert standing_height(assembly, ONE[3:]) == 0.501
    assert hanging_height(assembly, ONE[3:]) < 2.0


SDF = """<sdf version="1.6"><model name="m">
  <link name="table"><pose>0 0 0.5 0 0 0</pose>
    <collision name="c"><geometry><box><size>1 1 0.2</size></box></geometry>
    </collision></link>
  <link name="ball"><pose>0.3 0 5 0 0 0</pose>
    <collision name="c"><geometry><sphere><radius>0.1</radius></sphere></geometry>
    </collision></link>
  <model name="cup"><pose>-0.3 0 0.75 0 0 0</pose><link name="link">
    <collision name="c"><geometry><box><size>0.1 0.1 0.1</size></box></geometry>
    </collision></link></model>
  JOINT
</model></sdf>"""
TO_WORLD = """<joint name="j" type="fixed"><parent>world</parent>
  <child>table</child></joint>"""


def test_sdf_links_that_nothing_joins_are_free(make_world):
    world = make_world("limp")
    world.spawn_sdf("m", SDF.replace("JOINT", TO_WORLD), ONE)
    assert world.link_names[1:] == ("m::table", "m::ball", "m::cup::link")
    assert link_pose(world, "m::ball")[2] == 5.0
    world.run(2.0)
    assert link_pose(world, "m::table")[2] == 0.5
    # Links of one model pass through each other, those of models inside it do not.
    assert link_pose(world, "m::ball")[2] == pytest.approx(0.1, abs=0.01)
    assert link_pose(world, "m::cup::link")[2] == pytest.approx(0.65, abs=0.01)


@pytest.mark.parametrize("spin", [20.0, 100.0, 300.0])
def test_a_free_body_keeps_its_angular_momentum(make_world, spin):
    """It wobbles, as it turns about none of its principal axes."""
    world = make_world("limp", gravity=(0.0, 0.0, 0.0), engine="mujoco")
    inertia = np.array([0.1, 0.2, 0.25])
    axes = {"ixx": 0.1, "iyy": 0.2, "izz": 0.25, "ixy": 0, "ixz": 0, "iyz": 0}
    numbers = " ".join(f'{name}="{value}"' for name, value in axes.items())
    body = f'<inertial><mass value="2"/><inertia {numbers}/></inertial>'
    world.spawn_urdf("body", f'<robot name="body">{link("body", body)}</robot>', HIGH)
    model, turn = world.model("body"), np.array([0.97, 0.2, 0.1])
    world.put("body", HIGH, np.array([0.0, 0.0, 0.0, *spin * turn]))
    world.run(1.0)
    R_world_body = Rotation.from_quat(model.pose[3:])
    spin_now = R_world_body.inv().apply(model.twist[3:])
    momentum = R_world_body.apply(inertia * spin_now)
    np.testing.assert_allclose(momentum / spin, inertia * turn, atol=0.02)
