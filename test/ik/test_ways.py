"""Ways from here to there, with the speeds that are given."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import angle_of
from scipy.spatial.transform import Rotation, Slerp

from g1_description import arc, line, turn
from g1_description.errors import InvalidValueError

ROTATION = [0.0, 0.0, 0.0, 1.0]
UP = [0.0, 0.0, 1.0]


def unit(vector):
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


def poses(random, count):
    places = random.uniform(-1.0, 1.0, (count, 3))
    return np.concatenate([places, unit(random.normal(size=(count, 4)))], axis=1)


@settings(max_examples=25)
@given(
    st.integers(0, 1000),
    st.floats(0.1, 2.0),
    st.floats(0.2, 5.0),
    st.sampled_from(["line", "arc", "turn"]),
)
def test_ways_keep_to_speeds_and_go_where_they_should(seed, speed, acceleration, kind):
    random = np.random.default_rng(seed)
    start, middle, end = poses(random, 3)
    options = {"speed": speed, "acceleration": acceleration, "period": 0.005}
    if kind == "line":
        times, way = line(start, end, **options)
    elif kind == "arc":
        times, way = arc(start, middle[:3], end, **options)
    else:
        angle, axis = random.uniform(-7.0, 7.0), middle[3:6]
        times, way = turn(start, middle[:3], axis, angle, **options)
        turned = Rotation.from_rotvec(angle * unit(axis))
        there = turned.apply(start[:3] - middle[:3]) + middle[:3]
        end = [*there, *(turned * Rotation.from_quat(start[3:])).as_quat()]
    steps = np.diff(times)
    assert (steps <= 0.005 + 1e-12).all()
    rates = np.diff(way[:, :3], axis=0) / steps[:, np.newaxis]
    turns = Rotation.from_quat(way[:, 3:])
    turned = (turns[1:] * turns[:-1].inv()).as_rotvec()
    angles = np.linalg.norm(turned, axis=1) / steps
    assert np.linalg.norm(rates, axis=1).max() <= speed * (1.0 + 1e-9)
    assert angles.max() <= 1.0 + 1e-9
    tangent = np.diff(np.linalg.norm(rates, axis=1)) / steps[1:]
    assert np.abs(tangent).max() <= acceleration * (1.0 + 1e-6)
    along = unit(rates[1:] + rates[:-1])
    changes = np.diff(rates, axis=0) / steps[1:, np.newaxis]
    across = changes - np.sum(along * changes, axis=1, keepdims=True) * along
    assert np.linalg.norm(across, axis=1).max() <= acceleration * (1.0 + 1e-3)
    assert np.abs(np.diff(angles)).max() <= acceleration * steps[0] * (1.0 + 1e-6)
    for row, given_pose in ((0, start), (-1, end)):
        np.testing.assert_allclose(way[row, :3], given_pose[:3], atol=1e-9)
        away = turns[row].inv() * Rotation.from_quat(given_pose[3:])
        assert angle_of(away) < 1e-6
    if kind == "arc":
        nearest = np.linalg.norm(way[:, :3] - middle[:3], axis=1).min()
        assert nearest < 0.005 * speed
        _, spread, _ = np.linalg.svd(way[:, :3] - way[0, :3], full_matrices=False)
        assert spread[2] < 1e-9
    if kind == "line":
        shares = np.linalg.norm(way[:, :3] - start[:3], axis=1)
        slerp = Slerp([0.0, shares[-1]], Rotation.from_quat([start[3:], end[3:]]))
        apart = slerp(np.minimum(shares, shares[-1])) * turns.inv()
        assert np.linalg.norm(apart.as_rotvec(), axis=1).max() < 1e-6


@pytest.mark.parametrize(
    ("make", "problem"),
    [
        (lambda: line(UP, [*UP, *ROTATION]), "must both be positions, or both poses"),
        (lambda: line(UP, [0, 0]), r"end must be three finite numbers .* or a pose"),
        (lambda: line(UP, [0, 0, 0, 0, 0, 0, 2]), "end quaternion must have length 1"),
        (lambda: line(UP, UP, speed=0.0), "speed must be a number greater than 0"),
        (lambda: line(UP, UP, period=np.nan), "period must be a number greater than"),
        (lambda: arc([0, 0, 0], UP, [0, 0, 2]), "are on a line: use line"),
        (lambda: arc(UP, [0, 0, 0], UP), "are on a line: use line"),
        (lambda: turn(UP, UP, [0, 0, 0], 1.0), "axis must not have length 0"),
        (lambda: turn(UP, UP, UP, np.inf), "angle must be a number in rad"),
    ],
)
def test_a_wrong_way_is_refused_in_a_sentence(make, problem):
    with pytest.raises(InvalidValueError, match=problem):
        make()


def test_a_way_to_where_it_begins_has_one_sample():
    times, way = line(UP, UP)
    assert times.tolist() == [0.0]
    assert way.tolist() == [UP]
