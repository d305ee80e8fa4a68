"""A link is set along the joint that it hangs on, as near as that goes."""

import numpy as np
import pytest
from conftest import REPOSITORY
from scipy.spatial.transform import Rotation

from g1_description.errors import InvalidValueError

INERTIAL = """<inertial><origin xyz="{}"/><mass value="1"/><inertia ixx="0.1" iyy="0.1"
izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>"""
CART_POLE = f"""<robot name="cart_pole"><link name="world"/>
<link name="cart">{INERTIAL.format("0 0 0")}</link>
<link name="pole">{INERTIAL.format("0 0 0.5")}</link>
<joint name="slider" type="prismatic"><parent link="world"/><child link="cart"/>
<axis xyz="1 0 0"/><limit lower="-2.4" upper="2.4" effort="10" velocity="10"/></joint>
<joint name="hinge" type="continuous"><parent link="cart"/><child link="pole"/>
<axis xyz="0 1 0"/></joint></robot>"""
PENDULUM = f"""<robot name="pendulum">
<link name="base">{INERTIAL.format("0 0 0")}</link>
<link name="bob">{INERTIAL.format("0 0 0.5")}</link>
<joint name="pivot" type="revolute"><origin xyz="0.5 0 0.25" rpy="0.1 0.2 0.3"/>
<parent link="base"/><child link="bob"/><axis xyz="0 0.6 0.8"/>
<limit lower="-1" upper="2" effort="10" velocity="10"/></joint></robot>"""
ORIGIN = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
STILL = np.zeros(6)


def positions(world, name):
    model = world.model(name)
    return dict(zip(model.joint_names, model.position))


def velocities(world, name):
    model = world.model(name)
    return dict(zip(model.joint_names, model.velocity))


def put(world, link, pose, twist=STILL):
    return world.set_link_state(world.entities.link(link), np.array(pose), twist)


@pytest.mark.parametrize("physics", ["kinematic", "hold"])
def test_a_cart_and_its_pole_begin_again_as_in_gym_gazebo(make_world, physics):
    """First the pole is put to the origin, which the cart keeps from it, then that."""
    world = make_world(physics)
    world.spawn_urdf("cart_pole", CART_POLE, ORIGIN)
    world.set_joint_positions("cart_pole", {"slider": 1.5, "hinge": 0.5})
    first = put(world, "pole", ORIGIN)
    assert first == ("hinge", pytest.approx(1.5), pytest.approx(0.0, abs=1e-9))
    assert positions(world, "cart_pole") == {"slider": 1.5, "hinge": 0.0}
    second = put(world, "cart", ORIGIN)
    assert second == ("slider", 0.0, 0.0)
    for link in ("cart", "pole"):
        np.testing.assert_array_equal(world.link_state(link)[0], ORIGIN)
    if physics == "hold":
        world.run(0.1)
        expected = {"slider": pytest.approx(0.0), "hinge": pytest.approx(0.0)}
        assert positions(world, "cart_pole") == expected


def test_a_joint_keeps_within_its_limits_and_turns_from_the_orientation(make_world):
    world = make_world("kinematic")
    tilted = Rotation.from_rotvec([0.2, -0.4, 0.9])
    base = np.array([1.0, 2.0, 3.0, *tilted.as_quat()])
    world.spawn_urdf("pendulum", PENDULUM, base)
    world.set_joint_positions("pendulum", {"pivot": 1.25})
    there, _ = world.link_state("bob")
    for position, left in ((1.25, 0.0), (3.0, 1.0), (-1.5, 0.5)):
        world.set_joint_positions("pendulum", {"pivot": 0.0})
        turn = Rotation.from_rotvec((position - 1.25) * np.array([0.0, 0.6, 0.8]))
        asked = np.array(there)
        asked[3:] = (Rotation.from_quat(there[3:]) * turn).as_quat()
        placed = put(world, "bob", asked)
        expected = pytest.approx(np.clip(position, -1.0, 2.0))
        assert positions(world, "pendulum") == {"pivot": expected}
        assert placed[1:] == (
            pytest.approx(0.0, abs=1e-9),
            pytest.approx(left, abs=1e-7),
        )
        np.testing.assert_array_equal(world.link_state("base")[0], base)


def test_a_joint_takes_the_velocity_along_its_axis(make_world):
    world = make_world("limp", gravity=(0.0, 0.0, 0.0))
    world.spawn_urdf("cart_pole", CART_POLE, ORIGIN)
    put(world, "cart", ORIGIN, np.array([0.5, 7.0, 0.0, 0.0, 0.0, 0.0]))
    assert velocities(world, "cart_pole") == {"slider": 0.5, "hinge": 0.0}
    twist = np.array([0.0, 0.0, 0.0, 0.0, 0.25, 3.0])
    put(world, "pole", world.link_state("pole")[0], twist)
    expected = {"slider": 0.5, "hinge": pytest.approx(0.25)}
    assert velocities(world, "cart_pole") == expected
    world.run(0.1)
    assert positions(world, "cart_pole")["hinge"] == pytest.approx(0.025, rel=0.2)


def test_a_root_takes_its_model_along_and_what_is_fixed_stays(make_world):
    world = make_world("kinematic")
    world.spawn_urdf("pendulum", PENDULUM, ORIGIN)
    before, _ = world.link_state("bob", "base")
    assert put(world, "base", [1.0, 2.0, 3.0, 0.0, 0.0, 1.0, 0.0]) is None
    np.testing.assert_allclose(world.link_state("bob", "base")[0], before, atol=1e-15)
    text = """<sdf version="1.7"><model name="post">
    <link name="foot"/><link name="top"/>
    <joint name="weld" type="fixed"><parent>foot</parent><child>top</child></joint>
    </model></sdf>"""
    world.spawn_sdf("post", text, ORIGIN)
    with pytest.raises(InvalidValueError, match="top of post is fixed to foot by weld"):
        put(world, "top", [0.0, 0.0, 5.0, 0.0, 0.0, 0.0, 1.0])


def test_a_joint_of_a_model_with_a_free_body_is_set(make_world):
    """Kinematics of one tree know nothing of the other's links."""
    world = make_world("limp")
    text = (REPOSITORY / "test" / "data" / "free_bodies.urdf").read_text()
    world.spawn_urdf("m", text, ORIGIN)
    model = world.model("m")
    world.set_joint_positions("m", {"elbow": 0.4})
    wanted, puck = np.array(model.poses[1]), np.array(model.poses[2])
    world.set_joint_positions("m", {"elbow": 0.0})
    assert put(world, "arm", wanted).joint == "elbow"
    np.testing.assert_allclose(model.position, [0.4], atol=1e-12)
    np.testing.assert_array_equal(model.poses[2], puck)
