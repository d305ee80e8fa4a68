"""Pictures of motions: their size, their colours, and what thinning keeps."""

import io
from dataclasses import replace

import numpy as np
import pytest
from checked import POST, post_motion
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from g1_description.checks.checker import Checker
from g1_description.checks.plot import motion_plot
from g1_description.checks.plot_panels import COLORS, MAX_BINS, bars, in_limits, thinned
from g1_description.motion.motion import Motion
from g1_description.motion.trajectory import Trajectory
from g1_description.robot.urdf import parse_urdf

ROBOT = parse_urdf(POST)


@pytest.fixture(scope="module")
def checker():
    return Checker(ROBOT)


def drawn(checker, trajectory):
    verdict = checker.check(Motion(trajectory))
    joints = ROBOT.movable_joints
    return motion_plot("a.csv", verdict, joints)


def count(picture, color):
    """Count the pixels of nearly a colour."""
    wanted = [int(color[k : k + 2], 16) for k in (1, 3, 5)]
    pixels = np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"), dtype=int)
    return int((np.abs(pixels - wanted).max(axis=2) < 12).sum())


def test_a_picture_shows_what_failed_and_is_the_same_again(checker):
    clean, failed = (drawn(checker, post_motion(reach)) for reach in (0.5, 1.5))
    assert drawn(checker, post_motion(0.5)) == clean
    for picture in (clean, failed):
        width, height = Image.open(io.BytesIO(picture)).size
        assert width == 1600
        assert 300 < height < 2000
        assert picture.startswith(b"\x89PNG")
    assert count(clean, COLORS["failed"]) < 10
    assert count(failed, COLORS["failed"]) > 1000


@pytest.mark.parametrize(
    "trajectory",
    [
        Trajectory(np.zeros(1), ("arm_joint",), np.zeros((1, 1))),
        Trajectory(np.arange(3.0), (), np.zeros((3, 0)), base_poses=np.eye(7)[[6] * 3]),
    ],
    ids=["one sample without a base", "a base without joints"],
)
def test_any_motion_is_drawn(checker, trajectory):
    assert drawn(checker, trajectory).startswith(b"\x89PNG")


@settings(max_examples=10)
@given(st.integers(4 * MAX_BINS + 1, 9 * MAX_BINS), st.integers(0, 2**31 - 1))
def test_thinning_keeps_peaks_and_order(n, seed):
    random = np.random.RandomState(seed)
    times, values = np.cumsum(random.random_sample(n)), random.standard_normal(n)
    x, y = thinned(times, values)
    assert len(x) == len(y) <= 3 * MAX_BINS
    assert (np.diff(x) >= 0.0).all()
    assert {values.min(), values.max()} <= {y.min(), y.max()}
    assert x[0] == times[0]


@given(st.lists(st.tuples(st.floats(0, 10), st.floats(0, 10)).map(sorted), max_size=6))
def test_marked_times_cover_all_and_do_not_overlap(intervals):
    found = bars(intervals, np.array([0.0, 10.0]))
    ends = [(begin, begin + width) for begin, width in found]
    for first, last in intervals:
        assert any(a <= first + 1e-9 and last <= b + 1e-9 for a, b in ends)
    assert all(b < c for (_, b), (c, _) in zip(ends, ends[1:]))
    assert all(width >= 0.03 - 1e-9 for _, width in found)


def test_limits_are_at_minus_one_and_one():
    joint = replace(ROBOT.movable_joints[0], lower=-0.2, upper=2.8)
    found = in_limits(joint, np.array([-0.2, 1.3, 2.8, 4.3]))
    np.testing.assert_allclose(found, [-1.0, 0.0, 1.0, 2.0], atol=1e-12)
