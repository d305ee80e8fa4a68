"""The first cause of a failure is the fault that was put into the simulation."""

from dataclasses import replace

import numpy as np
import pytest

from g1_description import Robot
from g1_description.checks.run import states_of
from g1_description.sim.rollout import Conditions, rollout

pytest.importorskip("mujoco")
from bench import causes as faults

ROBOT = Robot()
CHECKER = ROBOT.checker()


def explained(kind, seed, **changes):
    """Simulate a fault; explain its states, some of which may be unknown."""
    fault, motion, _, stream = faults.drawn(ROBOT, kind, np.random.default_rng(seed))
    states = replace(faults.simulated(ROBOT, motion, fault), **changes)
    return CHECKER.explain(states, [stream]), fault


@pytest.mark.parametrize(
    ("kind", "seed"),
    [
        ("weak motor", [0, 0, 0]),
        ("wrong gain", [1, 0, 0]),
        ("jump", [2, 0, 0]),
        ("push", [4, 0, 0]),
        ("base too high", [5, 0, 0]),
        ("heavy hand", [6, 1, 0]),
        ("late stream", [7, 0, 0]),
    ],
)
def test_the_first_cause_of_a_failure_is_the_fault(kind, seed):
    found, fault = explained(kind, seed)
    assert faults.is_right(found, fault), str(found)
    times = [event.time for event in found.chain[1:]]
    assert times == sorted(times) and max(times, default=0.0) <= found.failure.time
    assert not found.unknown
    if kind in ("jump", "late stream"):
        assert faults.SENDER in found.first and "joint_commands" in found.first
    if kind == "push":
        at, _, x, y = fault.push
        assert abs(found.chain[0].time - at) < 0.1
        assert " forwards" in found.first and x > abs(y)


def test_a_slip_is_the_first_cause_where_the_base_leaves_its_command():
    random = np.random.default_rng([3, 1, 0])
    states, commands, fault = faults.run(ROBOT, "slippery floor", random)
    found = CHECKER.explain(states, commands)
    assert faults.is_right(found, fault), str(found)
    assert found.failure.text.startswith("the base is 0.15 m or 0.3 rad off")


def test_a_sound_run_has_no_first_cause():
    assert explained("sound", [8, 0, 0])[0] is None


def test_what_is_not_known_is_not_blamed_and_said():
    found, _ = explained("push", [4, 0, 0], efforts=None, commanded=None)
    assert found.failure.text == "the robot falls"
    assert found.chain[0].name in ("lost_contact", "unbalanced", "slip")
    assert found.unknown == "Not known: efforts of the motors, commands."
    found, _ = explained("jump", [2, 0, 0], base_poses=None)
    assert found.chain[0].name == "command_jump"
    assert found.unknown == "Not known: how it stands."


def test_a_moment_long_before_a_fall_is_not_its_cause():
    """A jump of a wrist at 0.8 s; the centre of mass leaves the support at 6.7 s."""
    conditions = Conditions(engine="mujoco")
    checker = ROBOT.checker(physics=conditions)
    motion = ROBOT.read_motion("faulty.csv")
    played = rollout(ROBOT.description, motion, conditions)
    found = checker.explain(states_of(played), (), played)
    assert found.chain[0].name == "infeasible_commands"
    assert "centre of mass" in found.first
    assert not any(event.name == "command_jump" for event in found.chain)
