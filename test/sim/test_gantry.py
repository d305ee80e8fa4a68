"""Robots that hang on a rope, against statics, on each engine."""

from dataclasses import replace

import numpy as np
import pytest
from worlds import OUR_G1

from g1_description.errors import InvalidValueError, UnknownNameError
from g1_description.sim.gantry import HEIGHT

PLACE = np.array([0.4, -0.2, 0.9, 0.0, 0.0, 0.0, 1.0])


def g1(make_world, physics="hold", **given):
    """Give a world with the G1 in the air, and the G1."""
    world = make_world(physics, **given)
    world.spawn_urdf("g1", OUR_G1, PLACE)
    return world, world.model("g1")


def torso(model):
    """Give the place of the torso's center of mass."""
    from scipy.spatial.transform import Rotation

    row = list(model.link_names).index("torso_link")
    pose = model.poses[row]
    return pose[:3] + Rotation.from_quat(pose[3:]).apply(model.centers[row])


def test_it_hangs_lower_by_its_weight_over_the_stiffness(make_world):
    world, model = g1(make_world)
    length = world.gantries.hang(model, "", 0.0)
    begin = torso(model)
    assert length == pytest.approx(HEIGHT - begin[2])
    world.run(8.0)
    # m g = m (4 pi)^2 sag
    sag = 9.8 / (4.0 * np.pi) ** 2
    assert torso(model)[2] == pytest.approx(begin[2] - sag, abs=1e-3)
    np.testing.assert_allclose(torso(model)[:2], begin[:2], atol=0.02)
    assert np.abs(model.twists).max() < 0.1


def test_a_longer_rope_puts_it_on_its_feet_and_pulls_no_more(make_world):
    world, model = g1(make_world)
    world.gantries.hang(model, "", 0.0)
    for length in np.linspace(1.9, 2.4, 100):
        assert world.gantries.hang(model, "", length) == length
        world.run(0.04)
    world.run(1.0)
    standing = model.pose[2]
    assert torso(model)[2] > HEIGHT - 2.4
    world.gantries.forget(model)
    world.run(1.0)
    assert model.pose[2] == pytest.approx(standing, abs=1e-3)


@pytest.mark.both_engines
def test_without_it_falls_and_a_deleted_model_takes_its_rope_along(make_world):
    world, model = g1(make_world, "limp")
    world.gantries.hang(model, "pelvis", 0.0)
    world.run(0.5)
    assert model.pose[2] > 0.8
    world.gantries.forget(model)
    world.run(1.0)
    assert model.pose[2] < 0.7
    world.gantries.hang(model, "", 0.0)
    world.delete("g1")
    world.spawn_urdf("g1", OUR_G1, PLACE)
    world.run(1.0)
    assert world.model("g1").pose[2] < 0.7


AWAY = np.array([10.0, 3.0, 1.1, 0.0, 0.0, 0.0, 1.0])


@pytest.mark.parametrize("placed", ["put", "root", "reset", "home"])
def test_the_point_comes_along_when_the_model_is_placed_elsewhere(make_world, placed):
    world, model = g1(make_world)
    if placed in ("reset", "home"):
        world.put("g1", AWAY, np.zeros(6))
    world.gantries.hang(model, "", 2.0)
    if placed == "put":
        world.put("g1", AWAY, np.zeros(6))
    elif placed == "root":
        world.set_root_state(model, AWAY, np.zeros(6))
    elif placed == "reset":
        world.reset()
    else:
        world.reset_models()
    begin = torso(model)
    world.run(0.5)
    assert np.abs(model.twists[:, :2]).max() < 1.0
    np.testing.assert_allclose(torso(model)[:2], begin[:2], atol=0.05)


def test_hanging_it_again_renews_the_point(make_world):
    world, model = g1(make_world)
    length = world.gantries.hang(model, "", 0.0)
    model.root_poses[0, :2] += 1.0  # as if it had walked
    model.set_root(0, model.root_poses[0], np.zeros(6))
    world.engine.write(model)
    assert world.gantries.hang(model, "", 0.0) == pytest.approx(length)
    begin = torso(model)
    world.run(0.5)
    np.testing.assert_allclose(torso(model)[:2], begin[:2], atol=0.05)


def test_a_heavier_model_sags_as_far(make_world):
    world, model = g1(make_world)
    world.gantries.hang(model, "", 0.0)
    begin = torso(model)[2]
    link = world.entities.link("g1::torso_link")
    inertial = replace(link.link.inertial, mass=3.0 * link.link.inertial.mass)
    world.set_link_properties(link, inertial, True)
    world.run(3.0)
    sag = 9.8 / (4.0 * np.pi) ** 2
    assert torso(model)[2] == pytest.approx(begin - sag, abs=5e-3)


def test_what_cannot_hang_is_told(make_world):
    for physics, fixed, words in (
        ("kinematic", False, "nothing falls in kinematic physics"),
        ("hold", True, "the base of g1 is fixed"),
    ):
        world = make_world(physics)
        world.spawn_urdf("g1", OUR_G1, PLACE, fixed_base=fixed)
        with pytest.raises(InvalidValueError, match=words):
            world.gantries.hang(world.model("g1"), "", 1.0)
    world, model = g1(make_world)
    with pytest.raises(UnknownNameError, match=r"no link torso\. .* torso_link"):
        world.gantries.hang(model, "torso", 1.0)
    with pytest.raises(InvalidValueError, match=r"from 0 to 3 m \(got 3.5\)"):
        world.gantries.hang(model, "", 3.5)
    begin = model.pose[2]
    world.run(0.2)
    assert model.pose[2] < begin - 0.05  # nothing was changed


def test_it_hangs_by_a_link_that_is_lumped_into_another_one(make_world):
    world, model = g1(make_world)
    lengths = [world.gantries.hang(model, n, 0.0) for n in ("head_link", "torso_link")]
    assert lengths[0] == lengths[1]
    with pytest.raises(UnknownNameError, match=r"no link hed_link\. .*: head_link"):
        world.gantries.hang(model, "hed_link", 0.0)
