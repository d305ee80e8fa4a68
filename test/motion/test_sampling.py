"""A motion between its samples, held against scipy's splines and rotations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline, interp1d
from scipy.spatial.transform import Rotation, Slerp

from g1_description.errors import MotionError
from g1_description.motion.motion import Motion, sample

NAMES = ("knee", "elbow")


def random_motion(seed, has_velocities=False, n_samples=7):
    random = np.random.default_rng(seed)
    times = np.cumsum(random.uniform(0.01, 1.0, n_samples))
    velocities = random.normal(size=(n_samples, 2)) if has_velocities else None
    turns = Rotation.from_quat(random.normal(size=(n_samples, 4))).as_quat()
    turns *= random.choice([-1.0, 1.0], (n_samples, 1))
    base = np.concatenate([random.normal(size=(n_samples, 3)), turns], axis=1)
    positions = random.normal(size=(n_samples, 2))
    return Motion(times, NAMES, positions, velocities, base)


@given(st.integers(0, 1000), st.booleans())
def test_between_samples_it_is_where_scipy_puts_it(seed, has_velocities):
    motion = random_motion(seed, has_velocities)
    times = np.random.default_rng(seed).uniform(motion.times[0], motion.times[-1], 20)
    found = sample(motion, times)
    if has_velocities:
        spline = CubicHermiteSpline(motion.times, motion.positions, motion.velocities)
        np.testing.assert_allclose(found.velocities, spline(times, 1), atol=1e-9)
    else:
        spline = interp1d(motion.times, motion.positions, axis=0)
    np.testing.assert_allclose(found.positions, spline(times), atol=1e-12)
    line = interp1d(motion.times, motion.base_poses[:, :3], axis=0)
    np.testing.assert_allclose(found.base_poses[:, :3], line(times), atol=1e-12)
    turns = Slerp(motion.times, Rotation.from_quat(motion.base_poses[:, 3:]))(times)
    apart = turns.inv() * Rotation.from_quat(found.base_poses[:, 3:])
    assert np.abs(apart.as_rotvec()).max() < 1e-9


@given(st.integers(0, 1000), st.booleans())
def test_velocities_are_the_slopes_of_positions(seed, has_velocities):
    motion = random_motion(seed, has_velocities)
    random, h = np.random.default_rng(seed), 1e-6
    gaps = np.diff(motion.times)
    times = motion.times[:-1] + gaps * random.uniform(0.01, 0.99, gaps.shape)
    before, now, after = (sample(motion, times + step) for step in (-h, 0.0, h))
    slopes = (after.positions - before.positions) / (2 * h)
    np.testing.assert_allclose(now.velocities, slopes, atol=2e-3)
    places = (after.base_poses - before.base_poses)[:, :3] / (2 * h)
    np.testing.assert_allclose(now.base_twists[:, :3], places, atol=1e-5)
    begin = Rotation.from_quat(before.base_poses[:, 3:])
    turned = Rotation.from_quat(after.base_poses[:, 3:]) * begin.inv()
    spins = turned.as_rotvec() / (2 * h)
    np.testing.assert_allclose(now.base_twists[:, 3:], spins, atol=1e-5)


@pytest.mark.parametrize("has_velocities", [False, True])
def test_at_a_sample_it_is_the_sample_to_the_last_bit(has_velocities):
    motion = random_motion(3, has_velocities, n_samples=100)
    stamps = np.round(motion.times * 1e9).astype(int)
    for times in (motion.times, 1e-9 * stamps):
        found = sample(motion, times)
        np.testing.assert_array_equal(found.positions, motion.positions)
        np.testing.assert_array_equal(found.base_poses, motion.base_poses)


@pytest.mark.parametrize("time", [-1.0, 0.0, 1e6])
def test_it_rests_before_its_beginning_and_after_its_end(time):
    motion = random_motion(5, has_velocities=True)
    found = sample(motion, time)
    row = -1 if time > 0 else 0
    np.testing.assert_array_equal(found.positions, motion.positions[row])
    np.testing.assert_array_equal(found.base_poses, motion.base_poses[row])
    assert not found.velocities.any()
    assert not found.base_twists.any()


def test_it_rests_at_its_end():
    motion = random_motion(6, has_velocities=True)
    found = sample(motion, motion.times[-1])
    np.testing.assert_array_equal(found.positions, motion.positions[-1])
    assert not found.velocities.any()


def test_one_sample_is_a_configuration():
    motion = Motion(np.zeros(1), NAMES, np.array([[0.1, 0.2]]))
    for time in (-1.0, 0.0, 2.0):
        found = sample(motion, time)
        assert found.positions.tolist() == [0.1, 0.2]
        assert found.velocities.tolist() == [0.0, 0.0]
        assert found.base_poses is None


@pytest.mark.parametrize(
    ("words", "changes"),
    [
        ("no samples", {"times": np.zeros(0), "positions": np.zeros((0, 2))}),
        ("must increase: sample 3 is at 1 s", {"times": np.array([0.0, 1.0, 1.0])}),
        ("duplicate joints: knee", {"joint_names": ("knee", "knee")}),
        ("position array", {"positions": np.zeros((3, 1))}),
        ("position of sample 2 .*nan", {"positions": "nan"}),
        ("velocity of .*inf", {"velocities": "inf"}),
        ("quaternion .*got 0", {"base_poses": np.zeros((3, 7))}),
    ],
)
def test_what_is_no_motion_is_told(words, changes):
    arrays = {
        "times": np.array([0.0, 1.0, 2.0]),
        "joint_names": NAMES,
        "positions": np.zeros((3, 2)),
    }
    for name, value in changes.items():
        if isinstance(value, str):
            value = np.array([[0.0, 0.0], [0.0, float(value)], [0.0, 0.0]])
        arrays[name] = value
    with pytest.raises(MotionError, match=words):
        Motion(**arrays)


def test_a_motion_is_printed_by_its_size():
    """Numbers of thousands of samples would hide all else in a terminal."""
    motion = Motion(np.array([0.0, 0.5]), ("a", "b"), np.zeros((2, 2)))
    text = "<Motion: 2 samples from 0 to 0.5 s, 2 joints, without a base>"
    assert repr(motion) == text
