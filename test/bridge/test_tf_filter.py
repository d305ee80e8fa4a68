"""What passes to TF: whole states, and poses that moved, turned or are old."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from g1_description.bridge.tf_filter import (
    ANSWER_DELAY,
    JOINTS_PERIOD,
    MAX_HOLD,
    STILL_PERIOD,
    PoseThrottle,
    TfFilter,
    WholeStates,
)
from g1_description.robot.rotation import from_axis_angle
from g1_description.robot.state import RobotState

PERIOD = 0.005
"""Time between two states in [s]."""


def state_at(stamp, height, joint, velocity=0.0):
    pose = np.array([0.0, 0.0, height, 0.0, 0.0, 0.0, 1.0])
    velocities = np.array([velocity])
    return RobotState(stamp, ("joint",), np.array([joint]), velocities, pose)


class Robot:
    """A base that is set at once, joints that are set by commands, and what passes."""

    def __init__(self):
        self.states = WholeStates()
        self.now = 100.0
        self.base = self.joint = 0.0
        self.commands = 0
        self.is_under_way = self.is_moving = self.is_sample = False
        self.passed = []

    def see(self):
        self.now += PERIOD
        stamp = round(1e9 * self.now)
        state = state_at(stamp, self.base, self.joint, float(self.is_moving))
        whole = self.states.next(
            state, self.now, self.commands, self.is_under_way, self.is_sample
        )
        if whole is not None:
            state = whole.state
            self.passed.append((state.base_pose[2], state.positions[0]))

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


@pytest.mark.parametrize(
    ("moving", "commands", "has_speed", "is_sample", "passed"),
    [
        ("base", 0, False, False, 98),
        ("joint", 0, False, False, 98),
        ("base joint", 0, False, False, 98),
        ("joint", 1, False, False, 98),  # the base stands still
        ("base joint", 1, True, False, 98),  # it moves by itself
        ("base joint", 1, False, True, 98),  # samples of a motion
        ("base joint", 1, False, False, 9),  # a planner that never waits
        ("base", 1, False, False, 9),
    ],
)
def test_states_pass_unless_their_base_moves_beside_commands(
    moving, commands, has_speed, is_sample, passed
):
    robot = Robot()
    robot.is_moving, robot.is_sample = has_speed, is_sample
    robot.see()
    robot.see()
    robot.passed.clear()
    for step in range(1, 99):
        robot.commands += commands
        robot.base = step if "base" in moving else 0.0
        robot.joint = step if "joint" in moving else 0.0
        robot.see()
    assert passed <= len(robot.passed) <= passed + 1


def test_what_is_overdue_passes():
    robot = Robot()
    robot.command()
    for step in range(1, 200):
        robot.base = step
        robot.see()
    waited = np.diff([base for base, _ in robot.passed]) * PERIOD
    assert waited.max() <= MAX_HOLD + PERIOD
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
    assert (round(ANSWER_DELAY / PERIOD) + 2, 0.0) in robot.passed
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
    state = state_at(round(1e9 * robot.now) + 1, 5.0, 0.0)
    state = replace(state, positions=np.zeros(2))
    assert robot.states.next(state, robot.now) is not None


@pytest.fixture
def tf_filter():
    return TfFilter(PoseThrottle(0.005, 0.01, max_interval=10.0))


def taken(tf_filter, number, height, joint=0.0):
    """Give the filter a state each millisecond; return what is shown of the last."""
    state = state_at(1_000_000 * number, height, joint)
    return told(*tf_filter.next(state, 1e-3 * number))


def told(joints, base):
    """Give the number of a state, and whether its joints and its base are shown."""
    state = joints or base
    return state and (state.stamp // 1_000_000, joints is not None, base is not None)


def test_joints_go_with_each_base(tf_filter):
    shown = [taken(tf_filter, number, 0.01 * number) for number in range(1, 6)]
    assert shown == [None, *((number, True, True) for number in range(1, 5))]


def test_joints_go_by_themselves_while_the_base_stands_still(tf_filter):
    shown = [taken(tf_filter, number, 1.0, 0.1 * number) for number in range(1, 102)]
    period = JOINTS_PERIOD // 1_000_000
    assert [one for one in shown if one] == [
        (1, True, True),
        *((1 + n * period, True, False) for n in range(1, 5)),
    ]


def test_joints_that_stand_still_go_less_often(tf_filter):
    shown = [taken(tf_filter, number, 1.0) for number in range(1, 202)]
    period = STILL_PERIOD // 1_000_000
    assert [one for one in shown if one] == [
        (1, True, True),
        *((1 + n * period, True, False) for n in range(1, 4)),
    ]


@pytest.mark.parametrize("last", [5, 30, 45])
def test_the_last_state_before_joints_move_is_sent(tf_filter, last):
    """But where one was sent less than a period before."""
    joint = np.maximum(0.0, np.arange(100) - last)
    shown = [taken(tf_filter, number, 1.0, joint[number]) for number in range(1, 60)]
    numbers = [one[0] for one in shown if one]
    period = JOINTS_PERIOD // 1_000_000
    assert numbers[:2] == [1, max(last, 1 + period)]


def test_joints_wait_for_the_base_while_it_moves_a_little(tf_filter):
    """By themselves they would be shown with the base of another state."""
    shown = [taken(tf_filter, number, 1e-4 * number) for number in range(1, 60)]
    assert [one[0] for one in shown if one] == [1, 51]
    assert all(one[2] for one in shown if one)


@pytest.mark.parametrize("start", [3, 22, 23, 47])
@pytest.mark.parametrize("steps", [(0.02,), (2e-4, 4e-4, 0.02), (6e-4, 0.02)])
def test_tf_never_mixes_the_base_of_two_states(tf_filter, start, steps):
    """Whenever the base leaves after joints went by themselves.

    TF interpolates the base between those that were sent; at the stamp of joints it
    must have the base of their state, or what stands still for it.
    """
    joints, bases = [], []
    heights = {start + n: height for n, height in enumerate(steps)}
    sent, height = {}, 0.0
    for number in range(1, 60):
        height = heights.get(number, height)
        sent[number] = height
        shown = taken(tf_filter, number, height, 0.1 * number)
        joints += [shown[0]] if shown and shown[1] else []
        bases += [shown[0]] if shown and shown[2] else []
    found = np.interp(joints, bases, [sent[number] for number in bases])
    np.testing.assert_allclose(found, [sent[number] for number in joints], atol=5e-4)


def test_the_last_state_is_shown_once(tf_filter):
    for number in (1, 2, 3):
        taken(tf_filter, number, 1.0)
    assert told(*tf_filter.settle()) == (3, True, True)
    assert tf_filter.settle() == (None, None)
    tf_filter.reset()
    assert tf_filter.settle() == (None, None)


def test_without_a_base_joints_pass_at_their_rate(tf_filter):
    states = [
        replace(state_at(1_000_000 * number, 0.0, 0.0), base_pose=None)
        for number in range(1, 91)
    ]
    shown = [told(*tf_filter.next(one, 0.0)) for one in states]
    assert [one for one in shown if one] == [
        (number, True, False) for number in (1, 21, 41, 61, 81)
    ]
    assert told(*tf_filter.settle()) == (90, True, False)
    assert tf_filter.settle() == (None, None)


# --- the throttle ---

HOME = np.array([0.0, 0.0, 0.793, 0.0, 0.0, 0.0, 1.0])


@pytest.fixture
def throttle():
    one = PoseThrottle(0.005, 0.01, 0.05)
    assert one.passes(1.0, HOME)
    return one


def moved(distance=0.0, angle=0.0):
    turn = from_axis_angle(np.array([0.6, 0.0, 0.8]), angle)
    position = HOME[:3] + np.array([0.0, distance, 0.0])
    return np.concatenate([position, turn])


@pytest.mark.parametrize(
    ("since", "distance", "angle", "sent"),
    [
        (0.001, 0.0, 0.0, False),
        (0.049, 0.0, 0.0, False),
        (0.050, 0.0, 0.0, True),
        (0.001, 0.0049, 0.0, False),
        (0.001, 0.0051, 0.0, True),
        (0.001, 0.0, 0.0099, False),
        (0.001, 0.0, 0.0101, True),
        (0.0, 1.0, 1.0, False),
        (-0.5, 1.0, 1.0, False),
    ],
)
def test_only_news_pass(throttle, since, distance, angle, sent):
    assert throttle.passes(1.0 + since, moved(distance, angle)) is sent


def test_a_resting_pose_passes_at_the_full_rate_of_its_interval(throttle):
    """Stamps are floats of whole milliseconds: none may be lost to rounding."""
    sent = [ms for ms in range(1, 10001) if throttle.passes(1.0 + ms / 1000.0, HOME)]
    assert sent == list(range(50, 10001, 50))


def test_small_moves_add_up_against_the_pose_last_sent(throttle):
    stamps = [1.0 + 0.001 * step for step in range(1, 7)]
    sent = [throttle.passes(t, moved((t - 1.0) * 2.0)) for t in stamps]
    assert sent == [False, False, True, False, False, True]


def test_a_least_interval_holds_even_for_a_pose_that_moves():
    throttle = PoseThrottle(0.005, 0.01, 0.05, min_interval=0.02)
    assert throttle.passes(1.0, HOME)
    assert not throttle.passes(1.019, moved(1.0))
    assert throttle.passes(1.020, moved(1.0))


def test_after_a_reset_the_next_pose_passes_whatever_its_stamp(throttle):
    throttle.reset()
    assert throttle.passes(0.001, HOME)


def test_a_pose_that_no_other_follows_passes_once(throttle):
    assert not throttle.settles(1.0, moved(0.001))
    assert throttle.settles(1.001, moved(0.001))
    assert not throttle.settles(1.001, moved(0.001))
    assert not throttle.passes(1.002, moved(0.005))


def test_near_is_a_tenth_of_the_thresholds(throttle):
    assert throttle.is_near(moved(0.00049, 0.00099))
    assert not throttle.is_near(moved(0.00051))
    assert not throttle.is_near(moved(0.0, 0.00101))
    throttle.reset()
    assert not throttle.is_near(HOME)
