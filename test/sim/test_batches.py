"""Steps that are computed together give what they give one by one."""

from itertools import cycle

import numpy as np
import pytest
from test_engine import ARM, UP
from test_rest import BOX, above

from g1_description.motion.edit import minimum_jerk_trajectory
from g1_description.sim.forces import Span

MS = 1_000_000
SWING = minimum_jerk_trajectory(["swing"], np.zeros(1), np.ones(1), 0.0804)
GROUPS = np.random.default_rng(0).integers(1, 30, 1000).tolist()


def outcome(world, groups):
    """Advance by groups of steps; return states every 50 ms and reports on motions."""
    world.spawn_urdf("arm", ARM, UP)
    world.spawn_urdf("box", BOX, above(0.0))
    world.spawn_urdf("falls", BOX, above(0.05, 3.0))
    link = world.entities.link("falls::box")
    wrench = np.array([5.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    world.forces.apply_wrench(link, Span(13 * MS, 47 * MS), wrench, 0)
    if world.engine.physics != "limp":
        for start in (7 * MS, 25 * MS):  # the second one takes the joint over
            world.motions.play(world.model("arm"), SWING, start)
    states, groups = [], cycle(groups)
    for end in range(50 * MS, 1500 * MS, 50 * MS):
        while world.time_ns < end:
            count = world.advance(min((end - world.time_ns) // MS, next(groups)))
            assert count >= 1
        arm = world.model("arm")
        states.append(np.concatenate([*map(np.ravel, world.link_states()), arm.target]))
        if world.is_dynamic:
            states.append(world.engine.efforts(arm))
    tracked = world.motions.take_tracked()
    return states, [(one.start_ns, *vars(one.report).values()) for one in tracked]


@pytest.mark.both_engines
@pytest.mark.parametrize("physics", ["kinematic", "hold", "limp"])
def test_they_are_those_of_single_steps(make_world, physics):
    """A pushed body comes to rest, and a motion takes a joint from another one."""
    ones, grouped = make_world(physics), make_world(physics)
    states, reports = outcome(ones, [1])
    found, found_reports = outcome(grouped, GROUPS)
    for single, group in zip(states, found):
        np.testing.assert_array_equal(group, single)
    assert len(reports) == len(found_reports) == 2 * (physics == "hold")
    for single, group in zip(reports, found_reports):
        for value, other in zip(single, group):
            assert other == pytest.approx(value, rel=1e-9, nan_ok=True)
    assert grouped.engine.is_resting == ones.engine.is_resting
    assert grouped.engine.is_resting == (physics == "limp")
