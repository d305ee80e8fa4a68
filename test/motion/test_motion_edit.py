"""Motions that are cut, faster or elsewhere, and the smooth way to a pose."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BPoly
from scipy.spatial.transform import Rotation

from g1_description.errors import InvalidValueError
from g1_description.motion.edit import (
    at_speed,
    cut,
    minimum_jerk,
    minimum_jerk_trajectory,
    moved,
    to_start_at,
)
from g1_description.motion.motion import Motion, sample


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
    part = cut(whole, begin, end)
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
    part = cut(whole)
    for name in ("times", "positions", "velocities", "base_poses"):
        assert (getattr(part, name) == getattr(whole, name)).all()


def test_what_is_no_part_is_told():
    whole = motion()
    with pytest.raises(InvalidValueError, match=r"0-0\.5 s is outside the motion"):
        cut(whole, 0.0, 0.5)
    with pytest.raises(InvalidValueError, match="is outside the motion"):
        cut(whole, whole.times[3], whole.times[2])


def test_twice_the_speed_is_twice_the_velocities_in_half_the_time():
    whole = motion()
    fast = at_speed(whole, 2.0, start=whole.times[0])
    assert fast.times[0] == 0.0
    for time in np.linspace(whole.times[0], whole.times[-2], 20):
        slow = sample(whole, time)
        quick = sample(fast, 0.5 * (time - whole.times[0]))
        np.testing.assert_allclose(quick.positions, slow.positions, atol=1e-9)
        np.testing.assert_allclose(quick.velocities, 2 * slow.velocities, atol=1e-8)


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
