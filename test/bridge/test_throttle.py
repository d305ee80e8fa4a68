"""A pose is sent when it moved, turned, or was sent a while ago."""

import numpy as np
import pytest

from g1_description.bridge.tf_filter import PoseThrottle
from g1_description.robot.rotation import from_axis_angle

HOME = np.array([0.0, 0.0, 0.793, 0.0, 0.0, 0.0, 1.0])


@pytest.fixture
def throttle():
    throttle = PoseThrottle(0.005, 0.01, 0.05)
    assert throttle.passes(1.0, HOME)
    return throttle


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
