"""Several robots are seen in one message, wherever their links stand in it."""

import numpy as np
import pytest
from robots import robot

from g1_description.core.bridge.observer import Observer
from g1_description.core.urdf.reader import parse_urdf


def turned(angle):
    return [0.0, 0.0, 0.0, 0.0, 0.0, np.sin(0.5 * angle), np.cos(0.5 * angle)]


def see(observer, angles, time=0.0):
    """Show links turned about z by their scoped names."""
    poses = np.array([turned(angle) for angle in angles.values()]).reshape(-1, 7)
    return observer.see(tuple(angles), poses, np.zeros((len(poses), 6)), time)


def positions(sight):
    return [
        dict(zip(s.joints.names, sight.measured.position[s.span])) for s in sight.shares
    ]


def test_each_robot_finds_its_own_links_in_any_order():
    observer = Observer({"a": robot("base", "tip"), "a::b": robot("base", "tip")})
    sight = see(
        observer,
        {
            "ground_plane::link": 9.0,
            "a::b::tip": 0.7,
            "a::tip": 0.3,
            "ab::tip": 2.0,
            "a::base": 0.1,
            "a::b::base": 0.2,
        },
    )
    assert positions(sight)[0]["to_tip"] == pytest.approx(0.2)
    assert positions(sight)[1]["to_tip"] == pytest.approx(0.5)
    assert sight.base_pose(sight.shares[1]) == pytest.approx(turned(0.2))


def test_a_link_may_have_a_scope_in_its_name():
    observer = Observer({"a": robot("base", "left::tip")})
    sight = see(observer, {"a::base": 0.0, "a::left::tip": 0.4})
    assert positions(sight) == [{"to_left::tip": pytest.approx(0.4)}]


def test_a_robot_that_is_not_there_has_nothing():
    observer = Observer({"a": robot("base", "tip"), "b": robot("base", "tip")})
    sight = see(observer, {"b::base": 0.0, "b::tip": 0.5})
    absent, present = sight.shares
    assert not absent.is_there
    assert present.is_there
    assert sight.base_pose(absent) is None
    assert positions(sight) == [{}, {"to_tip": pytest.approx(0.5)}]
    empty = see(observer, {})
    assert not any(share.is_there for share in empty.shares)


def test_the_base_is_the_root_wherever_the_file_has_it():
    text = (
        '<robot name="r"><link name="hand"/><link name="base"/>'
        '<joint name="j" type="continuous"><parent link="base"/>'
        '<child link="hand"/></joint></robot>'
    )
    observer = Observer({"a": parse_urdf(text)})
    sight = see(observer, {"a::hand": 0.3, "a::base": 0.1})
    assert sight.base_pose(sight.shares[0]) == pytest.approx(turned(0.1))
    without = see(observer, {"a::hand": 0.3})
    assert without.base_pose(without.shares[0]) is None


def test_the_base_is_what_floats_in_the_world():
    text = (
        '<robot name="r"><link name="world"/><link name="hip"/><link name="leg"/>'
        '<joint name="free" type="floating"><parent link="world"/>'
        '<child link="hip"/></joint><joint name="j" type="continuous">'
        '<parent link="hip"/><child link="leg"/><axis xyz="0 0 1"/></joint></robot>'
    )
    observer = Observer({"a": parse_urdf(text)})
    sight = see(observer, {"a::hip": 0.1, "a::leg": 0.4})
    assert sight.base_pose(sight.shares[0]) == pytest.approx(turned(0.1))
    assert positions(sight) == [{"j": pytest.approx(0.3)}]


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
    observer = Observer({"r": robot("a", "b", "c")})
    names = ("r::a", "r::b", "r::c")
    poses = np.array([turned(angle) for angle in (0.0, 0.2, 0.5)])
    twists = np.zeros((3, 6))
    column, number, scale = BAD[kind]
    broken = poses.copy()
    broken[2, column] = number
    broken[2, 3:] *= scale
    for _ in range(2):
        sight = observer.see(names, broken, twists, 0.0)
        assert positions(sight) == [{"to_b": pytest.approx(0.2)}]
        assert sight.shares[0].broken == ("c",)
        assert sight.shares[0].joints.missing == ("c",)
    whole = observer.see(names, poses, twists, 0.0)
    assert positions(whole) == [
        {"to_b": pytest.approx(0.2), "to_c": pytest.approx(0.3)}
    ]


@pytest.mark.parametrize("scale", [0.9991, 1.0009])
def test_a_quaternion_almost_of_unit_length_is_normalised(scale):
    observer = Observer({"r": robot("a", "b")})
    poses = np.array([turned(0.0), turned(0.5)])
    poses[1, 3:] *= scale
    sight = observer.see(("r::a", "r::b"), poses, np.zeros((2, 6)), 0.0)
    assert positions(sight) == [{"to_b": pytest.approx(0.5, abs=1e-12)}]
    assert not sight.off_axis


def test_nan_in_a_twist_makes_its_link_missing_and_elsewhere_does_not_matter():
    observer = Observer({"r": robot("a", "b")})
    poses = np.array([turned(0.0), turned(0.5), turned(0.0)])
    twists = np.zeros((3, 6))
    names = ("r::a", "r::b", "other::a")
    twists[2], poses[2] = np.nan, np.inf
    assert observer.see(names, poses, twists, 0.0).shares[0].broken == ()
    twists[1, 4] = np.nan
    assert observer.see(names, poses, twists, 0.0).shares[0].broken == ("b",)


def test_of_equal_names_the_first_counts_and_they_are_named():
    observer = Observer({"r": robot("a", "b")})
    poses = np.array([turned(angle) for angle in (0.0, 0.5, 0.9)])
    sight = observer.see(("r::a", "r::b", "r::b"), poses, np.zeros((3, 6)), 0.0)
    assert positions(sight) == [{"to_b": pytest.approx(0.5)}]
    assert observer.twice == ("r::b",)


def wound_up():
    """Give an observer of a joint that has turned by 20 rad."""
    observer = Observer({"r": robot("a", "b")})
    for step in range(1, 101):
        sight = see(observer, {"r::a": 0.0, "r::b": 0.2 * step}, 0.001 * step)
    assert positions(sight)[0]["to_b"] == pytest.approx(20.0)
    return observer


def test_turns_are_counted_through_a_message_without_the_link():
    observer = wound_up()
    see(observer, {"r::a": 0.0}, 0.101)
    sight = see(observer, {"x::y": 0.0, "r::a": 0.0, "r::b": 20.3}, 0.102)
    assert positions(sight)[0]["to_b"] == pytest.approx(20.3)


def test_turns_begin_anew_after_a_reset():
    observer = wound_up()
    observer.reset()
    sight = see(observer, {"r::a": 0.0, "r::b": 20.3}, 0.101)
    assert positions(sight)[0]["to_b"] == pytest.approx(20.3 - 6 * np.pi)


def test_turns_begin_anew_for_a_robot_that_was_gone():
    observer = wound_up()
    see(observer, {"other::a": 0.0}, 0.101)
    sight = see(observer, {"r::a": 0.0, "r::b": 20.3}, 0.102)
    assert positions(sight)[0]["to_b"] == pytest.approx(20.3 - 6 * np.pi)


def test_turns_begin_anew_for_a_joint_not_seen_for_long():
    observer = wound_up()
    see(observer, {"r::a": 0.0}, 0.2)
    sight = see(observer, {"r::a": 0.0, "r::b": 20.3}, 1.2)
    assert positions(sight)[0]["to_b"] == pytest.approx(20.3 - 6 * np.pi)


def test_a_fast_wheel_keeps_its_turns_where_messages_are_far_apart():
    """4 rad from one message to the next: its velocity tells how far it went."""
    observer = Observer({"r": robot("a", "b")})
    twists = np.array([[0.0] * 6, [0.0] * 5 + [200.0]])
    for step in range(200):
        poses = np.array([turned(0.0), turned(4.0 * step)])
        sight = observer.see(("r::a", "r::b"), poses, twists, 0.02 * step)
    assert positions(sight)[0]["to_b"] == pytest.approx(4.0 * 199)


def test_a_joint_that_was_put_elsewhere_counts_its_turns_anew():
    observer = Observer({"r": robot("a", "b")})
    for step in range(101):
        see(observer, {"r::a": 0.0, "r::b": 0.2 * step})
    sight = see(observer, {"r::a": 0.0, "r::b": 3.0})
    assert positions(sight)[0]["to_b"] == pytest.approx(3.0)
