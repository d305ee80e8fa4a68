"""A world in which all stands still rests, and whatever is written ends that."""

from dataclasses import replace

import numpy as np
import pytest
from worlds import Bench

from g1_description.sim.forces import Span
from g1_description.sim.moving_models import REST_SPEED

INERTIA = '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>'
MASS = f'<inertial><mass value="1"/>{INERTIA}</inertial>'


def on_a_joint(kind, axis, center="0 0 0"):
    """Make a body of 1 kg on a joint to the world."""
    return f"""<robot name="r"><link name="world"/><link name="mount">{MASS}</link>
    <link name="body"><inertial><origin xyz="{center}"/><mass value="1"/>{INERTIA}
    </inertial></link><joint name="anchor" type="fixed">
    <parent link="world"/><child link="mount"/></joint>
    <joint name="joint" type="{kind}"><parent link="mount"/><child link="body"/>
    <axis xyz="{axis}"/><limit lower="0" upper="9" effort="99" velocity="9"/></joint>
    </robot>"""


LIFT = on_a_joint("prismatic", "0 0 1")
PENDULUM = on_a_joint("continuous", "0 1 0", "0 0 -0.5")
BOX = f"""<robot name="box"><link name="box">{MASS}
<collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision></link></robot>"""
BODY = f'<robot name="body"><link name="body">{MASS}</link></robot>'


def above(height, x=0.0):
    return np.array([x, 0.0, 0.1 + height, 0.0, 0.0, 0.0, 1.0])


def settled():
    """A box fallen on another, a lift at its stop, and what no gravity pulls."""
    world = Bench("limp")
    world.spawn_urdf("lift", LIFT, above(5.0, 5.0))
    world.spawn_urdf("under", BOX, above(0.0))
    world.spawn_urdf("box", BOX, above(0.205))
    world.spawn_urdf("floats", BODY, above(3.0))
    weigh(world, False)
    world.run(0.5)
    return world


def weigh(world, has_gravity):
    link = world.entities.link("floats::body")
    world.set_link_properties(link, link.link.inertial, has_gravity)


def push(world):
    wrench = np.array([0.0, 0.0, 50.0, 0.0, 0.0, 0.0])
    link = world.entities.link("box::box")
    world.forces.apply_wrench(link, Span(world.time_ns, None), wrench, world.time_ns)


def strain(world):
    joint = world.entities.joint("joint")
    world.forces.apply_effort(joint, Span(world.time_ns, None), 9.9)


def set_stop(world):
    joint = world.entities.joint("joint")
    world.set_joint_properties(joint, {"loStop": -3.0, "hiStop": 3.0})


def make_top_heavy(world):
    link = world.entities.link("box::box")
    inertial = replace(link.link.inertial, center_of_mass=np.array([0.3, 0.0, 0.0]))
    world.set_link_properties(link, inertial, True)


WRITERS = {
    "joint positions": lambda world: world.set_joint_positions("lift", {"joint": 1.0}),
    "a model's state": lambda world: world.put("box", above(1.0), np.zeros(6)),
    "a root's state": lambda world: world.set_root_state(
        world.model("box"), above(1.0), np.zeros(6)
    ),
    "a wrench": push,
    "an effort": strain,
    "gravity": lambda world: world.change(gravity_z=9.8),
    "weight": lambda world: weigh(world, True),
    "mass": make_top_heavy,
    "a stop": set_stop,
    "a model gone": lambda world: world.delete("under"),
    "a model come": lambda world: world.spawn_urdf("new", BOX, above(1.0)),
    "a reset of models": lambda world: world.reset_models(),
    "a reset": lambda world: world.reset(),
}


@pytest.mark.parametrize("name", WRITERS)
def test_whatever_is_written_ends_the_rest(name):
    """Each of them makes something fall, slide or fly, to be seen in 0.2 s."""
    world = settled()
    before = world.link_states()
    world.run(0.1)
    for was, now in zip(before, world.link_states()):
        np.testing.assert_array_equal(was, now)
    assert not world.link_states()[1].any()
    WRITERS[name](world)
    poses = world.link_states()[0]
    world.run(0.2)
    assert np.abs(world.link_states()[0] - poses).max() > 1e-3


def test_what_rests_is_where_it_would_be_if_it_did_not():
    """PyBullet itself, going on from where the world stopped, is the oracle."""
    world = Bench("hold")
    world.spawn_urdf("box", BOX, above(0.05))
    world.run(1.5)
    pose = world.model("box").pose
    assert not world.model("box").twist.any()
    for _ in range(500):
        world.client.stepSimulation()
    number = world.body("box").number
    position, quaternion = world.client.getBasePositionAndOrientation(number)
    np.testing.assert_allclose(pose, [*position, *quaternion], atol=REST_SPEED)


@pytest.mark.parametrize("time_step", [1e-9, 1e-3])
def test_what_begins_to_fall_does_not_rest(time_step):
    """At a step of a nanosecond it is slower than what counts as still for long."""
    world = Bench("limp", time_step=time_step)
    world.spawn_urdf("box", BOX, above(1.0))
    world.run(300 * time_step)
    fallen = -9.8 * 300 * time_step
    np.testing.assert_allclose(world.model("box").twist[2], fallen, rtol=0.01)


def test_what_turns_round_does_not_rest():
    """A pendulum that swings by 0.1 mrad stands still for 10 ms twice a period."""
    world = Bench("limp")
    world.spawn_urdf("pendulum", PENDULUM, above(2.0))
    world.set_joint_positions("pendulum", {"joint": 1e-4})
    world.run(2.0)
    speeds = []
    for _ in range(1000):
        world.step()
        speeds.append(world.model("pendulum").velocity[0])
    # I = 0.1 + 1 * 0.5^2, so the period is 2 pi sqrt(0.35 / 4.9) = 1.7 s.
    np.testing.assert_allclose(max(speeds), 1e-4 * np.sqrt(4.9 / 0.35), rtol=0.05)


def test_what_hardly_weighs_falls():
    world = Bench("limp", gravity=(0.0, 0.0, -5e-5))
    world.spawn_urdf("box", BOX, above(1.0))
    world.run(1.0)
    np.testing.assert_allclose(world.model("box").twist[2], -5e-5, rtol=0.01)
