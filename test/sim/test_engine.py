"""The contract of ``Engine``, with each engine, against mechanics."""

import math
from dataclasses import replace

import numpy as np
import pytest
from worlds import OUR_G1

from g1_description.motion.motors import Motors, PdMotor, ServoMotor
from g1_description.robot.kinematics import Kinematics
from g1_description.sim.drives import PdCommand

pytestmark = pytest.mark.both_engines

NOWHERE = (0.0, 0.0, 0.0)
UP = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
TILTED = np.array([0.5, -0.2, 3.0, 0.0, 0.6, 0.0, 0.8])
MASS, EFFORT = 2.0, 3.0
ROBOT = f"""<robot name="robot"><link name="base"><inertial>
<origin xyz="0.1 0.02 -0.03"/><mass value="{MASS}"/><inertia ixx="0.03" iyy="0.03"
izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial><collision><geometry>
<box size="0.2 0.2 0.2"/></geometry></collision></link></robot>"""
INERTIA = 0.01 + 1.0 * 0.5**2
ARM = f"""<robot name="arm"><link name="world"/><link name="mount"><inertial>
<mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
</link><link name="bob"><inertial><origin xyz="0 0 -0.5"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="anchor" type="fixed"><parent link="world"/><child link="mount"/></joint>
<joint name="swing" type="revolute"><parent link="mount"/><child link="bob"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="{EFFORT}" velocity="50"/></joint>
</robot>"""


@pytest.fixture
def body(make_world):
    """Give a world without gravity, and a free body in it."""
    world = make_world("limp", gravity=NOWHERE)
    world.spawn_urdf("body", ROBOT, UP)
    return world, world.model("body")


def arm(make_world, physics="limp", motor=None, gravity=NOWHERE):
    """Give a world, and an arm on a hinge in it."""
    world = make_world(physics, gravity, motors=Motors({".*": motor or ServoMotor()}))
    world.spawn_urdf("arm", ARM, UP)
    return world, world.model("arm")


def command(position=0.0, stiffness=0.0, damping=0.0, effort=0.0):
    numbers = position, 0.0, stiffness, damping, effort
    return PdCommand(*(np.array([number]) for number in numbers))


def push(world, model, force):
    world.engine.apply_wrench(model, "base", np.array([*force, 0.0, 0.0, 0.0]))


def test_a_base_is_where_it_was_set_and_moves_on_as_set(body):
    world, model = body
    twist = np.array([0.3, -0.2, 0.1, 0.0, 0.0, 0.0])
    world.put("body", TILTED, twist)
    np.testing.assert_allclose(model.pose, TILTED, atol=1e-12)
    world.run(0.1)
    np.testing.assert_allclose(model.pose[:3], TILTED[:3] + 0.1 * twist[:3], atol=1e-6)
    np.testing.assert_allclose(model.twist, twist, atol=1e-6)


@pytest.mark.parametrize("physics", ["hold", "limp"])
def test_joints_are_where_they_were_set_and_stand_still(make_world, physics):
    world, model = arm(make_world, physics)
    world.engine.apply_effort(model, 0, 1.0)
    world.run(0.01)
    assert world.set_joint_positions("arm", {"swing": 0.7}).changed == [0]
    assert (model.position[0], model.velocity[0]) == (0.7, 0.0)
    world.run(0.1)
    assert model.position[0] == pytest.approx(0.7, abs=1e-6)


def test_a_wrench_acts_at_the_center_of_mass_for_one_step(body):
    world, model = body
    for _ in range(2):
        push(world, model, [0.0, 2.0, 4.0])
        world.step()
    world.run(0.01)
    np.testing.assert_allclose(model.twist, [0, 2e-3, 4e-3, 0, 0, 0], atol=1e-9)


def test_an_effort_acts_for_one_step(make_world):
    world, model = arm(make_world)
    world.engine.apply_effort(model, 0, 1.3)
    world.run(0.01)
    assert model.velocity[0] == pytest.approx(1e-3 * 1.3 / INERTIA, rel=1e-3)


def test_a_motor_holds_and_follows_targets_within_its_limit(make_world):
    world, model = arm(make_world, "hold", PdMotor(200.0, 1e5, 0.0))
    world.engine.follow(model, np.array([0]), np.ones(1), np.zeros(1))
    world.run(0.05)
    assert world.engine.effort_limits(model)[0] == EFFORT
    assert world.engine.efforts(model)[0] == EFFORT
    assert model.velocity[0] == pytest.approx(0.05 * EFFORT / INERTIA, rel=1e-3)


def test_a_controller_drives_the_joint_until_it_gets_a_target(make_world):
    world, model = arm(make_world, "hold")
    both = PdCommand(*np.zeros((4, 2)), np.array([1.0, 7.0]))
    assert world.drive(model, ["swing", "wing"], both) == ["wing"]
    world.run(0.1)
    assert model.velocity[0] == pytest.approx(0.1 * 1.0 / INERTIA, rel=0.01)
    world.drive(model, ["swing"], command(0.2, 60.0, 8.0))
    world.run(2.0)
    assert model.position[0] == pytest.approx(0.2, abs=1e-3)
    world.set_joint_positions("arm", {"swing": -0.2})
    world.run(0.2)
    assert model.position[0] == pytest.approx(-0.2, abs=1e-6)
    assert world.engine.efforts(model)[0] == pytest.approx(0.0, abs=1e-3)


def test_damping_and_stops_of_a_joint_take_effect(make_world):
    world, model = arm(make_world)
    joint = world.entities.joint("swing")
    world.set_joint_properties(joint, {"damping": 0.26})
    world.engine.apply_effort(model, 0, 300.0)
    world.step()
    start = model.velocity[0]
    world.run(0.5)
    assert model.velocity[0] == pytest.approx(start * math.exp(-0.5), rel=2e-3)
    world.set_joint_properties(joint, {"damping": 0.0, "hiStop": 1.5})
    world.run(2.0)
    assert model.position[0] == pytest.approx(1.5, abs=0.05)


def test_gravity_and_the_time_step_change_at_once_and_spare_some_links(body):
    world, model = body
    world.spawn_urdf("floats", ROBOT, TILTED)
    link = world.entities.link("floats::base")
    world.set_link_properties(link, link.link.inertial, False)
    world.change(gravity_z=4.0, gravity_x=1.0, time_step=0.004)
    world.step()
    assert world.time_ns == 4_000_000
    np.testing.assert_allclose(model.twist[:3], [0.004, 0, 0.016], atol=1e-9)
    world.run(0.1)
    np.testing.assert_allclose(world.model("floats").pose, TILTED, atol=1e-9)


def test_links_that_touch_are_found_where_they_are_now(body):
    world, _ = body
    assert world.engine.contacts() == set()
    world.put("body", UP * [1, 1, 0.05, 1, 1, 1, 1], np.zeros(6))
    assert world.engine.contacts() == {("body::base", "ground_plane::link")}
    world.spawn_urdf("second", ROBOT, UP * [1, 1, 0.2, 1, 1, 1, 1])
    world.delete("ground_plane")
    assert world.engine.contacts() == {("body::base", "second::base")}
    world.delete("second")
    assert world.engine.contacts() == set()
    world.delete("body")
    world.step()


def test_a_model_with_another_mass_moves_as_such_and_others_go_on(body):
    world, model = body
    world.spawn_urdf("second", ROBOT, TILTED)
    world.put("second", TILTED, np.array([1.0, 0, 0, 0, 0, 0]))
    link = world.entities.link("body::base")
    heavy = replace(link.link.inertial, mass=20.0)
    world.set_link_properties(link, heavy, True)
    push(world, model, [0.0, 0.0, 2.0])
    world.step()
    assert model.twist[2] == pytest.approx(1e-3 * 2.0 / 20.0, abs=1e-9)
    assert world.model("second").twist[0] == pytest.approx(1.0, abs=1e-6)


def test_after_a_reset_the_same_happens_to_the_bit(make_world):
    world, model = arm(make_world, "hold", gravity=(0.0, 0.0, -9.8))
    runs = []
    for _ in range(2):
        world.drive(model, ["swing"], command(effort=1.0))
        world.run(0.05)
        runs.append((model.position[0], model.velocity[0]))
        world.reset()
        assert (model.position[0], model.velocity[0]) == (0.0, 0.0)
    assert runs[0] == runs[1]


def test_a_step_that_fails_is_undone_and_told_once(make_world, engine):
    if engine == "bullet":
        pytest.skip("PyBullet does not say that a step failed")
    world, model = arm(make_world, "hold")
    world.set_joint_positions("arm", {"swing": 0.5})
    world.run(0.1)
    for effort in (1e15, np.nan):
        before = model.position[0]
        world.engine.apply_effort(model, 0, effort)
        world.step()
        assert (model.position[0], model.velocity[0]) == (before, 0.0)
        assert np.isfinite(world.engine.efforts(model)).all()
        assert "all models are at rest" in world.engine.take_failure()
        assert world.engine.take_failure() == ""
    world.run(0.1)
    assert model.position[0] == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize("fixed", [False, True])
def test_links_are_where_kinematics_puts_them(make_world, fixed):
    """Among other models, while all of them move."""
    world = make_world("limp")
    for name in ("other", "g1"):
        world.spawn_urdf(name, OUR_G1, TILTED, fixed)
        world.put(name, TILTED + 0.1 * len(name) * np.eye(7)[0], np.ones(6))
    world.run(0.05)
    model = world.model("g1")
    robot = model.assembly.description
    state = model.root_poses, model.position, model.root_twists, model.velocity
    poses, twists = Kinematics(robot).link_states(*state)
    rows = [robot.link_names.index(name) for name in model.link_names]
    turns = np.sign((poses[rows, 3:] * model.poses[:, 3:]).sum(axis=1))
    expected = poses[rows] * np.c_[np.ones((len(rows), 3)), np.tile(turns, (4, 1)).T]
    np.testing.assert_allclose(model.poses, expected, atol=1e-12)
    np.testing.assert_allclose(model.twists, twists[rows], atol=1e-11)
    assert np.abs(model.velocity).max() > 0.1
