"""What the bridge measures: links of several robots, whole turns, velocities.

Links are placed by scipy, and PyBullet tells how fast its joints are.
"""

import numpy as np
import pytest
from conftest import REPOSITORY
from robots import robot
from scipy.spatial.transform import Rotation

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


def test_a_joint_off_its_axis_is_reported_once_that_has_lasted():
    text = (
        '<robot name="r"><link name="base"/><link name="tip"/>'
        '<joint name="j" type="continuous"><parent link="base"/>'
        '<child link="tip"/><axis xyz="1 0 0"/></joint></robot>'
    )
    estimator = JointStateEstimator({"a": parse_urdf(text)})
    found = []
    for number, angle in enumerate([0.0, 0.5, 0.5, 0.0, 0.2, 0.3, 0.4, 0.5, 0.0, 0.3]):
        show(estimator, {"a::base": 0.0, "a::tip": angle}, time=number)
        found += [estimator.problems[0].axis_residual]
    assert found == [*[{}] * 6, *({"j": pytest.approx(a)} for a in (0.4, 0.5)), {}, {}]
    show(estimator, {"a::base": 0.0, "a::tip": 0.3}, time=30.0)
    assert estimator.problems[0].axis_residual
    estimator.reset()
    show(estimator, {"a::base": 0.0, "a::tip": 0.0}, time=1.0)
    assert not estimator.problems[0].axis_residual


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
    "a zero quaternion": (0, 0.0, 0.0),
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


def test_a_quaternion_almost_of_unit_length_is_normalised():
    estimator = JointStateEstimator({"r": robot("a", "b")})
    poses = np.array([turned(0.0), turned(0.5)])
    poses[1, 3:] *= 0.9991
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


def test_turns_begin_anew_for_a_joint_not_seen_for_long():
    estimator = wound_up()
    show(estimator, {"r::a": 0.0}, 0.2)
    observations = show(estimator, {"r::a": 0.0, "r::b": 20.3}, 1.2)
    assert positions(observations)[0]["to_b"] == pytest.approx(20.3 - 6 * np.pi)


# --- whole turns ---

TURN = 2.0 * np.pi
HALF = 3.14159
RPY = (0.3, -0.2, 0.5)
AXIS = np.array([0.6, 0.0, -0.8])
BASE = Rotation.from_rotvec([1.0, 2.0, -0.5])
BEFORE = BASE * Rotation.from_euler("xyz", RPY)
DT = 0.02


class Watched:
    """A joint and the estimator that watches it."""

    def __init__(self, lower=None, upper=None):
        kind, limit = "continuous", ""
        if lower is not None:
            kind = "revolute"
            limit = f'<limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/>'
        text = (
            '<robot name="r"><link name="a"/><link name="b"/>'
            f'<joint name="j" type="{kind}"><parent link="a"/><child link="b"/>'
            f'<origin xyz="1 2 3" rpy="{RPY[0]} {RPY[1]} {RPY[2]}"/>'
            f'<axis xyz="3 0 -4"/>{limit}</joint></robot>'
        )
        self.estimator = JointStateEstimator({"r": parse_urdf(text)})
        self.time = 0.0

    def at(self, position, speed=0.0):
        """Place the links, and give the position that is read."""
        turned = BEFORE * Rotation.from_rotvec(AXIS * position)
        quaternions = [BASE.as_quat(), turned.as_quat()]
        poses = np.hstack([np.zeros((2, 3)), quaternions])
        twists = np.zeros((2, 6))
        twists[1, 3:] = turned.apply(AXIS) * speed
        self.time += DT
        (seen,) = self.estimator.update(
            ("r::a", "r::b"), poses, twists, round(1e9 * self.time)
        )
        return seen.positions[0]

    def through(self, *stations, moving=False, step=0.1):
        """Go from station to station by steps of at most 0.1 rad, or as given.

        At rest, as commands put it, or moving as fast as it goes.
        """
        for start, end in zip(stations, stations[1:]):
            steps = int(abs(end - start) / step) + 2
            speed = moving * (end - start) / (steps - 1) / DT
            for position in np.linspace(start, end, steps):
                assert self.at(position, speed) == pytest.approx(position, abs=1e-9)
        return self


@pytest.mark.parametrize(("side", "stop"), [(1.0, HALF), (-1.0, 3.07)])
def test_a_little_beyond_its_stop_a_joint_does_not_flip(stop, side):
    """0.05 rad beyond, as physics pushes it; wide ranges and those of one turn."""
    beyond = side * (stop + 0.05)
    Watched(-stop, stop).through(0.0, beyond, 0.0, beyond, moving=True)


@pytest.mark.parametrize(("lower", "upper"), [(2, 8), (-1, 2)])
def test_a_little_beyond_its_stop_a_narrow_joint_is_known_at_once(lower, upper):
    for position in (lower - 0.05, lower, upper, upper + 0.05):
        assert Watched(lower, upper).at(position) == pytest.approx(position, abs=1e-9)


@pytest.mark.parametrize(
    ("lower", "upper", "position"),
    [(-4, 4, -3.0), (2, 9, 8.6 - TURN), (0, 6.8, -1e-9), (20, 40, 21.0)],
)
def test_the_first_guess_is_the_turn_inside_the_limits_that_is_nearest_zero(
    lower, upper, position
):
    assert Watched(lower, upper).at(position) == pytest.approx(position, abs=1e-9)


def test_a_joint_of_more_than_a_turn_walks_through_a_half_turn_both_ways():
    Watched(-4, 4).through(0.0, 4.0, -4.0, 4.0, 0.0)
    Watched(-7, 7).through(0.0, -7.0, 7.0, -7.0, 0.0)
    Watched(2, 9).through(5.5, 9.0, 2.0, 9.0)
    Watched(-HALF, HALF).through(0.0, HALF, -HALF, HALF)


@pytest.mark.parametrize(
    ("limits", "before", "put", "inside"),
    [
        ((-4, 4), -3.9, -4.4, TURN - 4.4),
        ((-HALF, HALF), 3.1, 3.1 + 0.08, 3.1 + 0.08 - TURN),
        ((2, 9), 8.8, 9.5, 9.5 - TURN),
    ],
)
def test_a_teleport_that_lands_outside_the_limits_is_read_inside(
    limits, before, put, inside
):
    """Less than a quarter turn away: it goes on, but out of the limits."""
    joint = Watched(*limits).through(0.5 * sum(limits), before)
    assert joint.at(put) == pytest.approx(inside, abs=1e-9)


def test_an_endless_joint_counts_turns_up_and_down():
    Watched().through(0.0, 3 * TURN, -3 * TURN, step=0.3)


def test_a_jump_of_more_than_a_quarter_turn_counts_turns_anew():
    goes_on = -30.0 - 0.24 * TURN
    joint = Watched().through(0.0, -30.0)
    assert joint.at(goes_on) == pytest.approx(goes_on, abs=1e-9)
    jumps = goes_on - 0.26 * TURN
    anew = jumps - TURN * np.round(jumps / TURN)
    assert joint.at(jumps) == pytest.approx(anew, abs=1e-9)


def test_a_joint_that_is_fast_enough_for_its_way_has_not_jumped():
    """6 rad in a message's time, almost a whole turn."""
    speed = -300.0
    joint = Watched()
    for step in range(100):
        position = speed * DT * step
        assert joint.at(position, speed) == pytest.approx(position, abs=1e-9)


def test_a_slide_has_no_turns():
    """Not even beyond its stop, beside a joint that counts them."""
    text = (
        '<robot name="r"><link name="a"/><link name="b"/><link name="c"/>'
        '<joint name="slide" type="prismatic"><parent link="a"/><child link="b"/>'
        '<limit lower="-5" upper="5" effort="1" velocity="1"/></joint>'
        '<joint name="turn" type="continuous"><parent link="a"/><child link="c"/>'
        "</joint></robot>"
    )
    estimator = JointStateEstimator({"r": parse_urdf(text)})
    for way in (0.0, 4.9, -4.9, 5.3, -5.3):
        poses = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]] * 3)
        poses[1, 0] = way
        names = ("r::a", "r::b", "r::c")
        (seen,) = estimator.update(names, poses, np.zeros((3, 6)), 0)
        assert seen.positions[0] == pytest.approx(way, abs=1e-12)


def test_a_joint_that_was_not_seen_for_a_while_goes_on_where_its_speed_took_it():
    """The other joint was seen meanwhile."""
    text = "".join(
        f'<joint name="{name}" type="continuous"><parent link="a"/>'
        f'<child link="{name}"/><axis xyz="0 0 1"/></joint><link name="{name}"/>'
        for name in "bc"
    )
    robot = parse_urdf(f'<robot name="r"><link name="a"/>{text}</robot>')
    estimator = JointStateEstimator({"r": robot})
    speed = 100.0
    twists = np.zeros((3, 6))
    twists[1:, 5] = speed
    for step in range(20):
        n_links = 2 if step == 10 else 3
        turns = Rotation.from_rotvec([[0, 0, a * speed * step * DT] for a in (0, 1, 1)])
        poses = np.hstack([np.zeros((3, 3)), turns.as_quat()])[:n_links]
        names = ("r::a", "r::b", "r::c")[:n_links]
        stamp = round(1e9 * step * DT)
        (seen,) = estimator.update(names, poses, twists[:n_links], stamp)
    np.testing.assert_allclose(seen.positions, speed * 19 * DT)


@pytest.mark.parametrize("limits", [(), (-HALF, HALF)])
def test_a_clock_that_is_slower_than_the_messages_moves_no_turns(limits):
    """A clock of 100 Hz, states of 1 kHz; a wheel, and a joint beyond its stop."""
    joint, speed = Watched(*limits), 50.0
    for step in range(1000):
        joint.time = 0.01 * (step // 10) - DT
        position = speed * 0.001 * step
        if limits:
            position = HALF + 0.03 * np.sin(speed * 0.001 * step)
        slope = 0.03 * speed * np.cos(speed * 0.001 * step) if limits else speed
        read = joint.at(position, slope)
    assert read == pytest.approx(position, abs=1e-9)


# --- velocities ---

THROWN = (
    "skew_axes",
    "gripper",
    "seven_joint_hand",
)
"""Axes of any direction, slides, mimics, and links that are lumped."""
HIGH = np.array([1.0, 2.0, 30.0, 0.0, 0.0, 0.0, 1.0])
SPINNING = np.array([0.3, -0.2, 0.5, 2.0, -3.0, 1.0])


class Thrown:
    """A robot that flies, spins and moves its joints, and what PyBullet says of it."""

    def __init__(self, world, text):
        world.spawn_urdf("robot", text, HIGH)
        world.put("robot", HIGH, SPINNING)
        self._client, self._body = world.client, world.body("robot").number
        self._index = world.joint_numbers("robot")
        names = world.body("robot").link_names
        self._links = [names[index] for index in range(-1, len(self._index))]
        self._let_go(parse_urdf(text), np.random.default_rng(1))

    def _let_go(self, description, random):
        """Put joints within a half turn of the middle of their limits, and move."""
        for joint in description.movable_joints:
            middle = 0.5 * (joint.lower + joint.upper)
            middle = middle if np.isfinite(middle) else 0.0
            lower, upper = np.clip([joint.lower, joint.upper], middle - 3, middle + 3)
            start = random.uniform(lower, upper), random.uniform(-3.0, 3.0)
            self._client.resetJointState(self._body, self._index[joint.name], *start)

    def joint_states(self, names):
        """Give positions and velocities, each of shape (n_joints,)."""
        states = [
            self._client.getJointState(self._body, self._index[name])[:2]
            for name in names
        ]
        return np.array(states).reshape(-1, 2).T

    def link_states(self):
        """Give names, poses and twists of the links' frames."""
        states = [self._base_state()]
        for index in range(len(self._index)):
            state = self._client.getLinkState(
                self._body, index, computeLinkVelocity=1, computeForwardKinematics=1
            )
            states.append((state[0], state[4], state[5], state[6], state[7]))
        center, origin, rotation, linear, angular = map(np.array, zip(*states))
        linear = linear + np.cross(angular, origin - center)
        names = tuple(f"robot::{link}" for link in self._links)
        return names, np.hstack([origin, rotation]), np.hstack([linear, angular])

    def _base_state(self):
        """Give what getLinkState does not give of the base."""
        center, turned = self._client.getBasePositionAndOrientation(self._body)
        inertial = self._client.getDynamicsInfo(self._body, -1)[3:5]
        rotation = Rotation.from_quat(turned) * Rotation.from_quat(inertial[1]).inv()
        origin = np.array(center) - rotation.apply(inertial[0])
        velocity = self._client.getBaseVelocity(self._body)
        return (center, origin, rotation.as_quat(), *velocity)


def assert_as_fast(measured, expected, tolerance):
    """Compare velocities, each relative to the joint's largest."""
    measured, expected = np.array(measured), np.array(expected)
    largest = np.abs(expected).max(axis=0)
    assert (largest > 0.1).all()
    assert (np.abs(measured - expected).max(axis=0) / largest).max() < tolerance


@pytest.mark.parametrize("name", THROWN)
def test_joints_are_as_fast_as_pybullet_says(make_world, name):
    """Links lumped as the world lumps them, and links as PyBullet tells them.

    PyBullet rounds the frames it tells to floats, and an axis that is off by 1e-7 rad
    tells a velocity that is off by the square of that.
    """
    text = (REPOSITORY / "test" / "data" / f"{name}.urdf").read_text()
    world = make_world("limp")
    thrown = Thrown(world, text)
    ours, its = (JointStateEstimator({"robot": parse_urdf(text)}) for _ in range(2))
    names = world.link_names
    seen, told, expected = [], [], []
    for _ in range(40):
        world.step()
        (state,) = ours.update(names, *world.link_states(), world.time_ns)
        position, velocity = thrown.joint_states(state.names)
        np.testing.assert_allclose(state.positions, position, atol=1e-9)
        seen.append(state.velocities)
        (state,) = its.update(*thrown.link_states(), world.time_ns)
        told.append(state.velocities)
        expected.append(velocity)
    assert not world.engine.contacts()
    assert_as_fast(seen, expected, 1e-6)
    assert_as_fast(told, expected, 1e-9)
