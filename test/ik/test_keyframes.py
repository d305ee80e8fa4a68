"""Motions through keyframes."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import SLIDER, chains
from scipy.spatial.transform import Rotation

from g1_description import Robot
from g1_description.errors import InvalidValueError
from g1_description.ik.inverse_kinematics import InverseKinematics
from g1_description.ik.keyframes import PASS, PERIOD, STOP, Keyframe, keyframe_pieces

FEET = ("left_ankle_roll_link", "right_ankle_roll_link")
BASE = np.array([0.0, 0.0, 0.7634, 0.0, 0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def g1():
    return Robot()


@pytest.fixture(scope="module")
def pick_up(g1):
    """Stand, reach to the floor, lift, and step with the right foot."""
    stand = g1.named_configuration("stand")
    down = g1.ik({"left_hand": [0.25, 0.3, 0.15]}, stand, BASE, balance=True)
    up = g1.ik({"left_hand": [0.3, 0.2, 0.9]}, stand, BASE, balance=True)
    foot = g1.link_poses(up.positions, up.base)[FEET[1]].copy()
    foot[:3] += [0.15, 0.0, 0.05]
    step = g1.ik({"right_foot": foot}, up.positions, up.base)
    assert down.reached
    assert up.reached
    assert step.reached
    return [
        Keyframe(0.0, stand, BASE),
        Keyframe(1.0, down.positions, down.base),
        Keyframe(2.5, up.positions, up.base),
        Keyframe(3.5, step.positions, step.base),
    ]


def through(robot, frames, way=STOP, feet=FEET):
    inverse = InverseKinematics(robot.description)
    *_, made = keyframe_pieces(robot.description, inverse, feet, frames, way)
    return made


def speeds(motion):
    return np.diff(motion.positions, axis=0) / np.diff(motion.times)[:, np.newaxis]


def at(motion, time):
    return int(np.argmin(np.abs(motion.times - time)))


@pytest.mark.parametrize("way", [STOP, PASS])
def test_keyframes_are_passed_and_standing_feet_stay(g1, pick_up, way):
    made = through(g1, pick_up, way)
    motion = made.motion
    np.testing.assert_allclose(made.times, [0.0, 1.0, 2.5, 3.5], atol=1e-12)
    np.testing.assert_allclose(np.diff(motion.times), PERIOD, atol=1e-12)
    for frame in pick_up:
        row = at(motion, frame.time)
        np.testing.assert_allclose(motion.positions[row], frame.positions, atol=1e-9)
        turn = motion.base_poses[row, 3:] @ frame.base[3:]
        assert abs(turn) == pytest.approx(1.0)
        np.testing.assert_allclose(motion.base_poses[row, :3], frame.base[:3])
    places = [
        g1.link_poses(q, base) for q, base in zip(motion.positions, motion.base_poses)
    ]
    lifted = at(motion, 2.5)
    for foot, last in ((FEET[0], len(places)), (FEET[1], lifted + 1)):
        poses = np.array([place[foot] for place in places[:last]])
        np.testing.assert_allclose(
            poses[:, :3], poses[:1, :3].repeat(last, 0), atol=3e-4
        )
        turns = Rotation.from_quat(poses[:, 3:])
        angles = np.linalg.norm((turns[0].inv() * turns).as_rotvec(), axis=1)
        assert angles.max() < 2e-3
    assert places[-1][FEET[1]][0] - places[lifted][FEET[1]][0] > 0.14
    assert (g1.lower <= motion.positions).all()
    assert (motion.positions <= g1.upper).all()


@pytest.mark.parametrize("way", [STOP, PASS])
def test_a_motion_rests_at_its_ends_and_at_keyframes_where_it_stops(g1, way):
    stand, squat = g1.named_configuration("stand"), g1.named_configuration("squat")
    half = stand + 0.5 * (squat - stand)
    times, rows = (0.0, 1.0, 2.0), (stand, half, squat)
    frames = [Keyframe(t, q, BASE) for t, q in zip(times, rows)]
    moved = np.abs(speeds(through(g1, frames, way, ()).motion)).max(axis=1)
    assert moved[0] < 0.06
    assert moved[-1] < 0.06
    assert (moved[49] < 0.06) == (way == STOP)


def test_nothing_overshoots_between_two_keyframes(g1, pick_up):
    motion = through(g1, pick_up, PASS, ()).motion
    for first, last in zip(pick_up, pick_up[1:]):
        rows = slice(at(motion, first.time), at(motion, last.time) + 1)
        both = np.stack([first.positions, last.positions])
        assert (motion.positions[rows] >= both.min(axis=0) - 1e-9).all()
        assert (motion.positions[rows] <= both.max(axis=0) + 1e-9).all()


def test_times_that_are_too_short_are_lengthened(g1, pick_up):
    short = [f._replace(time=PERIOD * n) for n, f in enumerate(pick_up)]
    made = through(g1, short, PASS)
    relative = np.abs(speeds(made.motion)) / g1.velocity_limits
    assert relative.max() <= 1.0
    assert (np.diff(made.times)[:2] > PERIOD).all()
    assert made.times[-1] < 1.5


def test_the_checks_find_nothing_invalid_in_it(g1, pick_up):
    motion = through(g1, pick_up).motion
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        verdict = g1.check(motion)
    assert not {"position", "velocity"} & {f.check for f in verdict.findings}


@pytest.mark.parametrize(
    ("times", "problem"),
    [((0.0,), "at least two keyframes"), ((0.0, 0.0), "times of keyframes must incr")],
)
def test_invalid_keyframes_are_refused(g1, times, problem):
    frames = [Keyframe(t, g1.named_configuration("stand"), BASE) for t in times]
    with pytest.raises(InvalidValueError, match=problem):
        through(g1, frames)


def test_keyframes_beyond_limits_and_joints_without_speeds_make_no_endless_motion(g1):
    stand = g1.named_configuration("stand")
    beyond = stand.copy()
    beyond[3] = g1.upper[3] + 0.5
    frames = [Keyframe(0.0, stand, BASE), Keyframe(1.0, beyond, BASE)]
    made = through(g1, frames)
    assert made.times == (0.0, 1.0)
    assert made.motion.positions[-1, 3] == pytest.approx(g1.upper[3])
    still = Robot(SLIDER.replace('velocity="0.5"', 'velocity="0"'))
    ends = [Keyframe(t, np.array([t]), BASE) for t in (0.0, 1.0)]
    made = through(still, ends, feet=())
    assert made.times == (0.0, 1.0)
    assert made.motion.duration == pytest.approx(1.0)


@settings(max_examples=8)
@given(
    chains(max_joints=5),
    st.integers(0, 1000),
    st.integers(2, 5),
    st.sampled_from([STOP, PASS]),
)
def test_motions_of_any_robot_keep_to_its_limits(chain, seed, count, way):
    robot, random = Robot(chain[0]), np.random.default_rng(seed)
    lower = np.where(np.isfinite(robot.lower), robot.lower, -3.0)
    upper = np.where(np.isfinite(robot.upper), robot.upper, 3.0)
    times = np.cumsum(random.uniform(0.02, 0.5, count))
    frames = []
    for time in times - times[0]:
        base = np.concatenate([random.uniform(-1, 1, 3), random.normal(size=4)])
        base[3:] /= np.linalg.norm(base[3:])
        frames.append(Keyframe(time, random.uniform(lower, upper), base))
    made = through(robot, frames, way, ())
    motion = made.motion
    assert (np.abs(speeds(motion)) <= robot.velocity_limits).all()
    assert (motion.positions >= robot.lower - 1e-9).all()
    assert (motion.positions <= robot.upper + 1e-9).all()
    norms = np.linalg.norm(motion.base_poses[:, 3:], axis=1)
    np.testing.assert_allclose(norms, 1.0, atol=1e-9)
    for frame, time in zip(frames, made.times):
        row = at(motion, time)
        np.testing.assert_allclose(motion.positions[row], frame.positions, atol=1e-9)
