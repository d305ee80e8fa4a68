"""Hulls with fewer points, beside the nearest points that least squares find."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls
from scipy.spatial import ConvexHull

from g1_description.sim.meshes.hulls import MAX_WHOLE, thinned, thinned_hulls
from g1_description.sim.meshes.shapes import Mesh, Part

WEIGHT = 1e3
"""Of the sum of the shares, which is one."""


def distance(points, hull):
    """Find how far a point is from a convex hull: from the best mix of its corners."""
    corners = np.vstack([hull.T, np.full(len(hull), WEIGHT)])
    shares, _ = nnls(corners, np.append(points, WEIGHT))
    return np.linalg.norm(hull.T @ (shares / shares.sum()) - points)


def outermost(points, hull, number):
    """Select the points that are highest above the planes of a hull."""
    planes = ConvexHull(hull).equations
    heights = (points @ planes[:, :3].T + planes[:, 3]).max(axis=1)
    return points[np.argsort(-heights)[:number]]


def blob(seed, n_points, sizes):
    """Scatter points on a bent ellipsoid."""
    random = np.random.RandomState(seed)
    points = random.normal(size=(n_points, 3))
    points /= np.linalg.norm(points, axis=1)[:, np.newaxis]
    points[:, 2] += 0.3 * points[:, 0] ** 2
    return points * sizes


@given(
    seed=st.integers(0, 1000),
    n_points=st.integers(MAX_WHOLE + 1, 2000),
    sizes=st.tuples(*[st.floats(0.01, 0.5)] * 3),
    tolerance=st.floats(5e-4, 5e-3),
)
@settings(max_examples=8, deadline=None)
def test_no_point_is_farther_than_is_said(seed, n_points, sizes, tolerance):
    points = blob(seed, n_points, sizes)
    few, deviation = thinned(points, tolerance)
    assert deviation <= tolerance
    found = [distance(p, few) for p in outermost(points, few, 5)]
    assert max(found) <= deviation + 1e-6
    # They are some of the points.
    apart = np.abs(points[:, np.newaxis] - few).max(axis=2).min(axis=0)
    assert apart.max() < 1e-6


def test_the_deviation_is_that_of_the_farthest_point():
    points = blob(1, 1000, (0.3, 0.2, 0.1))
    few, deviation = thinned(points, 0.01)
    assert len(few) < 100
    far = max(distance(p, few) for p in outermost(points, few, 50))
    assert deviation == pytest.approx(far, abs=1e-6)


def test_a_blade_keeps_its_edge():
    # A millimetre beyond the edge is a few micrometres above the planes beside it.
    along, beyond = np.meshgrid(np.linspace(0.0, 0.2, 40), np.linspace(0.0, 0.2, 40))
    sides = [np.stack([along, beyond, s * 0.002 * (0.2 - beyond)], -1) for s in (-1, 1)]
    points = np.concatenate(sides).reshape(-1, 3)
    points[:, 1] += 0.01 * np.sin(15.0 * points[:, 0])  # the edge is an arc
    few, deviation = thinned(points, 1e-3)
    assert deviation <= 1e-3
    edge = points[points[:, 1] > 0.19]
    assert max(distance(p, few) for p in edge) <= deviation + 1e-6


def test_what_is_flat_or_small_is_left_alone():
    square = np.random.RandomState(1).uniform(size=(500, 3)) * (1.0, 1.0, 0.0)
    for points in (square, square[:, :1] * (1.0, 2.0, 3.0), square[:100]):
        few, deviation = thinned(points, 1e-3)
        assert few is points and deviation == 0.0


@pytest.mark.parametrize(("size", "tolerance"), [(0.3, 0.0), (4e4, 1e-3)])
def test_any_size_and_no_tolerance(size, tolerance):
    points = blob(3, 2000, (size, 0.7 * size, 0.4 * size)).astype(np.float32)
    few, deviation = thinned(points, tolerance)
    assert deviation <= tolerance
    lost = ConvexHull(points).volume - ConvexHull(few).volume
    assert lost <= ConvexHull(points).area * tolerance + 1e-9


def test_a_ball_keeps_its_volume():
    radius = 2.0
    number = np.arange(1000) + 0.5
    z, turn = 1.0 - number / 500.0, np.pi * (1.0 + 5.0**0.5) * number
    across = np.sqrt(1.0 - z**2)
    ball = np.stack([across * np.cos(turn), across * np.sin(turn), z], -1) * radius
    corners = ball[ConvexHull(ball).simplices]
    parts = (Part(corners, np.zeros_like(corners), None),)
    (few,), deviation = thinned_hulls(Mesh(Path("ball.stl"), parts), 1.0)
    assert ConvexHull(few).volume > 0.9 * ConvexHull(ball).volume
    assert deviation <= min(1e-3, 0.04 * radius)


@pytest.mark.both_engines
def test_a_model_tells_how_far_its_meshes_are_from_their_hulls(make_world, vendors_g1):
    bench = make_world("limp")
    bench.spawn_urdf("g1", vendors_g1, np.array([0.0, 0.0, 0.8, 0.0, 0.0, 0.0, 1.0]))
    found = bench.model("g1").hull_deviations
    by_file = {name.rpartition("/")[2]: value for name, value in found.items()}
    assert 5e-4 < by_file["torso_link.STL"] <= 1e-3
    assert len(by_file) > 10 and max(by_file.values()) <= 1e-3
