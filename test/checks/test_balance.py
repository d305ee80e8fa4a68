"""Support polygons and their margins agree with scipy; ZMPs with the equations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial import ConvexHull

from g1_description.checks.support import (
    margins,
    support_margin,
    support_polygon,
    zero_moment_point,
)

POINTS = arrays(
    float, st.tuples(st.integers(3, 12), st.just(2)), elements=st.integers(-50, 50)
)


@given(POINTS)
def test_the_polygon_is_scipys(points):
    if np.linalg.matrix_rank(points[1:] - points[0]) < 2:
        assert len(support_polygon(points)) <= 2
        return
    hull = points[ConvexHull(points).vertices]
    found = np.array(support_polygon(points))
    assert {*map(tuple, found)} == {*map(tuple, hull)}
    area = np.cross(found, np.roll(found, -1, axis=0)).sum() / 2.0
    assert area == pytest.approx(ConvexHull(points).volume)


@given(POINTS, st.tuples(st.integers(-60, 60), st.integers(-60, 60)))
def test_inside_the_margin_is_the_distance_to_the_nearest_side(points, place):
    if np.linalg.matrix_rank(points[1:] - points[0]) < 2:
        return
    point = np.array(place, dtype=float)
    equations = ConvexHull(points).equations
    beyond = (equations[:, :2] @ point + equations[:, 2]).max()
    margin = support_margin(support_polygon(points), *point)
    if beyond <= 0.0:
        assert margin == pytest.approx(-beyond, abs=1e-9)
    else:
        corners = points[ConvexHull(points).vertices]
        share = np.linspace(0.0, 1.0, 2001)[:, np.newaxis]
        sides = [
            a + share * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0))
        ]
        nearest = np.linalg.norm(np.concatenate(sides) - point, axis=1).min()
        assert margin == pytest.approx(-nearest, abs=0.01)


def test_what_bears_on_a_point_or_a_line_has_no_inside():
    assert support_margin(support_polygon(np.zeros((2, 2))), 3.0, 4.0) == -5
    line = support_polygon(np.array([[0.0, 0], [2, 0], [1, 0]]))
    assert support_margin(line, 1.0, 0.0) == 0.0
    assert support_margin(line, 1.0, 1.0) == -1.0


def test_nothing_is_said_where_nothing_bears():
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    found = margins([square, np.zeros((0, 2))], np.full((2, 2), 0.5))
    np.testing.assert_array_equal(found, [0.5, np.nan])


def test_the_zero_moment_point_of_a_point_mass():
    """X - z ax / (az + g), the cart-table model, above a floor of any height."""
    mass, place, acceleration = 3.0, np.array([0.4, -0.2, 0.9]), [1.0, -2.0, 0.5]
    force = mass * np.add(acceleration, [0.0, 0.0, 9.8])
    wrench = np.concatenate([force, np.cross(place, force)])
    found = zero_moment_point(wrench, mass * 9.8, floor=0.1)
    lever = 0.8 / (0.5 + 9.8)
    np.testing.assert_allclose(found, [0.4 - lever, -0.2 + 2.0 * lever], atol=1e-12)
    wrench[2] = 0.01
    assert np.isnan(zero_moment_point(wrench, mass * 9.8, 0.0)).all()
