"""Whole turns: what the limits, the last position and the speed say of them.

The two links of a joint are placed by scipy.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from g1_description.bridge.estimator import JointStateEstimator
from g1_description.robot.urdf import parse_urdf

TURN = 2.0 * np.pi
HALF = 3.14159
RPY = (0.3, -0.2, 0.5)
AXIS = np.array([0.6, 0.0, -0.8])
BASE = Rotation.from_rotvec([1.0, 2.0, -0.5])
BEFORE = BASE * Rotation.from_euler("xyz", RPY)
DT = 0.02


class Watched:
    """A joint and the estimator that watches it."""

    def __init__(self, lower=None, upper=None):
        kind, limit = "continuous", ""
        if lower is not None:
            kind = "revolute"
            limit = f'<limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/>'
        text = (
            '<robot name="r"><link name="a"/><link name="b"/>'
            f'<joint name="j" type="{kind}"><parent link="a"/><child link="b"/>'
            f'<origin xyz="1 2 3" rpy="{RPY[0]} {RPY[1]} {RPY[2]}"/>'
            f'<axis xyz="3 0 -4"/>{limit}</joint></robot>'
        )
        self.estimator = JointStateEstimator({"r": parse_urdf(text)})
        self.time = 0.0

    def at(self, position, speed=0.0):
        """Place the links, and give the position that is read."""
        turned = BEFORE * Rotation.from_rotvec(AXIS * position)
        quaternions = [BASE.as_quat(), turned.as_quat()]
        poses = np.hstack([np.zeros((2, 3)), quaternions])
        twists = np.zeros((2, 6))
        twists[1, 3:] = turned.apply(AXIS) * speed
        self.time += DT
        (seen,) = self.estimator.update(
            ("r::a", "r::b"), poses, twists, round(1e9 * self.time)
        )
        return seen.positions[0]

    def through(self, *stations, moving=False, step=0.1):
        """Go from station to station by steps of at most 0.1 rad, or as given.

        At rest, as commands put it, or moving as fast as it goes.
        """
        for start, end in zip(stations, stations[1:]):
            steps = int(abs(end - start) / step) + 2
            speed = moving * (end - start) / (steps - 1) / DT
            for position in np.linspace(start, end, steps):
                assert self.at(position, speed) == pytest.approx(position, abs=1e-9)
        return self


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("stop", [HALF, np.pi, 4.0, 7.0, 3.07])
def test_a_little_beyond_its_stop_a_joint_does_not_flip(stop, side):
    """0.05 rad beyond, as physics pushes it; wide ranges and those of one turn."""
    beyond = side * (stop + 0.05)
    Watched(-stop, stop).through(0.0, beyond, 0.0, beyond, moving=True)


@pytest.mark.parametrize(("lower", "upper"), [(0, 4), (2, 8), (-1, 2), (10, 12)])
def test_a_little_beyond_its_stop_a_narrow_joint_is_known_at_once(lower, upper):
    for position in (lower - 0.05, lower, upper, upper + 0.05):
        assert Watched(lower, upper).at(position) == pytest.approx(position, abs=1e-9)


@pytest.mark.parametrize(
    ("lower", "upper", "position"),
    [
        (0, 4, 3.9),
        (-4, 4, -3.0),
        (2, 9, 8.6 - TURN),
        (-HALF, HALF, -3.1),
        (-6.5, 5, TURN - 3.8),
        (0, 6.8, 0.0),
        (0, 6.8, -1e-9),
        (0, 6.8, 6.2),
        (-0.5, 89, 0.0),
        (-89, 0.5, -5.5),
        (20, 40, 21.0),
        (-40, -20, -21.0),
    ],
)
def test_the_first_guess_is_the_turn_inside_the_limits_that_is_nearest_zero(
    lower, upper, position
):
    assert Watched(lower, upper).at(position) == pytest.approx(position, abs=1e-9)


def test_a_joint_of_more_than_a_turn_walks_through_a_half_turn_both_ways():
    Watched(-4, 4).through(0.0, 4.0, -4.0, 4.0, 0.0)
    Watched(-7, 7).through(0.0, -7.0, 7.0, -7.0, 0.0)
    Watched(2, 9).through(5.5, 9.0, 2.0, 9.0)
    Watched(-HALF, HALF).through(0.0, HALF, -HALF, HALF)


@pytest.mark.parametrize(
    ("limits", "before", "put", "inside"),
    [
        ((-4, 4), 3.9, 4.4, 4.4 - TURN),
        ((-4, 4), -3.9, -4.4, TURN - 4.4),
        ((-HALF, HALF), 3.0, 3.4, 3.4 - TURN),
        ((-HALF, HALF), 3.1, 3.1 + 0.08, 3.1 + 0.08 - TURN),
        ((-HALF, HALF), -HALF, -HALF - 0.001, TURN - HALF - 0.001),
        ((-4, 4), 4.0, 4.0 + 0.05, 4.05 - TURN),
        ((-HALF, HALF), -3.0, -3.4, TURN - 3.4),
        ((2, 9), 8.8, 9.5, 9.5 - TURN),
        ((-7, 7), -6.9, -7.5, TURN - 7.5),
    ],
)
def test_a_teleport_that_lands_outside_the_limits_is_read_inside(
    limits, before, put, inside
):
    """Less than a quarter turn away: it goes on, but out of the limits."""
    joint = Watched(*limits).through(0.5 * sum(limits), before)
    assert joint.at(put) == pytest.approx(inside, abs=1e-9)


def test_an_endless_joint_counts_twenty_turns_up_and_down():
    Watched().through(0.0, 20 * TURN, -20 * TURN, 0.0, step=0.3)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("limits", [(), (-40, 40)])
def test_a_jump_of_more_than_a_quarter_turn_counts_turns_anew(limits, side):
    goes_on = side * (30.0 + 0.24 * TURN)
    joint = Watched(*limits).through(0.0, side * 30.0)
    assert joint.at(goes_on) == pytest.approx(goes_on, abs=1e-9)
    jumps = goes_on + side * 0.26 * TURN
    anew = jumps - TURN * np.round(jumps / TURN)
    assert joint.at(jumps) == pytest.approx(anew, abs=1e-9)


@pytest.mark.parametrize("speed", [300.0, -300.0, 100.0])
def test_a_joint_that_is_fast_enough_for_its_way_has_not_jumped(speed):
    """6 rad in a message's time, almost a whole turn."""
    joint = Watched()
    for step in range(100):
        position = speed * DT * step
        assert joint.at(position, speed) == pytest.approx(position, abs=1e-9)


@pytest.mark.parametrize("limits", [(), (-40, 40)])
def test_a_reset_counts_turns_anew(limits):
    joint = Watched(*limits).through(0.0, 30.0)
    joint.estimator.reset()
    assert joint.at(30.0) == pytest.approx(30.0 - 5 * TURN, abs=1e-9)


def test_a_slide_has_no_turns():
    """Not even beyond its stop, beside a joint that counts them."""
    text = (
        '<robot name="r"><link name="a"/><link name="b"/><link name="c"/>'
        '<joint name="slide" type="prismatic"><parent link="a"/><child link="b"/>'
        '<limit lower="-5" upper="5" effort="1" velocity="1"/></joint>'
        '<joint name="turn" type="continuous"><parent link="a"/><child link="c"/>'
        "</joint></robot>"
    )
    estimator = JointStateEstimator({"r": parse_urdf(text)})
    for way in (0.0, 4.9, -4.9, 5.3, -5.3):
        poses = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]] * 3)
        poses[1, 0] = way
        names = ("r::a", "r::b", "r::c")
        (seen,) = estimator.update(names, poses, np.zeros((3, 6)), 0)
        assert seen.positions[0] == pytest.approx(way, abs=1e-12)


def test_a_joint_that_was_not_seen_for_a_while_goes_on_where_its_speed_took_it():
    """The other joint was seen meanwhile."""
    text = "".join(
        f'<joint name="{name}" type="continuous"><parent link="a"/>'
        f'<child link="{name}"/><axis xyz="0 0 1"/></joint><link name="{name}"/>'
        for name in "bc"
    )
    robot = parse_urdf(f'<robot name="r"><link name="a"/>{text}</robot>')
    estimator = JointStateEstimator({"r": robot})
    speed = 100.0
    twists = np.zeros((3, 6))
    twists[1:, 5] = speed
    for step in range(20):
        n_links = 2 if step == 10 else 3
        turns = Rotation.from_rotvec([[0, 0, a * speed * step * DT] for a in (0, 1, 1)])
        poses = np.hstack([np.zeros((3, 3)), turns.as_quat()])[:n_links]
        names = ("r::a", "r::b", "r::c")[:n_links]
        stamp = round(1e9 * step * DT)
        (seen,) = estimator.update(names, poses, twists[:n_links], stamp)
    np.testing.assert_allclose(seen.positions, speed * 19 * DT)


@pytest.mark.parametrize("limits", [(), (-HALF, HALF)])
def test_a_clock_that_is_slower_than_the_messages_moves_no_turns(limits):
    """A clock of 100 Hz, states of 1 kHz; a wheel, and a joint beyond its stop."""
    joint, speed = Watched(*limits), 50.0
    for step in range(1000):
        joint.time = 0.01 * (step // 10) - DT
        position = speed * 0.001 * step
        if limits:
            position = HALF + 0.03 * np.sin(speed * 0.001 * step)
        slope = 0.03 * speed * np.cos(speed * 0.001 * step) if limits else speed
        read = joint.at(position, slope)
    assert read == pytest.approx(position, abs=1e-9)
