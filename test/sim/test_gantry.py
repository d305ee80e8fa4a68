"""Robots that hang on a rope, against statics."""

from dataclasses import replace

import numpy as np
import pytest
from worlds import OUR_G1

from g1_description.errors import InvalidValueError, UnknownNameError
from g1_description.sim.anchor import HEIGHT

PLACE = np.array([0.4, -0.2, 0.9, 0.0, 0.0, 0.0, 1.0])
DUMMY = """<robot name="dummy"><link name="torso"><inertial><origin xyz="0 0 0.1"/>
<mass value="30"/><inertia ixx="1.5" iyy="1.5" izz="0.5" ixy="0" ixz="0" iyz="0"/>
</inertial><collision><geometry><box size="0.4 0.4 0.8"/></geometry></collision></link>
<link name="head"/><joint name="neck" type="fixed"><parent link="torso"/>
<child link="head"/><origin xyz="0 0 0.5"/></joint></robot>"""


def dummy(make_world, physics="hold", **given):
    """Give a world with a dummy in the air, and the dummy."""
    world = make_world(physics, **given)
    world.spawn_urdf("dummy", DUMMY, PLACE)
    return world, world.model("dummy")


def center(model):
    """Give the place of the center of mass, while the dummy is upright."""
    return model.pose[:3] + np.array([0.0, 0.0, 0.1])


@pytest.mark.both_engines
def test_it_hangs_lower_by_its_weight_over_the_stiffness(make_world):
    world, model = dummy(make_world)
    length = world.gantries.hang(model, "", 0.0)
    begin = center(model)
    assert length == pytest.approx(HEIGHT - begin[2])
    inertial = model.links["torso"].inertial
    sag = 9.8 / (4.0 * np.pi) ** 2  # m g = m (4 pi)^2 sag
    for factor in (1.0, 3.0):
        link = world.entities.link("dummy::torso")
        heavy = replace(inertial, mass=factor * inertial.mass)
        world.set_link_properties(link, heavy, True)
        world.run(1.0)
        np.testing.assert_allclose(center(model), begin - [0, 0, sag], atol=1e-3)
        assert np.abs(model.twists).max() < 0.01


def test_a_longer_rope_puts_it_on_its_feet_and_pulls_no_more(make_world):
    world, model = dummy(make_world)
    world.gantries.hang(model, "", 0.0)
    for length in np.linspace(2.0, 2.7, 50):
        assert world.gantries.hang(model, "", length) == length
        world.run(0.02)
    world.run(0.5)
    standing = model.pose[2]
    assert standing == pytest.approx(0.4, abs=2e-3)
    world.gantries.forget(model)
    world.run(0.2)
    assert model.pose[2] == pytest.approx(standing, abs=1e-3)


def test_without_it_falls_and_a_deleted_model_takes_its_rope_along(make_world):
    world, model = dummy(make_world, "limp")
    world.gantries.hang(model, "", 0.0)
    world.run(0.5)
    assert model.pose[2] > 0.8
    world.gantries.forget(model)
    world.run(0.5)
    assert model.pose[2] < 0.5
    world.gantries.hang(model, "", 0.0)
    world.delete("dummy")
    world.spawn_urdf("dummy", DUMMY, PLACE)
    world.run(0.5)
    assert world.model("dummy").pose[2] < 0.5


AWAY = np.array([10.0, 3.0, 1.1, 0.0, 0.0, 0.0, 1.0])


@pytest.mark.parametrize("placed", ["put", "root", "reset", "home"])
def test_the_point_comes_along_when_the_model_is_placed_elsewhere(make_world, placed):
    world, model = dummy(make_world)
    if placed in ("reset", "home"):
        world.put("dummy", AWAY, np.zeros(6))
    world.gantries.hang(model, "", 2.0)
    if placed == "put":
        world.put("dummy", AWAY, np.zeros(6))
    elif placed == "root":
        world.set_root_state(model, AWAY, np.zeros(6))
    elif placed == "reset":
        world.reset()
    else:
        world.reset_models()
    begin = center(model)
    world.run(0.5)
    assert np.abs(model.twists[:, :2]).max() < 1.0
    np.testing.assert_allclose(center(model)[:2], begin[:2], atol=0.05)


def test_hanging_it_again_renews_the_point(make_world):
    world, model = dummy(make_world)
    length = world.gantries.hang(model, "", 0.0)
    model.root_poses[0, :2] += 1.0  # as if it had walked
    model.set_root(0, model.root_poses[0], np.zeros(6))
    world.engine.write(model)
    assert world.gantries.hang(model, "", 0.0) == pytest.approx(length)
    begin = center(model)
    world.run(0.5)
    np.testing.assert_allclose(center(model)[:2], begin[:2], atol=0.05)


def test_what_cannot_hang_is_told(make_world):
    for physics, fixed, words in (
        ("kinematic", False, "nothing falls in kinematic physics"),
        ("hold", True, "the base of dummy is fixed"),
    ):
        world = make_world(physics)
        world.spawn_urdf("dummy", DUMMY, PLACE, fixed_base=fixed)
        with pytest.raises(InvalidValueError, match=words):
            world.gantries.hang(world.model("dummy"), "", 1.0)
    world, model = dummy(make_world)
    with pytest.raises(UnknownNameError, match=r"no link tors\. .* torso"):
        world.gantries.hang(model, "tors", 1.0)
    with pytest.raises(InvalidValueError, match=r"from 0 to 3 m \(got 3.5\)"):
        world.gantries.hang(model, "", 3.5)
    begin = model.pose[2]
    world.run(0.2)
    assert model.pose[2] < begin - 0.05  # nothing was changed


def test_it_hangs_by_the_torso_or_a_link_that_is_lumped_into_another_one(make_world):
    world = make_world("hold")
    world.spawn_urdf("g1", OUR_G1, PLACE)
    model, names = world.model("g1"), ("", "head_link", "torso_link")
    lengths = {world.gantries.hang(model, name, 0.0) for name in names}
    assert len(lengths) == 1
    with pytest.raises(UnknownNameError, match=r"no link hed_link\. .*: head_link"):
        world.gantries.hang(model, "hed_link", 0.0)
