"""Wrenches, efforts and gravity against mechanics."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import world_poses
from scipy.spatial.transform import Rotation
from worlds import Bench

from g1_description.sim.forces import Span

BODY = """<robot name="body"><link name="body"><inertial>
<origin xyz="0.1 0.02 -0.03"/><mass value="2"/>
<inertia ixx="0.03" iyy="0.03" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial>
</link></robot>"""
PENDULUM = """<robot name="pendulum"><link name="world"/><link name="mount"><inertial>
<mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
</link><link name="bob"><inertial><origin xyz="0 0 -0.5"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="anchor" type="fixed"><parent link="world"/><child link="mount"/>
<origin xyz="0 0 2"/></joint>
<joint name="swing" type="revolute"><parent link="mount"/><child link="bob"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="3" velocity="50"/></joint>
</robot>"""
MS = 1_000_000
NOWHERE = (0.0, 0.0, 0.0)
VECTOR = st.tuples(*[st.floats(-3.0, 3.0)] * 3).map(np.array)


def apply_wrench(world, model, force, torque=NOWHERE, span=(0, None)):
    link = world.entities.link(f"{model}::body")
    wrench = np.array([*force, *torque])
    world.forces.apply_wrench(link, Span(*span), wrench, world.time_ns)


def apply_effort(world, joint, effort, end=100):
    world.forces.apply_effort(
        world.entities.joint(joint), Span(world.time_ns, end * MS), effort
    )


@settings(max_examples=8, deadline=None)
@given(pose=world_poses(), force=VECTOR, torque=VECTOR)
def test_a_wrench_acts_at_the_center_of_mass_along_the_worlds_axes(pose, force, torque):
    """Newton and Euler, for a body that any axis is a principal axis of."""
    world = Bench("limp", gravity=NOWHERE)
    world.spawn_urdf("body", BODY, pose)
    apply_wrench(world, "body", force, torque, (0, 10 * MS))
    world.run(0.02)
    model = world.model("body")
    angular = 0.01 * torque / 0.03
    np.testing.assert_allclose(model.twist[3:], angular, atol=1e-3)
    turn = Rotation.from_quat(model.pose[3:])
    lever = turn.apply([0.1, 0.02, -0.03])
    at_center = model.twist[:3] + np.cross(model.twist[3:], lever)
    np.testing.assert_allclose(at_center, 0.01 * force / 2.0, atol=1e-9)
    world.close()


@pytest.mark.parametrize(("start", "end", "steps"), [(5, 15, 10), (25, None, 5)])
def test_a_wrench_acts_for_its_span_to_the_step(make_world, start, end, steps):
    world = make_world("limp", gravity=NOWHERE)
    world.spawn_urdf("body", BODY, np.array([0, 0, 1.0, 0, 0, 0, 1]))
    end = None if end is None else end * MS
    apply_wrench(world, "body", [2.0, 0, 0], span=(start * MS, end))
    world.run(0.03)
    assert world.model("body").twist[0] == pytest.approx(steps * 1e-3, abs=1e-12)
    over = end is not None and end <= 30 * MS
    assert len(world.forces) == (0 if over else 1)


@pytest.mark.both_engines
def test_of_two_wrenches_the_newest_acts_and_then_the_other_again(make_world):
    """gazebo_ros sets a link's force anew with each job, each step."""
    world = make_world("limp", gravity=NOWHERE)
    world.spawn_urdf("body", BODY, np.array([0, 0, 1.0, 0, 0, 0, 1]))
    apply_wrench(world, "body", [2.0, 0, 0])
    apply_wrench(world, "body", [0, 2.0, 0], span=(10 * MS, 20 * MS))
    world.run(0.03)
    at_center = world.model("body").twist[:2]
    np.testing.assert_allclose(at_center, [0.02, 0.01], atol=1e-12)


@pytest.mark.both_engines
def test_efforts_add_up_each_within_the_limit(make_world):
    """The bob's inertia about the joint is 0.01 + 1 * 0.5^2."""
    world = make_world("limp", gravity=NOWHERE)
    world.spawn_urdf("pendulum", PENDULUM, np.array([0, 0, 0, 0, 0, 0, 1.0]))
    model = world.model("pendulum")
    for effort in (0.5, 300.0, -1.0):
        apply_effort(world, "swing", effort, 10)
    apply_effort(world, "anchor", 1.0, 10)
    later = Span(50 * MS, 60 * MS)
    world.forces.apply_effort(world.entities.joint("swing"), later, 2.0)
    world.run(0.02)
    expected = 0.01 * (0.5 + 3.0 - 1.0) / 0.26
    assert model.velocity[0] == pytest.approx(expected, rel=1e-3)


def test_forces_end_with_their_model_and_with_a_reset(make_world):
    world = make_world("limp", gravity=NOWHERE)
    for name in ("one", "two"):
        world.spawn_urdf(name, BODY, np.array([0, 0, 1.0, 0, 0, 0, 1]))
        apply_wrench(world, name, [2.0, 0, 0])
    world.delete("one")
    world.spawn_urdf("one", BODY, np.array([0, 0, 1.0, 0, 0, 0, 1]))
    world.run(0.01)
    assert not world.model("one").twist.any()
    assert world.model("two").twist[0] == pytest.approx(0.01)
    world.reset()
    world.run(0.01)
    assert not world.model("two").twist.any()


@pytest.mark.both_engines
def test_one_stop_of_a_continuous_joint_leaves_the_other_side_free(make_world):
    world = make_world("limp", gravity=NOWHERE)
    endless = PENDULUM.replace('"revolute"', '"continuous"')
    world.spawn_urdf("pendulum", endless, np.array([0, 0, 0, 0, 0, 0, 1.0]))
    joint = world.entities.joint("swing")
    world.set_joint_properties(joint, {"hiStop": 0.1})
    apply_effort(world, "swing", 1.0, 10_000)
    world.run(1.0)
    assert world.model("pendulum").position[0] == pytest.approx(0.1, abs=0.01)
    apply_effort(world, "swing", -2.0, 10_000)
    world.run(1.0)
    assert world.model("pendulum").position[0] < -1.0


def test_forces_that_cannot_act_any_more_are_forgotten(make_world):
    world = make_world("limp", gravity=NOWHERE)
    world.spawn_urdf("pendulum", PENDULUM, np.array([5, 0, 0, 0, 0, 0, 1.0]))
    world.spawn_urdf("body", BODY, np.array([0, 0, 1.0, 0, 0, 0, 1]))
    for _ in range(100):
        apply_wrench(world, "body", [2.0, 0, 0])
        world.forces.apply_effort(world.entities.joint("swing"), Span(0, None), 0.001)
    assert len(world.forces) == 2
    apply_wrench(world, "body", [0, 2.0, 0], span=(0, 10 * MS))
    apply_wrench(world, "body", [0, 0, 2.0], span=(5 * MS, 10 * MS))
    assert len(world.forces) == 4
    world.run(0.02)
    at_center = world.model("body").twist[:3]
    np.testing.assert_allclose(at_center, [0.01, 0.005, 0.005], atol=1e-12)
    still = make_world("kinematic")
    still.spawn_urdf("body", BODY, np.array([0, 0, 1.0, 0, 0, 0, 1]))
    apply_wrench(still, "body", [2.0, 0, 0])
    assert not len(still.forces)


@pytest.mark.both_engines
@pytest.mark.parametrize("damping", [0.5, 1e9])
def test_damping_slows_down_however_strong_it_is(make_world, damping):
    """A link of 0.26 kg m^2: at most as fast as effort and damping balance."""
    world = make_world("limp", gravity=NOWHERE)
    damped = PENDULUM.replace("<limit", f'<dynamics damping="{damping}"/><limit')
    world.spawn_urdf("pendulum", damped, np.array([0, 0, 0, 0, 0, 0, 1.0]))
    model = world.model("pendulum")
    apply_effort(world, "swing", 1.0)
    for _ in range(100):
        world.step()
        assert 0.0 <= model.velocity[0] <= 1.01 / damping + 4e-3
    world.run(0.2)
    assert 0.0 <= model.velocity[0] < 2.5


@pytest.mark.both_engines
def test_a_joint_with_friction_holds_what_is_weaker(make_world):
    world = make_world("limp", gravity=NOWHERE)
    stiff = PENDULUM.replace("<limit", '<dynamics friction="0.5"/><limit')
    world.spawn_urdf("pendulum", stiff, np.array([0, 0, 0, 0, 0, 0, 1.0]))
    model = world.model("pendulum")
    apply_effort(world, "swing", 0.4)
    world.run(0.1)
    assert abs(model.velocity[0]) < 1e-5
    apply_effort(world, "swing", 1.0, 200)
    world.run(0.1)
    assert model.velocity[0] == pytest.approx(0.5 * 0.1 / 0.26, rel=0.02)
