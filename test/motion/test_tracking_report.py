"""What is told of a motion that motors followed, held against numpy over all steps."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from g1_description.errors import InvalidValueError
from g1_description.motion.tracking import FallDetector, FallLimits, TrackingRecorder

MAX_LEAN, MAX_DROP = FallLimits().lean, FallLimits().drop
NAMES = ("hip", "knee", "elbow")


def recorded(errors, at_limit, time_step=0.01, group=7):
    recorder = TrackingRecorder(NAMES)
    every, times = np.arange(len(NAMES)), time_step * np.arange(len(errors))
    for begin in range(0, len(errors), group):
        part = slice(begin, begin + group)
        recorder.add(times[part], every, errors[part], np.array(at_limit[part]))
    return recorder


@given(st.integers(0, 1000), st.integers(1, 50), st.integers(1, 20))
def test_errors_are_those_of_all_steps_together(seed, steps, group):
    random = np.random.default_rng(seed)
    errors = random.normal(size=(steps, len(NAMES)))
    errors[0] = 0.0  # else what is before the motion is reached does not count
    at_limit = random.uniform(size=errors.shape) < 0.3
    report = recorded(errors, at_limit, group=group).report(None)
    np.testing.assert_allclose(report.rms_errors, np.sqrt((errors**2).mean(axis=0)))
    np.testing.assert_array_equal(report.largest_errors, np.abs(errors).max(axis=0))
    np.testing.assert_allclose(report.limit_shares, at_limit.mean(axis=0))
    worst = 0.01 * np.abs(errors).argmax(axis=0) if steps > 1 else np.full(3, np.nan)
    np.testing.assert_allclose(report.largest_error_times, worst)
    first = np.where(at_limit.any(axis=0), 0.01 * at_limit.argmax(axis=0), np.nan)
    np.testing.assert_allclose(report.first_limit_times, first)
    assert report.duration == pytest.approx((steps - 1) * 0.01)


def test_a_joint_counts_for_as_long_as_the_motion_moves_it():
    recorder = recorded(np.array([[0.1, -0.3, 0.2]]), [[False, True, False]])
    last = np.array([[0.3, -0.2]]), np.array([[True, False]])
    recorder.add(np.array([0.01]), np.array([0, 2]), *last)
    report = recorder.report(None)
    rms = [math.sqrt((0.01 + 0.09) / 2.0), 0.3, 0.2]
    np.testing.assert_allclose(report.rms_errors, rms)
    np.testing.assert_allclose(report.largest_errors, [0.3, 0.3, 0.2])
    np.testing.assert_allclose(report.limit_shares, [0.5, 1.0, 0.0])


def test_a_jump_to_the_first_sample_hides_no_error_of_the_motion():
    """The hip jumps, the knee never comes there, the elbow begins there."""
    jump = 0.36 * 0.9 ** np.arange(100)
    late = np.where(np.arange(100) == 80, 0.02, 0.001)
    hip = np.where(jump > 0.01, jump, late)
    errors = np.stack([hip, 0.2 + jump, late], axis=1)
    at_limit = np.stack([jump > 0.1, jump < 0.0, jump < 0.0], axis=1)
    report = recorded(errors, at_limit).report(None)
    since = errors[np.argmax(jump <= 0.01) :, 0]
    rms = [np.sqrt((e**2).mean()) for e in (since, errors[:, 1], late)]
    np.testing.assert_allclose(report.rms_errors, rms)
    np.testing.assert_allclose(report.largest_errors, [0.02, 0.56, 0.02])
    np.testing.assert_allclose(report.largest_error_times, [0.8, 0.0, 0.8])
    np.testing.assert_allclose(report.limit_shares, at_limit.mean(axis=0))
    assert report.first_limit_times[0] == 0.0


def test_a_report_without_steps_has_no_errors():
    report = TrackingRecorder(NAMES).report(None)
    assert report.duration == 0.0
    assert not report.rms_errors.any()
    assert np.isnan([report.largest_error_times, report.first_limit_times]).all()


def test_the_text_lists_the_worst_joints_first():
    errors = np.full((301, 3), [0.01, 0.2, 0.1])
    text = str(recorded(errors, [[False, True, False]] * 301).report(1.234))
    head, _, *rows = text.splitlines()
    assert "3 joints followed for 3.00 s" in head
    assert "it fell after 1.23 s" in head
    assert [row.split()[0] for row in rows] == ["knee", "elbow", "hip"]
    assert rows[0].split()[1:] == ["0.2000", "0.2000", "0.00", "s", "100.0", "%"]
    assert "did not fall" in str(recorded(errors, [[False] * 3] * 301).report(None))


def pose(height=0.8, yaw=0.0, lean=0.0, way=0.0, x=0.0):
    """Place a base that leans about a level axis."""
    axis = np.array([math.cos(way), math.sin(way), 0.0])
    turn = Rotation.from_rotvec(lean * axis) * Rotation.from_euler("z", yaw)
    return np.array([x, 0.0, height, *turn.as_quat()])


@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_a_base_that_leans_too_far_has_fallen_wherever_it_looks(yaw, turned, way):
    detector = FallDetector(pose(yaw=yaw), None)
    now = {"yaw": yaw + turned, "way": way}
    assert not detector.has_fallen(pose(lean=MAX_LEAN - 0.01, **now), None)
    assert detector.has_fallen(pose(lean=MAX_LEAN + 0.01, **now), None)


def test_a_base_leans_with_the_motion():
    """A motion that lies down wants it lying; who stands then leans from it."""
    detector = FallDetector(pose(), pose(yaw=1.0))
    assert not detector.has_fallen(pose(lean=1.5), pose(lean=1.5, yaw=1.0, way=1.0))
    assert detector.has_fallen(pose(), pose(lean=1.5))


def test_a_base_that_sinks_below_the_motions_has_fallen():
    """Heights count from where both began: the motion's floor may be elsewhere."""
    detector = FallDetector(pose(0.8), pose(1.1, x=3.0))
    assert not detector.has_fallen(pose(0.5), pose(0.8 + MAX_DROP - 0.01))
    assert detector.has_fallen(pose(0.5), pose(0.8 + MAX_DROP + 0.01))


def test_without_a_base_in_the_motion_a_robot_may_squat():
    assert not FallDetector(pose(0.8), None).has_fallen(pose(0.3), None)


@given(st.floats(0.1, 3.0), st.floats(-3.0, 3.0))
def test_limits_of_a_fall_may_be_others(lean, way):
    detector = FallDetector(pose(), None, FallLimits(lean=lean))
    assert not detector.has_fallen(pose(lean=lean - 0.01, way=way), None)
    assert detector.has_fallen(pose(lean=lean + 0.01, way=way), None)
    low = FallDetector(pose(0.8), pose(0.8), FallLimits(drop=0.4))
    assert not low.has_fallen(pose(0.41), pose(0.8))
    assert low.has_fallen(pose(0.39), pose(0.8))


@pytest.mark.parametrize(
    "numbers", [{"lean": -0.1}, {"lean": 4.0}, {"lean": math.nan}, {"drop": -0.1}]
)
def test_limits_of_a_fall_that_make_no_sense_are_refused(numbers):
    (name,) = numbers
    with pytest.raises(InvalidValueError, match=f"{name} must"):
        FallLimits(**numbers)
