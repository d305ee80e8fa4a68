"""States between the two halves of a command are found, and no others."""

import numpy as np
import pytest

from g1_description.core.whole_states import LONG, SHORT, State, WholeStates

PERIOD = 0.005
"""Time between two states in [s]."""


class Robot:
    """A base and a joint that are set apart, and the states that pass."""

    def __init__(self):
        self.states = WholeStates()
        self.now = 100.0
        self.base = self.joint = 0.0
        self.passed = []

    def see(self, now=None):
        self.now = self.now + PERIOD if now is None else now
        pose = np.array([0.0, 0.0, self.base, 0.0, 0.0, 0.0, 1.0])
        state = State(round(1e9 * self.now), pose, np.array([self.joint]))
        whole = self.states.next(state, self.now)
        if whole is not None:
            self.passed.append((whole.pose[2], whole.joints[0]))


@pytest.mark.parametrize("first", ["base", "joint"])
def test_halves_of_a_stream_of_commands_do_not_pass(first):
    robot = Robot()
    second = {"base": "joint", "joint": "base"}[first]
    for step in range(1, 100):
        setattr(robot, first, step)
        robot.see()
        setattr(robot, second, step)
        robot.see()
    assert all(base == joint for base, joint in robot.passed)
    assert {base for base, _ in robot.passed} == set(range(99))


def test_halves_that_are_kept_apart_by_a_busy_machine_do_not_pass():
    robot = Robot()
    for step in range(1, 100):
        robot.base = step
        for _ in range(1 + step % 4 * 4):  # 80 ms at most
            robot.see()
        robot.joint = step
        robot.see()
    assert all(base == joint for base, joint in robot.passed[4:])
    assert len({base for base, _ in robot.passed}) > 90


def test_every_state_passes_where_both_move_at_once():
    robot = Robot()
    for step in range(1, 100):
        robot.base = robot.joint = step
        robot.see()
    assert robot.passed == [(step, step) for step in range(1, 99)]


@pytest.mark.parametrize("moving", ["base", "joint"])
def test_what_moves_alone_passes_after_a_short_wait(moving):
    robot = Robot()
    robot.see()
    begin = robot.now
    for step in range(1, 100):
        setattr(robot, moving, step)
        robot.see()
        if robot.now - begin > SHORT + 2 * PERIOD:
            assert len(robot.passed) >= step - SHORT / PERIOD - 2
    assert robot.passed[-1] == ((98, 0) if moving == "base" else (0, 98))


def test_what_goes_on_alone_after_both_moved_passes_after_a_longer_wait():
    robot = Robot()
    for step in range(1, 20):
        robot.base = robot.joint = step
        robot.see()
    begin = robot.now
    while robot.now < begin + 3 * LONG:
        robot.base += 1
        robot.see()
        waited = robot.now - begin
        is_ahead = robot.passed[-1][0] > 19
        assert is_ahead or waited < LONG + 3 * PERIOD
        assert not is_ahead or waited > LONG


def test_rounding_is_no_motion():
    robot = Robot()
    for step in range(100):
        robot.base = step
        robot.joint = step + 1e-12 * (-1) ** step
        robot.see()
        robot.joint = step
        robot.see()
    assert len(robot.passed) == 199


def test_joints_that_come_or_go_start_anew():
    robot = Robot()
    robot.see()
    pose = np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0, 1.0])
    state = State(round(1e9 * robot.now) + 1, pose, np.zeros(2))
    assert robot.states.next(state, robot.now) is not None
