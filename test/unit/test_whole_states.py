"""States between the two halves of a command are found, and no others."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from g1_description.core.bridge.whole_states import OVERDUE, UNSEEN, State, WholeStates

PERIOD = 0.005
"""Time between two states in [s]."""


class Robot:
    """A base that is set at once, joints that are set by commands, and what passes."""

    def __init__(self):
        self.states = WholeStates()
        self.now = 100.0
        self.base = self.joint = 0.0
        self.commands = 0
        self.is_under_way = self.is_moving = False
        self.passed = []

    def see(self):
        self.now += PERIOD
        pose = np.array([0.0, 0.0, self.base, 0.0, 0.0, 0.0, 1.0])
        joints = np.array([self.joint])
        state = State(round(1e9 * self.now), pose, joints, None, self.is_moving)
        whole = self.states.next(state, self.now, self.commands, self.is_under_way)
        if whole is not None:
            self.passed.append((whole.pose[2], whole.joints[0]))

    def command(self):
        self.commands += 1
        self.is_under_way = True

    def answer(self, joint):
        self.joint = joint
        self.is_under_way = False


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 2)), min_size=20))
def test_no_half_of_a_command_passes(delays):
    """Whenever the joints' command comes, and however long it is under way."""
    robot = Robot()
    robot.see()
    for step, (late, under_way) in enumerate(delays, 1):
        robot.base = step
        robot.see()  # the state between base and command, which looks whole
        robot.command()
        for _ in range(late):
            robot.see()
        robot.answer(step)
        for _ in range(1 + under_way):
            robot.see()
    assert all(base == joint for base, joint in robot.passed)
    assert len({base for base, _ in robot.passed}) >= len(delays) - 1


def test_a_state_that_was_made_before_the_answer_and_comes_after_it_does_not_pass():
    robot = Robot()
    robot.see()
    robot.see()
    for step in range(1, 50):
        robot.base = step
        robot.command()
        robot.is_under_way = False
        robot.see()
        robot.joint = step
        robot.see()
    assert all(base == joint for base, joint in robot.passed)
    assert len(robot.passed) > 45


@pytest.mark.parametrize("moving", ["base", "joint", "both"])
def test_every_state_passes_where_no_command_is_under_way(moving):
    robot = Robot()
    for step in range(1, 100):
        if moving != "joint":
            robot.base = step
        if moving != "base":
            robot.joint = step
        robot.see()
    assert len(robot.passed) == 98


def test_every_state_passes_where_the_base_stands_still():
    """Commands that come without a pause hold nothing up."""
    robot = Robot()
    robot.command()
    for step in range(1, 100):
        robot.commands += 1
        robot.joint = step
        robot.see()
    assert len(robot.passed) == 98


def test_every_state_passes_of_a_robot_that_moves_by_itself():
    robot = Robot()
    robot.is_moving = True
    robot.command()
    for step in range(1, 100):
        robot.base = robot.joint = step
        robot.commands += 1
        robot.see()
    assert len(robot.passed) == 98


def test_what_is_overdue_passes():
    robot = Robot()
    robot.command()
    for step in range(1, 200):
        robot.base = step
        robot.see()
    waited = np.diff([base for base, _ in robot.passed]) * PERIOD
    assert waited.max() <= OVERDUE + PERIOD
    assert len(robot.passed) > 10


def test_a_command_that_moves_nothing_holds_up_for_a_moment_only():
    robot = Robot()
    for _ in range(3):
        robot.see()
    robot.command()
    robot.answer(robot.joint)
    for step in range(1, 20):
        robot.base = step
        robot.see()
    assert (round(UNSEEN / PERIOD) + 2, 0.0) in robot.passed
    assert robot.passed[-1] == (18.0, 0.0)


def test_rounding_is_no_motion():
    robot = Robot()
    for step in range(100):
        robot.base = 1e-12 * (-1) ** step
        robot.command()
        robot.see()
    assert len(robot.passed) == 99


def test_joints_that_come_or_go_start_anew():
    robot = Robot()
    robot.see()
    pose = np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0, 1.0])
    state = State(round(1e9 * robot.now) + 1, pose, np.zeros(2))
    assert robot.states.next(state, robot.now, 0, False) is not None
