"""The contact forces of a robot that runs come from its last states."""

from dataclasses import replace

import numpy as np
import pytest

from g1_description.checker.forces import LiveForces
from g1_description.checks.arrows import LENGTH
from g1_description.checks.checker import Checker
from g1_description.robot.load import read_description
from g1_description.robot.state import RobotState

CHECKER = Checker(read_description("g1_29dof"))
NAMES = tuple(joint.name for joint in CHECKER.description.movable_joints)
STANDS = np.array([0.0, 0.0, 0.793, 0.0, 0.0, 0.0, 1.0])


def states(first, count, acceleration=0.0, rate=30.0):
    """Make states of a robot that stands, or accelerates upwards in [m/s^2]."""
    for row in range(count):
        time = first + row / rate
        base = STANDS.copy()
        base[2] += acceleration / 2.0 * (time - first) ** 2
        names, positions = (*NAMES, "hand"), np.zeros(len(NAMES) + 1)
        yield RobotState(round(1e9 * time), names, positions, base_pose=base)


def forces_of(*some):
    found = LiveForces()
    for state in some:
        found.add(state)
        found.find(CHECKER, None)
    return found


def up(found):
    return sum(arrow.vector[2] for arrow in found.arrows)


def test_forces_are_known_after_a_moment_and_carry_the_robot():
    assert not forces_of(*states(5.0, 5)).arrows
    found = forces_of(*states(5.0, 40))
    assert up(found) == pytest.approx(LENGTH, abs=0.002)
    assert not found.text


def test_a_robot_that_accelerates_upwards_presses_on_the_floor():
    found = forces_of(*states(0.0, 9, acceleration=1.0))
    assert up(found) == pytest.approx(LENGTH * (1.0 + 1.0 / 9.81), rel=0.01)


def test_without_a_base_or_after_time_went_back_it_begins_again():
    known = [*states(0.0, 20)]
    assert not forces_of(*known, replace(known[-1], stamp=10**9, base_pose=None)).arrows
    found = forces_of(*known)
    found.begin_again()
    assert not found.arrows
    high = np.array([0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 0.0])
    for state in known:  # in the air
        found.add(replace(state, base_pose=state.base_pose + high))
    found.find(CHECKER, None)
    assert "N m are missing" in found.text
