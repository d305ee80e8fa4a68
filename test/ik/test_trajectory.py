"""Smooth trajectories along targets, and the splines that they are."""

import re

import numpy as np
import pytest
from robots import BASE, SLIDER
from scipy.interpolate import BSpline
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from g1_description import Robot, TrajectoryBounds
from g1_description.errors import InvalidValueError
from g1_description.ik.sampled import left_jacobian, steady_acceleration
from g1_description.ik.splines import (
    ControlBounds,
    Quadratic,
    Rows,
    basis,
    excess,
    minimized,
    products_of,
)
from g1_description.ik.ways import line

HANDS = "left_hand", "right_hand"
WHOLE = {"balance": True, "avoid_collisions": True, "floor": 0.0}


def rates(rows, times):
    """Differentiate rows twice, by central differences."""
    speeds = np.diff(rows, axis=0) / np.diff(times)[:, np.newaxis]
    changes = np.diff(speeds, axis=0) / np.diff(times)[1:, np.newaxis]
    return np.abs(speeds).max(axis=0), np.abs(changes).max(axis=0)


def assert_is_within(g1, motion, bounds):
    """Assert that base and joints are within the limits and bounds."""
    places = motion.base_poses[:, :3]
    relative = Rotation.from_quat(motion.base_poses[:, 3:])
    turns = (relative[1:] * relative[:-1].inv()).as_rotvec().cumsum(axis=0)
    speeds, changes = rates(motion.positions, motion.times)
    assert (speeds <= g1.velocity_limits).all()
    assert changes.max() <= bounds.joint_acceleration
    for rows, fastest, quickest in (
        (places, bounds.base_speed, bounds.base_acceleration),
        (turns, bounds.base_turn_rate, bounds.base_turn_acceleration),
    ):
        speeds, changes = rates(rows, motion.times[-len(rows) :])
        assert speeds.max() <= fastest
        assert changes.max() <= quickest
    assert not g1.check(motion, only=("position", "velocity")).findings


@pytest.fixture(scope="module")
def hands(g1):
    """Times, and poses of the hands while they go out, to one side and down."""
    standing = g1.named_configuration("stand")
    begin = [g1.link_poses(standing, BASE)[g1.profile.links[one]][:3] for one in HANDS]
    times, way = line(np.zeros(3), [0.2, -0.15, -0.25], speed=0.25)
    return standing, times, {one: at + way for one, at in zip(HANDS, begin)}


def test_a_path_is_followed_smoothly_and_passes_the_check(g1, hands):
    standing, times, targets = hands
    path = g1.ik_trajectory(times, targets, standing, BASE, **WHOLE)
    assert path.message == ""
    assert min(result.margin for result in path.results) >= 0.029
    assert_is_within(g1, path.motion, TrajectoryBounds())
    assert g1.check(path.motion).findings == ()
    changes = rates(path.motion.positions, times)[1]
    assert changes.max() < 5.0  # the hands' accelerations are those of 0.2 Hz
    ways = {
        name: lambda time, of=of: of[np.searchsorted(times, time)]
        for name, of in targets.items()
    }
    again = g1.ik_trajectory(times, ways, standing, BASE, **WHOLE)
    np.testing.assert_array_equal(again.motion.positions, path.motion.positions)


def test_what_cannot_be_followed_is_near_smooth_and_explained(g1, hands):
    standing, times, targets = hands
    far = {name: of.copy() for name, of in targets.items()}
    far["left_hand"][60:90, 0] += 0.5
    bounds = TrajectoryBounds(base_speed=0.3, joint_acceleration=8.0)
    path = g1.ik_trajectory(
        times,
        far,
        standing,
        BASE,
        bounds=bounds,
        weights={"left_hand": np.inf},  # which the feet and balance must not mind
        **WHOLE,
    )
    assert min(result.margin for result in path.results) > 0.028
    missed = [row for row, result in enumerate(path.results) if not result.reached]
    assert 10 <= missed[0] <= 60
    assert path.message.startswith(
        f"Not all is reached in {len(missed)} of {len(times)} samples, first at "
        f"{times[missed[0]]:.2f} s. Not reached: "
    )
    assert re.search("There .*_joint is at its l", path.message)
    assert "The largest distance from its target is that of " in path.message
    assert_is_within(g1, path.motion, bounds)
    checked = g1.check(path.motion, only=("skating", "drift", "jump", "base_jump"))
    assert checked.findings == ()


def test_the_zero_moment_point_is_kept_inside_where_that_is_needed(g1, hands):
    standing, times, targets = hands
    fast = 1.1 * times / times[-1]
    missing = [
        g1.check(
            g1.ik_trajectory(fast, targets, standing, BASE, balance=balance).motion
        ).figures["largest_missing_wrench"]
        for balance in (True, "zmp")
    ]
    assert missing[0] > 0.002
    assert missing[1] < 0.001
    with pytest.raises(InvalidValueError, match="is for smooth trajectories"):
        g1.ik({"left_hand": targets["left_hand"][0]}, standing, BASE, balance="zmp")


def test_a_hand_that_goes_too_far_is_as_near_as_balance_lets_it(g1, hands):
    standing, times, _ = hands
    times = 2.0 * times / times[-1]
    far = np.stack([0.35 + 0.4 * times, 0.25 + 0.0 * times, 1.0 + 0.0 * times], 1)
    path = g1.ik_trajectory(times, {"left_hand": far}, standing, BASE, balance="zmp")
    errors = [one.errors["left_hand"].position for one in path.results]
    assert errors[0] < 0.2
    assert errors[-1] < 0.6  # three times as far if it stood still
    for foot in ("left_foot", "right_foot"):
        assert max(one.errors[foot].position for one in path.results) < 2e-3


def test_hands_that_would_go_through_the_robot_give_way(g1, hands):
    standing, times, _ = hands
    times = times[:40]
    random = np.random.default_rng(1)
    phases = 9.0 * times[:, np.newaxis] + random.uniform(0.0, 6.0, 6)
    swing, middle = np.sin(phases)[..., np.newaxis], np.array([0.2, 0.0, 0.8])
    targets = {
        name: np.mean(swing * random.normal(size=(6, 3)), axis=1) + middle
        for name in HANDS
    }
    path = g1.ik_trajectory(times, targets, standing, BASE, **WHOLE)
    near = g1.self_collisions(path.motion.positions, path.motion.base_poses)
    assert near.distance.min(initial=0.0) > -0.003


@pytest.mark.parametrize("smooth", [True, False])
def test_a_foot_that_steps_supports_the_robot_while_it_stands(g1, smooth):
    standing = g1.named_configuration("stand")
    times = np.arange(0.0, 5.01, 0.04)
    shares = np.clip((times - 1.5) / [[0.8], [1.6]], 0.0, 1.0)
    up, forward = np.minimum(shares[0], 2.0 * (1.0 - shares[1])), shares[1]
    foot = g1.link_poses(standing, BASE)[g1.profile.links["left_foot"]]
    foot = np.tile(foot, (len(times), 1))
    foot[:, 2] += 0.1 * up**2 * (3.0 - 2.0 * up)
    foot[:, 0] += 0.15 * forward**2 * (3.0 - 2.0 * forward)
    path = g1.ik_trajectory(
        times, {"left_foot": foot}, standing, BASE, balance=True, smooth=smooth
    )
    assert path.message == ""
    found = g1.check(path.motion, only=("center_of_mass",))
    assert found.figures["least_center_margin"] > 0.01


@pytest.mark.parametrize("value", [0.0, np.nan, "fast", True])
def test_a_wrong_bound_is_refused(value):
    with pytest.raises(InvalidValueError, match="base_speed must be a number greater"):
        TrajectoryBounds(base_speed=value)


@pytest.mark.parametrize(
    ("given", "problem"),
    [
        ({"bounds": {"base_speed": 1.0}}, "bounds must be TrajectoryBounds"),
        ({"smooth": "no"}, "smooth must be True or False"),
        ({"targets": {"head": lambda t: np.zeros(2)}}, "target of head must be a pos"),
        (
            {"targets": {"head": lambda t: [0, 0, 1, 0, 0, 0, 1][: 3 if t else 7]}},
            "targets of head must have a rotation at all times, or at none",
        ),
        ({"balance": "zmp", "smooth": False}, "is for smooth trajectories"),
        ({"times": [0.0, 2000.0]}, "lasts from 0.001 to 300 s .got 2000."),
        ({"targets": {3: np.ones(3)}}, "by the names of links .got 3"),
    ],
)
def test_a_wrong_request_is_refused_in_a_sentence(g1, given, problem):
    request = {"times": [0.0, 1.0], "targets": {"left_hand": np.ones((2, 3))}}
    with pytest.raises(InvalidValueError, match=problem):
        g1.ik_trajectory(**{**request, **given})


def test_the_base_may_turn_further_than_half_a_turn_and_tumble(g1):
    times = np.linspace(0.0, 8.0, 101)
    yaw = 0.7 * times
    turned = np.zeros((101, 7))
    turned[:, 2], turned[:, 5] = 0.8, np.sin(0.5 * yaw)
    turned[:, 6] = np.cos(0.5 * yaw)
    path = g1.ik_trajectory(
        times, {"pelvis": turned}, base=BASE, fixed_links=(), base_motion="free"
    )
    assert path.message == ""
    assert_is_within(g1, path.motion, TrajectoryBounds())
    vectors = np.random.default_rng(6).normal(0.0, 2.0, (6, 3))
    tumbled = np.stack([np.interp(times, np.linspace(0, 8, 6), v) for v in vectors.T])
    turned[:, 3:] = Rotation.from_rotvec(tumbled.T).as_quat()
    bounds = TrajectoryBounds(base_turn_rate=1.0, base_turn_acceleration=2.0)
    path = g1.ik_trajectory(
        times, {"pelvis": turned}, base=BASE, fixed_links=(), bounds=bounds
    )
    assert_is_within(g1, path.motion, bounds)
    turned[:, 3:5] = 0.0
    turned[:, 5:] = np.stack([np.sin(yaw), np.cos(yaw)], axis=1)
    with pytest.raises(InvalidValueError, match="turns by more than 360 degrees"):
        g1.ik_trajectory(
            1.5 * times, {"pelvis": turned}, fixed_links=(), base_motion="free"
        )


@pytest.mark.parametrize("smooth", [True, False])
def test_a_joint_without_velocity_stays(smooth):
    still = Robot(SLIDER.replace('velocity="0.5"', 'velocity="0"'))
    link = still.link_names[-1]
    way = np.linspace([0.0, 0.0, 0.0], [0.3, 0.3, 0.3], 20)
    times = np.arange(20) / 10.0
    path = still.ik_trajectory(times, {link: way}, [0.1], smooth=smooth)
    assert set(path.motion.positions.flat) == {0.1}


@pytest.mark.parametrize("angle", [1e-5, 1.0, 5.5])
def test_turns_are_the_derivatives_of_rotations(angle):
    vector, rate, change = np.random.default_rng(0).normal(size=(3, 1, 3))
    vector *= angle / np.linalg.norm(vector)
    step = 1e-4
    steps = step * np.arange(-1.0, 2.0)[:, np.newaxis]
    rotations = Rotation.from_rotvec(vector + steps * rate + 0.5 * steps**2 * change)
    before, after = (rotations[1:] * rotations[:2].inv()).as_rotvec() / step
    found = (left_jacobian(vector) @ change[..., np.newaxis])[..., 0]
    found += steady_acceleration(vector, rate)
    np.testing.assert_allclose(found[0], (after - before) / step, rtol=0, atol=1e-5)


def test_samples_see_control_points_as_those_of_b_splines():
    count, period, begin = 9, 0.2, 3.0
    times = np.random.default_rng(0).uniform(begin, begin + 6 * period, 30)
    knots = begin + period * np.arange(-3, count + 1)
    for order in range(3):
        spline = BSpline(knots, np.eye(count), 3).derivative(order)
        found = basis(times, begin, period, count, order).toarray()
        np.testing.assert_allclose(found, spline(times), rtol=0, atol=1e-9)


def test_the_least_squares_are_those_of_scipy():
    random, count, columns = np.random.default_rng(0), 9, 3
    seen = basis(np.sort(random.uniform(0.0, 1.0, 40)), 0.0, 1.0 / 6.0, count)
    matrix, goals = random.normal(size=(40, 4, columns)), random.normal(size=(40, 4))
    quadratic = Quadratic(count, columns)
    quadratic.add_samples(products_of(seen), np.swapaxes(matrix, 1, 2) @ matrix)
    quadratic.gradient -= seen.T @ np.einsum("nij,ni->nj", matrix, goals)
    for order in range(4):
        weights = np.full((count - order, columns), 0.1 * (order + 1))
        quadratic.add_differences(order, weights)
    limits = [
        ControlBounds(order, -edge, edge, 1e3)
        for order, edge in enumerate((0.2, 0.1, 0.05))
    ]
    samples = np.sort(random.integers(0, 5, 12))
    samples[:5] = np.arange(5)
    samples.sort()
    given = random.normal(size=(12, columns)), random.uniform(0.0, 0.1, 12)
    limits.append(Rows(seen.tocsr()[[3, 9, 20, 31, 38]], samples, *given, 1e2))

    def cost(flat):
        points = flat.reshape(count, columns)
        errors = np.einsum("nij,nj->ni", matrix, seen @ points) - goals
        found = (errors**2).sum()
        for order in range(4):
            found += 0.1 * (order + 1) * (np.diff(points, order, axis=0) ** 2).sum()
        for one in limits:
            found += one.weight * (excess(one, one.values(points)) ** 2).sum()
        return 0.5 * found

    least = minimize(cost, np.zeros(count * columns), options={"gtol": 1e-8})
    found = minimized(quadratic, limits).ravel()
    begin = cost(np.zeros(count * columns))
    assert cost(found) - least.fun < 1e-2 * (begin - least.fun)
