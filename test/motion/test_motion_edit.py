"""Motions that are cut, faster or elsewhere, and the smooth way to a pose."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BPoly
from scipy.spatial.transform import Rotation, Slerp

from g1_description.errors import InvalidValueError, MotionError, UnknownNameError
from g1_description.motion.edit import (
    base_speed,
    highest_speed,
    joined,
    joint_speeds,
    minimum_jerk,
    minimum_jerk_trajectory,
    moved,
    to_start_at,
)
from g1_description.motion.motion import Motion, sample
from g1_description.robot.description import Description, Joint, Link
from g1_description.robot.transform import IDENTITY


def motion(seed=0, velocities=True):
    random = np.random.RandomState(seed)
    quaternions = Rotation.from_quat(random.normal(size=(8, 4))).as_quat()
    return Motion(
        np.cumsum(random.uniform(0.05, 0.4, 8)),
        ("knee", "elbow"),
        random.normal(size=(8, 2)),
        random.normal(size=(8, 2)) if velocities else None,
        np.hstack([random.normal(size=(8, 3)), quaternions]),
    )


SHARES = st.floats(0.0, 1.0)


@pytest.mark.parametrize("velocities", [True, False])
@given(ends=st.tuples(SHARES, SHARES), share=SHARES)
def test_a_part_is_the_same_motion(velocities, ends, share):
    whole = motion(velocities=velocities)
    first, last = whole.times[0], whole.times[-1]
    begin, end = sorted(first + one * (last - first) for one in ends)
    part = whole.cut(begin, end)
    assert (part.times[0], part.times[-1]) == (begin, end)
    time = begin + share * (end - begin)
    wanted, found = sample(whole, time), sample(part, time)
    np.testing.assert_allclose(found.positions, wanted.positions, atol=1e-9)
    sign = np.sign(found.base_poses[3:] @ wanted.base_poses[3:])
    np.testing.assert_allclose(found.base_poses[:3], wanted.base_poses[:3], atol=1e-9)
    np.testing.assert_allclose(
        sign * found.base_poses[3:], wanted.base_poses[3:], atol=1e-9
    )


def test_all_of_it_is_the_same_to_the_last_bit():
    whole = motion()
    part = whole.cut()
    for name in ("times", "positions", "velocities", "base_poses"):
        assert (getattr(part, name) == getattr(whole, name)).all()


def test_what_is_no_part_is_told():
    whole = motion()
    with pytest.raises(InvalidValueError, match=r"0-0\.5 s is outside the motion"):
        whole.cut(0.0, 0.5)
    with pytest.raises(InvalidValueError, match="is outside the motion"):
        whole.cut(whole.times[3], whole.times[2])


def test_twice_the_speed_is_twice_the_velocities_in_half_the_time():
    whole = motion()
    fast = whole.at_speed(2.0, start=whole.times[0])
    assert fast.times[0] == 0.0
    for time in np.linspace(whole.times[0], whole.times[-2], 20):
        slow = sample(whole, time)
        quick = sample(fast, 0.5 * (time - whole.times[0]))
        np.testing.assert_allclose(quick.positions, slow.positions, atol=1e-9)
        np.testing.assert_allclose(quick.velocities, 2 * slow.velocities, atol=1e-8)


EDITS = {
    "cut": lambda m: m.cut(m.begin + 0.1, m.end - 0.1),
    "retimed": lambda m: m.at_speed(m.duration / 5.0),
    "resampled": lambda m: m.resampled(50.0),
    "fastest": lambda m: m.at_speed(2.0),
    "joined": lambda m: joined([m, motion(1)]),
    "blended": lambda m: joined([motion(1), m], 0.2),
}


@pytest.mark.parametrize("what", EDITS)
@given(begin=st.integers(-100, 1000))
def test_when_it_begins_does_not_change_how_long_it_lasts(what, begin):
    whole = motion()
    later = whole.at_speed(1.0, whole.begin - begin)
    assert later.end - later.begin == later.duration == pytest.approx(whole.duration)
    before, after = EDITS[what](whole), EDITS[what](later)
    assert after.duration == pytest.approx(before.duration, abs=1e-9)
    assert what != "retimed" or after.duration == pytest.approx(5.0)


def test_it_is_moved_as_a_whole():
    whole, turn = motion(), Rotation.from_rotvec([0.3, -0.4, 1.2])
    there = moved(whole, np.concatenate([[1.0, 2.0, 3.0], turn.as_quat()]))
    np.testing.assert_allclose(
        there.base_poses[:, :3],
        turn.apply(whole.base_poses[:, :3]) + np.array([1, 2, 3]),
    )
    wanted = turn * Rotation.from_quat(whole.base_poses[:, 3:])
    apart = wanted.inv() * Rotation.from_quat(there.base_poses[:, 3:])
    np.testing.assert_allclose(apart.as_rotvec(), 0.0, atol=1e-12)


@given(seed=st.integers(0, 100))
def test_it_begins_at_a_place_and_faces_as_the_robot_does(seed):
    whole = motion(seed)
    random = np.random.RandomState(seed + 1)
    turn = Rotation.from_quat(random.normal(size=4))
    pose = np.concatenate([random.normal(size=3), turn.as_quat()])
    there = to_start_at(whole, pose)
    first = there.base_poses[0]
    np.testing.assert_allclose(first[:2], pose[:2], atol=1e-12)
    np.testing.assert_allclose(
        there.base_poses[:, 2], whole.base_poses[:, 2], atol=1e-12
    )

    def heading(quaternion):
        x, y, _ = Rotation.from_quat(quaternion).apply([1.0, 0.0, 0.0])
        return np.arctan2(y, x)

    away = heading(first[3:]) - heading(pose[3:])
    assert abs((away + np.pi) % (2 * np.pi) - np.pi) < 1e-9
    # Up stays up: height of the tip of each axis above the base.
    before = Rotation.from_quat(whole.base_poses[:, 3:])
    after = Rotation.from_quat(there.base_poses[:, 3:])
    for axis in np.eye(3):
        np.testing.assert_allclose(
            before.apply(axis)[:, 2], after.apply(axis)[:, 2], atol=1e-9
        )


ANGLES = st.lists(st.floats(-10.0, 10.0), min_size=3, max_size=3).map(np.array)


SHARE = st.floats(-0.5, 1.5)


@given(ANGLES, ANGLES, SHARE, SHARE)
def test_a_smooth_way_never_overshoots_nor_turns_back(start, goal, one, other):
    sooner, later = (minimum_jerk(start, goal, share) for share in sorted([one, other]))
    for way in (sooner, later):
        assert (way >= np.minimum(start, goal)).all()
        assert (way <= np.maximum(start, goal)).all()
    assert ((later - sooner) * np.sign(goal - start) >= -1e-12).all()


@given(ANGLES, ANGLES)
def test_a_smooth_way_begins_and_ends_where_it_should(start, goal):
    for share in (0.0, -1.0):
        np.testing.assert_array_equal(minimum_jerk(start, goal, share), start)
    for share in (1.0, 2.0):
        np.testing.assert_array_equal(minimum_jerk(start, goal, share), goal)


@given(st.floats(0.0, 1.0))
def test_a_smooth_way_is_scipys_polynomial_at_rest_at_both_ends(share):
    """Velocity and acceleration are zero at the ends: that is minimum jerk."""
    rest = BPoly.from_derivatives([0.0, 1.0], [[-1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    way = minimum_jerk(np.array([-1.0]), np.array([2.0]), share)
    np.testing.assert_allclose(way, [rest(share)], atol=1e-12)


@given(st.floats(0.0, 1.0), st.floats(0.1, 100.0))
def test_a_sampled_way_is_the_same_with_its_velocities(share, seconds):
    rest = BPoly.from_derivatives([0.0, 1.0], [[-1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    start, goal = np.array([-1.0, 0.5]), np.array([2.0, 0.5])
    way = minimum_jerk_trajectory(("knee", "elbow"), start, goal, seconds)
    found = sample(way, share * seconds)
    np.testing.assert_allclose(found.positions, [rest(share), 0.5], atol=1e-6)
    velocities = found.velocities * seconds
    np.testing.assert_allclose(velocities, [rest(share, 1), 0.0], atol=1e-4)
    assert way.duration == seconds


def test_a_resampled_motion_is_the_same_motion():
    whole = motion()
    first, last = whole.times[0], whole.times[-1]
    found = whole.resampled(37.0)
    np.testing.assert_allclose(np.diff(found.times), 1 / 37.0)
    assert found.times[0] == first
    assert last - 1 / 37.0 < found.times[-1] <= last
    wanted = sample(whole, found.times)
    np.testing.assert_array_equal(found.positions, wanted.positions)
    np.testing.assert_array_equal(found.velocities, wanted.velocities)
    np.testing.assert_array_equal(found.base_poses, wanted.base_poses)


def test_resampled_at_its_own_rate_it_keeps_every_sample():
    times = np.arange(50) / 30.0
    values = np.outer(np.sin(times), [1.0, 2.0])
    whole = Motion(times, ("knee", "elbow"), values, values)
    found = whole.resampled(30.0)
    np.testing.assert_allclose(found.times, times, atol=1e-12)
    np.testing.assert_allclose(found.positions, values, atol=1e-9)
    assert (found.velocities[-1] == values[-1]).all()


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan, np.inf, 1e9])
def test_a_rate_that_makes_no_motion_is_told(rate):
    with pytest.raises(InvalidValueError, match=r"rate must be|samples at 1e\+09 Hz"):
        motion().resampled(rate)


def test_joined_motions_follow_one_another_from_place_to_place():
    first, second = motion(1), motion(2)
    second = second.arranged(("elbow", "knee"))
    whole = joined([first, second])
    n = len(first.times)
    np.testing.assert_array_equal(whole.times[:n], first.times)
    np.testing.assert_allclose(np.diff(whole.times[n:]), np.diff(second.times))
    mean = np.diff(second.times).mean()
    assert whole.times[n] - whole.times[n - 1] == pytest.approx(mean)
    np.testing.assert_array_equal(whole.positions[n:], second.positions[:, ::-1])
    np.testing.assert_allclose(
        whole.base_poses[n:],
        to_start_at(second, first.base_poses[-1]).base_poses,
        atol=1e-12,
    )
    still = joined([first, second], follows=False)
    np.testing.assert_array_equal(still.base_poses[n:], second.base_poses)


def test_blended_motions_run_smoothly_into_each_other():
    """Velocities are the derivative of the positions, through both seams."""
    times = np.arange(2000) / 1000.0
    one = Motion(
        times,
        ("knee",),
        np.sin(3 * times)[:, np.newaxis],
        3 * np.cos(3 * times)[:, np.newaxis],
    )
    other = Motion(
        times,
        ("knee",),
        2 + np.cos(2 * times)[:, np.newaxis],
        -2 * np.sin(2 * times)[:, np.newaxis],
    )
    whole = joined([one, other], blend=0.5)
    assert whole.duration == pytest.approx(2 * 1.999 - 0.5)
    slopes = np.gradient(whole.positions[:, 0], whole.times)
    np.testing.assert_allclose(slopes[1:-1], whole.velocities[1:-1, 0], atol=1e-3)
    assert np.abs(np.diff(whole.velocities[:, 0])).max() < 0.1
    np.testing.assert_array_equal(whole.positions[-1499:], other.positions[-1499:])
    np.testing.assert_array_equal(whole.positions[:1499], one.positions[:1499])


def test_blended_bases_turn_about_one_axis():
    slerp = Slerp([0, 1], Rotation.from_rotvec([[0, 0, 0.2], [0, 0.3, 1.0]]))
    times = np.arange(11) / 10.0
    poses = [np.tile([0, 0, 0, *q.as_quat()], (11, 1)) for q in slerp([0.0, 1.0])]
    poses[1][:, 0] = 1.0
    one, other = (Motion(times, (), np.zeros((11, 0)), None, p) for p in poses)
    whole = joined([one, other], blend=1.0, follows=False)
    share = minimum_jerk(np.zeros(1), np.ones(1), 0.3)[0]
    np.testing.assert_allclose(whole.base_poses[3, :3], [share, 0, 0], atol=1e-12)
    np.testing.assert_allclose(
        whole.base_poses[3, 3:], slerp([share])[0].as_quat(), atol=1e-12
    )


def test_what_cannot_be_joined_is_told():
    whole = motion()
    other = whole.renamed({"knee": "hip"})
    with pytest.raises(MotionError, match=r"Motion 2 .* hip, knee\."):
        joined([whole, other])
    with pytest.raises(MotionError, match="all or none must have a base"):
        joined([whole, replace(whole, base_poses=None)])
    with pytest.raises(InvalidValueError, match="blend must be from 0 to"):
        joined([whole, whole], blend=100.0)
    later = replace(whole, times=whole.times + 50.0)
    with pytest.raises(InvalidValueError, match="blend must be from 0 to"):
        joined([later, later], blend=30.0)


def test_joints_are_left_out_and_added_by_name():
    whole = motion()
    found = whole.arranged(("toe", "elbow"))
    np.testing.assert_array_equal(found.positions[:, 0], 0.0)
    np.testing.assert_array_equal(found.velocities[:, 1], whole.velocities[:, 1])
    lost = np.abs(whole.positions[:, 0]).max()
    assert found.notes == (
        f"Ignored joints: knee (up to {lost:.3g}).",
        "Joints added at 0: toe.",
    )


def test_joints_get_new_names():
    assert motion().renamed({"knee": "hip"}).joint_names == ("hip", "elbow")
    with pytest.raises(UnknownNameError, match=r"no joint 'kne'\. Its joints: knee"):
        motion().renamed({"kne": "hip"})
    with pytest.raises(MotionError, match="duplicate joints: elbow"):
        motion().renamed({"knee": "elbow"})


@pytest.mark.parametrize("velocities", [True, False])
def test_the_top_speed_is_that_of_a_fine_sampling(velocities):
    whole = motion(3, velocities)
    fine = sample(whole, np.linspace(whole.times[0], whole.times[-1], 200_000))
    np.testing.assert_allclose(
        joint_speeds(whole), np.abs(fine.velocities).max(axis=0), rtol=1e-6
    )
    linear = np.linalg.norm(fine.base_twists[:, :3], axis=1)
    assert base_speed(whole) == pytest.approx(linear.max())


def test_at_its_highest_speed_a_joint_is_at_its_limit():
    whole, limits = motion(4), np.array([3.0, 20.0])
    joints = [
        Joint(name, "revolute", "trunk", name, IDENTITY, velocity=limit)
        for name, limit in zip(("knee", "elbow"), limits)
    ]
    links = tuple(Link(name) for name in ("trunk", "knee", "elbow"))
    robot = Description("two", "trunk", links, tuple(joints))
    fast = whole.at_speed(highest_speed(whole, robot))
    assert (joint_speeds(fast) / limits).max() == pytest.approx(1.0)
    stuck = replace(robot, joints=(joints[0], replace(joints[1], velocity=0.0)))
    with pytest.raises(MotionError, match="elbow cannot move: its velocity limit is"):
        highest_speed(whole, stuck)
    resting = whole.positions * [1.0, 0.0]
    knee = replace(whole, positions=resting, velocities=whole.velocities * [1.0, 0.0])
    fast = knee.at_speed(highest_speed(knee, stuck))
    assert joint_speeds(fast)[0] == pytest.approx(3.0)
    still = replace(whole, positions=np.zeros((8, 2)), velocities=None)
    with pytest.raises(MotionError, match="No joint with a velocity limit moves"):
        highest_speed(still, robot)


@pytest.mark.parametrize("speed", [0.0, -1.0, np.nan])
def test_a_speed_that_is_none_and_nothing_to_join_are_refused(speed):
    with pytest.raises(InvalidValueError, match="speed must be greater than 0"):
        motion().at_speed(speed)
    with pytest.raises(InvalidValueError, match="no motions to join"):
        joined([])
