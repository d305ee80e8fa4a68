"""Many models move as each does alone."""

import numpy as np
from oracle import assert_poses_close, forward_kinematics
from test_free_bodies import FLYING, TWO
from test_world import ARM, TOP

HINGED = ARM.replace(
    '<link name="base">',
    '<link name="world"/><joint name="w" type="fixed"><parent link="world"/>'
    '<child link="base"/><origin xyz="0.1 0.2 0.3"/></joint><link name="base">',
)
CAST = {"arm": ARM, "top": TOP, "two": TWO, "flying": FLYING, "hinged": HINGED}
TWIST = np.array([0.3, -0.2, 0.1, 0.5, 0.6, -0.7])


def place(number):
    return np.array([3.0 * number, 0.0, 50.0, 0.0, 0.6, 0.0, 0.8])


def throw(world, name, number):
    """Spawn a model, throw it, and let its joints swing."""
    world.spawn_urdf(name, CAST[name], place(number), fixed_base=name == "top")
    world.put(name, place(number), TWIST)
    model = world.model(name)
    model.velocity[:] = np.linspace(0.5, 1.0, len(model.velocity))
    for body in world.bodies(name):
        body.write()
    return model


def test_models_move_among_others_as_they_do_alone(make_world):
    together = make_world("limp")
    models = {name: throw(together, name, n) for n, name in enumerate(CAST)}
    together.delete("two")
    models["two"] = throw(together, "two", 2)
    together.run(0.2)
    for number, name in enumerate(CAST):
        alone = make_world("limp")
        model = throw(alone, name, number)
        alone.run(0.2)
        for part in ("poses", "twists", "position", "velocity", "root_poses"):
            np.testing.assert_allclose(
                getattr(models[name], part),
                getattr(model, part),
                atol=1e-9,
                err_msg=name,
            )


def test_links_that_were_placed_are_seen_late_as_they_are_seen_at_once(make_world):
    """Where scipy has them; what is below stands still, what is above does not."""
    world, twin = make_world("limp"), make_world("limp")
    model, other = throw(world, "arm", 0), throw(twin, "arm", 0)
    for one in (world, twin):
        one.run(0.2)
    before = np.array(other.twists)  # a look at the model's own would compute them
    world.set_joint_positions("arm", {"slide": 0.2})
    for count in range(500):  # nobody looks at the links until all are done
        world.set_joint_positions("arm", {"turn": 1e-3 * count})
    placed = dict(zip(model.joint_names, model.position))
    assert placed["slide"] == 0.2 and placed["turn"] == 0.499
    twists = np.array(model.twists)
    expected = forward_kinematics(ARM, model.root_poses[0], placed)
    for row, link in enumerate(model.link_names):
        assert_poses_close(model.poses[row], expected[link], 1e-9)
        moves = link in ("base", "upper")
        np.testing.assert_array_equal(twists[row], before[row] if moves else 0.0)
    world.set_joint_positions("arm", {"hinge": 0.5})
    np.testing.assert_array_equal(model.twists[0], before[0])
    assert not model.twists[1:].any()
