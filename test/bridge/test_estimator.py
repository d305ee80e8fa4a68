"""Several robots are seen in one message, wherever their links stand in it."""

import numpy as np
import pytest
from robots import robot

from g1_description.bridge.estimator import JointStateEstimator
from g1_description.robot.urdf import parse_urdf


def turned(angle):
    return [0.0, 0.0, 0.0, 0.0, 0.0, np.sin(0.5 * angle), np.cos(0.5 * angle)]


def show(estimator, angles, time=0.0):
    """Give it links turned about z by their scoped names."""
    poses = np.array([turned(angle) for angle in angles.values()]).reshape(-1, 7)
    twists, stamp = np.zeros((len(poses), 6)), round(1e9 * time)
    return estimator.update(tuple(angles), poses, twists, stamp)


def positions(states):
    return [state.positions_by_name for state in states]


def test_each_robot_finds_its_own_links_in_any_order():
    estimator = JointStateEstimator(
        {"a": robot("base", "tip"), "a::b": robot("base", "tip")}
    )
    observations = show(
        estimator,
        {
            "ground_plane::link": 9.0,
            "a::b::tip": 0.7,
            "a::tip": 0.3,
            "ab::tip": 2.0,
            "a::base": 0.1,
            "a::b::base": 0.2,
        },
    )
    assert positions(observations)[0]["to_tip"] == pytest.approx(0.2)
    assert positions(observations)[1]["to_tip"] == pytest.approx(0.5)
    assert observations[1].base_pose == pytest.approx(turned(0.2))


def test_a_link_may_have_a_scope_in_its_name():
    estimator = JointStateEstimator({"a": robot("base", "left::tip")})
    observations = show(estimator, {"a::base": 0.0, "a::left::tip": 0.4})
    assert positions(observations) == [{"to_left::tip": pytest.approx(0.4)}]


def test_a_robot_that_is_not_there_has_nothing():
    estimator = JointStateEstimator(
        {"a": robot("base", "tip"), "b": robot("base", "tip")}
    )
    observations = show(estimator, {"b::base": 0.0, "b::tip": 0.5})
    absent, present = observations
    assert [problems.is_present for problems in estimator.problems] == [False, True]
    assert present.stamp == absent.stamp == 0
    assert absent.base_pose is None
    assert positions(observations) == [{}, {"to_tip": pytest.approx(0.5)}]
    show(estimator, {})
    assert not any(problems.is_present for problems in estimator.problems)


def test_the_base_is_the_root_wherever_the_file_has_it():
    text = (
        '<robot name="r"><link name="hand"/><link name="base"/>'
        '<joint name="j" type="continuous"><parent link="base"/>'
        '<child link="hand"/></joint></robot>'
    )
    estimator = JointStateEstimator({"a": parse_urdf(text)})
    observations = show(estimator, {"a::hand": 0.3, "a::base": 0.1})
    assert observations[0].base_pose == pytest.approx(turned(0.1))
    without = show(estimator, {"a::hand": 0.3})
    assert without[0].base_pose is None


def test_the_twist_of_a_base_in_another_link_is_that_of_its_own_origin():
    text = (
        '<robot name="r"><link name="base"/><link name="body"/>'
        '<joint name="j" type="fixed"><origin xyz="0.5 0 0"/><parent link="base"/>'
        '<child link="body"/></joint></robot>'
    )
    estimator = JointStateEstimator({"a": parse_urdf(text)})
    pose, twist = np.array([turned(0.5 * np.pi)]), np.array([[1.0, 0, 0, 0, 0, 2.0]])
    (seen,) = estimator.update(("a::body",), pose, twist, 0)
    # The base is 0.5 m behind the body, which looks along y.
    assert seen.base_pose[:3] == pytest.approx([0.0, -0.5, 0.0])
    assert seen.base_twist == pytest.approx([2.0, 0, 0, 0, 0, 2.0])
    (seen,) = estimator.update(("a::base",), pose, twist, 0)
    assert seen.base_twist == pytest.approx(twist[0])


def test_the_base_is_what_floats_in_the_world():
    text = (
        '<robot name="r"><link name="world"/><link name="hip"/><link name="leg"/>'
        '<joint name="free" type="floating"><parent link="world"/>'
        '<child link="hip"/></joint><joint name="j" type="continuous">'
        '<parent link="hip"/><child link="leg"/><axis xyz="0 0 1"/></joint></robot>'
    )
    estimator = JointStateEstimator({"a": parse_urdf(text)})
    observations = show(estimator, {"a::hip": 0.1, "a::leg": 0.4})
    assert observations[0].base_pose == pytest.approx(turned(0.1))
    assert positions(observations) == [{"j": pytest.approx(0.3)}]


BAD = {
    "NaN in the pose": (0, np.nan, 1.0),
    "infinity in the pose": (2, np.inf, 1.0),
    "NaN in the quaternion": (5, np.nan, 1.0),
    "a zero quaternion": (0, 0.0, 0.0),
    "a quaternion too long": (0, 0.0, 1.002),
    "a quaternion too short": (0, 0.0, 0.998),
    "a place no robot is at": (1, 1e300, 1.0),
}


@pytest.mark.parametrize("kind", BAD)
def test_a_link_without_usable_numbers_counts_as_missing(kind):
    estimator = JointStateEstimator({"r": robot("a", "b", "c")})
    names = ("r::a", "r::b", "r::c")
    poses = np.array([turned(angle) for angle in (0.0, 0.2, 0.5)])
    twists = np.zeros((3, 6))
    column, number, scale = BAD[kind]
    invalid = poses.copy()
    invalid[2, column] = number
    invalid[2, 3:] *= scale
    for _ in range(2):
        observations = estimator.update(names, invalid, twists, 0)
        assert positions(observations) == [{"to_b": pytest.approx(0.2)}]
        assert estimator.problems == [(True, ("c",), ("c",), {})]
    whole = estimator.update(names, poses, twists, 0)
    assert positions(whole) == [
        {"to_b": pytest.approx(0.2), "to_c": pytest.approx(0.3)}
    ]


@pytest.mark.parametrize("scale", [0.9991, 1.0009])
def test_a_quaternion_almost_of_unit_length_is_normalised(scale):
    estimator = JointStateEstimator({"r": robot("a", "b")})
    poses = np.array([turned(0.0), turned(0.5)])
    poses[1, 3:] *= scale
    observations = estimator.update(("r::a", "r::b"), poses, np.zeros((2, 6)), 0)
    assert positions(observations) == [{"to_b": pytest.approx(0.5, abs=1e-12)}]
    assert not estimator.problems[0].are_any


def test_nan_in_a_twist_makes_its_link_missing_and_elsewhere_does_not_matter():
    estimator = JointStateEstimator({"r": robot("a", "b")})
    poses = np.array([turned(0.0), turned(0.5), turned(0.0)])
    twists = np.zeros((3, 6))
    names = ("r::a", "r::b", "other::a")
    twists[2], poses[2] = np.nan, np.inf
    estimator.update(names, poses, twists, 0)
    assert estimator.problems[0].invalid == ()
    twists[1, 4] = np.nan
    estimator.update(names, poses, twists, 0)
    assert estimator.problems[0].invalid == ("b",)


def test_of_equal_names_the_first_counts_and_they_are_named():
    estimator = JointStateEstimator({"r": robot("a", "b")})
    poses = np.array([turned(angle) for angle in (0.0, 0.5, 0.9)])
    observations = estimator.update(
        ("r::a", "r::b", "r::b"), poses, np.zeros((3, 6)), 0
    )
    assert positions(observations) == [{"to_b": pytest.approx(0.5)}]
    assert estimator.duplicates == ("r::b",)


def test_problems_are_others_when_the_robots_links_changed():
    estimator = JointStateEstimator({"a": robot("base", "tip"), "b": robot("base")})
    both = {"a::base": 0.0, "a::tip": 0.0, "b::base": 0.0}

    def changed(angles):
        before = estimator.problems or [None, None]
        show(estimator, angles)
        return [new is not old for new, old in zip(estimator.problems, before)]

    assert changed(both) == [True, True]
    assert changed(both) == [False, False]
    assert changed({"x::y": 0.0, **both}) == [False, False]
    assert changed({"a::base": 0.0, "b::base": 0.0}) == [True, False]
    assert changed({"a::base": 0.0, "b::base": np.nan}) == [False, True]


def test_the_arrays_of_robots_are_views_of_common_ones():
    estimator = JointStateEstimator({"a": robot("base", "tip"), "b": robot("base")})
    one, other = show(estimator, {"a::base": 0.0, "a::tip": 0.0, "b::base": 0.0})
    assert one.positions.base is not None
    assert one.positions.base is other.positions.base


def wound_up():
    """Give an estimator of a joint that has turned by 20 rad."""
    estimator = JointStateEstimator({"r": robot("a", "b")})
    for step in range(1, 101):
        observations = show(estimator, {"r::a": 0.0, "r::b": 0.2 * step}, 0.001 * step)
    assert positions(observations)[0]["to_b"] == pytest.approx(20.0)
    return estimator


def test_turns_are_counted_through_a_message_without_the_link():
    estimator = wound_up()
    show(estimator, {"r::a": 0.0}, 0.101)
    observations = show(estimator, {"x::y": 0.0, "r::a": 0.0, "r::b": 20.3}, 0.102)
    assert positions(observations)[0]["to_b"] == pytest.approx(20.3)


def test_turns_begin_anew_after_a_reset():
    estimator = wound_up()
    estimator.reset()
    observations = show(estimator, {"r::a": 0.0, "r::b": 20.3}, 0.101)
    assert positions(observations)[0]["to_b"] == pytest.approx(20.3 - 6 * np.pi)


def test_turns_begin_anew_for_a_robot_that_was_gone():
    estimator = wound_up()
    show(estimator, {"other::a": 0.0}, 0.101)
    observations = show(estimator, {"r::a": 0.0, "r::b": 20.3}, 0.102)
    assert positions(observations)[0]["to_b"] == pytest.approx(20.3 - 6 * np.pi)


def test_turns_begin_anew_for_a_joint_not_seen_for_long():
    estimator = wound_up()
    show(estimator, {"r::a": 0.0}, 0.2)
    observations = show(estimator, {"r::a": 0.0, "r::b": 20.3}, 1.2)
    assert positions(observations)[0]["to_b"] == pytest.approx(20.3 - 6 * np.pi)


def test_a_fast_wheel_keeps_its_turns_where_messages_are_far_apart():
    """4 rad from one message to the next: its velocity tells how far it went."""
    estimator = JointStateEstimator({"r": robot("a", "b")})
    twists = np.array([[0.0] * 6, [0.0] * 5 + [200.0]])
    for step in range(200):
        poses = np.array([turned(0.0), turned(4.0 * step)])
        observations = estimator.update(
            ("r::a", "r::b"), poses, twists, 20_000_000 * step
        )
    assert positions(observations)[0]["to_b"] == pytest.approx(4.0 * 199)


def test_a_joint_that_was_put_elsewhere_counts_its_turns_anew():
    estimator = JointStateEstimator({"r": robot("a", "b")})
    for step in range(101):
        show(estimator, {"r::a": 0.0, "r::b": 0.2 * step})
    observations = show(estimator, {"r::a": 0.0, "r::b": 3.0})
    assert positions(observations)[0]["to_b"] == pytest.approx(3.0)
