"""Tolerances and goals after joint_trajectory_controller, held against its rules."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from g1_description.errors import InvalidValueError
from g1_description.motion.motion import Motion
from g1_description.motion.playlist import Following, Outcome, remaining
from g1_description.motion.tolerances import (
    Constraints,
    JointTolerance,
    Tolerances,
    read_constraints,
    tolerances_of_goal,
    worst_violation,
)

NAMES = ("knee", "elbow")
SECOND = 1_000_000_000
VALUES = st.sampled_from([-2.0, -1.0, 0.0, 0.01, 0.5, 3.0])
ASKED = st.lists(
    st.builds(JointTolerance, st.sampled_from([*NAMES, "nose"]), VALUES, VALUES),
    max_size=4,
)
NUMBERS = st.floats(0.0, 2.0)
CONSTRAINTS = st.builds(
    Constraints,
    st.fixed_dictionaries(dict.fromkeys(NAMES, NUMBERS)),
    st.fixed_dictionaries({"elbow": NUMBERS}),
    NUMBERS,
    NUMBERS,
)
FREE = Tolerances(np.full((2, 2), np.inf), np.full((2, 2), np.inf), 0.0)


def updated(tolerance, asked):
    """Do what updateStateTolerances does for one number; 0 stands for none."""
    if asked > 0.0:
        return asked
    return 0.0 if asked < 0.0 else tolerance


def is_within(error, tolerance):
    """Do what checkStateTolerance does for one number."""
    return not (tolerance > 0.0 and abs(error) > tolerance)


def table(position, velocity, asked):
    """Give tolerances as updateSegmentTolerances makes them: name to numbers."""
    found = {name: [position.get(name, 0.0), velocity] for name in NAMES}
    for one in asked:
        if one.name in found:
            p, v = found[one.name]
            found[one.name] = [updated(p, one.position), updated(v, one.velocity)]
    return found


@given(CONSTRAINTS, ASKED, ASKED, VALUES, st.integers(0, 1000))
def test_a_goal_changes_the_constraints_as_in_the_controller(
    constraints, path, goal, goal_time, seed
):
    found = tolerances_of_goal(NAMES, constraints, path, goal, goal_time)
    assert found.goal_time == updated(constraints.goal_time, goal_time)
    velocity = constraints.stopped_velocity_tolerance
    errors = np.random.default_rng(seed).normal(size=(2, 2))
    for array, expected in (
        (found.path, table(constraints.trajectory, 0.0, path)),
        (found.goal, table(constraints.goal, velocity, goal)),
    ):
        inside = all(
            is_within(errors[row, column], expected[name][row])
            for column, name in enumerate(NAMES)
            for row in (0, 1)
        )
        assert (worst_violation(NAMES, errors, array) == "") == inside
    assert found.has_path == any(
        number > 0.0
        for row in table(constraints.trajectory, 0.0, path).values()
        for number in row
    )


def test_the_worst_joint_is_named():
    errors = np.array([[0.2, -0.3], [0.0, 0.5]])
    allowed = np.array([[0.1, 0.1], [np.inf, 0.4]])
    message = worst_violation(NAMES, errors, allowed)
    assert message == "elbow is 0.3 off its desired position (tolerance 0.1)"


def test_an_error_that_is_unknown_is_too_large():
    errors = np.array([[0.0, math.nan], [0.0, 0.0]])
    assert "elbow" in worst_violation(NAMES, errors, np.full((2, 2), np.inf))


def test_nan_is_no_tolerance():
    goal = [JointTolerance("elbow", 0.0, math.nan)]
    with pytest.raises(InvalidValueError, match="tolerance of elbow must not be NaN"):
        tolerances_of_goal(NAMES, Constraints(), [], goal, 0.0)


def test_constraints_have_the_form_of_ros_control():
    found = read_constraints(
        {"goal_time": 1, "knee": {"trajectory": 0.1, "goal": 0.2}, "elbow": {}}, NAMES
    )
    assert found == Constraints({"knee": 0.1}, {"knee": 0.2}, 1.0, 0.01)
    assert read_constraints({}, NAMES) == Constraints({}, {}, 1.0, 0.01)


@pytest.mark.parametrize(
    ("found", "words"),
    [
        ({"nose": {}}, "unknown key nose"),
        ({"knee": {"path": 0.1}}, "of knee"),
        ({"goal_time": -1.0}, "goal_time"),
    ],
)
def test_other_constraints_are_refused(found, words):
    with pytest.raises(InvalidValueError, match=words):
        read_constraints(found, NAMES)


def motion(times=(1.0, 2.0, 3.0), velocities=None):
    positions = np.arange(2.0 * len(times)).reshape(-1, 2)
    return Motion(np.array(times), NAMES, positions, velocities)


def following(tolerances=FREE, continuous=(False, False), trajectory=None):
    """Give a goal that begins after five seconds."""
    return Following(
        trajectory or motion(), 5 * SECOND, tolerances, np.array(continuous)
    )


def within(path=np.inf, goal=np.inf, velocity=np.inf, goal_time=0.0):
    rows = np.array([[1.0, 1.0]])
    return Tolerances(
        np.concatenate([path * rows, np.inf * rows]),
        np.concatenate([goal * rows, velocity * rows]),
        goal_time,
    )


def at(seconds):
    return round((5 + seconds) * SECOND)


STILL = np.zeros((2, 2))


def off(position, velocity=0.0):
    """Give the joints where the motion ends, but for an error of the elbow."""
    return np.array([[4.0, 5.0 - position], [0.0, -velocity]])


def test_it_is_reached_at_its_end_and_not_before():
    goal = following()
    assert goal.update(at(0.0), STILL).outcome is Outcome.UNDER_WAY
    assert not goal.decides_at(at(3.0) - 1)
    assert goal.decides_at(at(3.0))
    assert goal.update(at(3.0) - 1, STILL).outcome is Outcome.UNDER_WAY
    assert goal.update(at(3.0), STILL).outcome is Outcome.REACHED


def test_before_the_first_point_the_joints_go_there_from_where_they_are():
    goal = following()
    begin = np.array([[2.0, -3.0], [0.0, 0.0]])
    np.testing.assert_allclose(goal.update(at(0.0), begin).desired[0], [2.0, -3.0])
    found = goal.update(at(0.5), begin)
    np.testing.assert_allclose(found.desired[0], [1.0, -1.0])
    np.testing.assert_allclose(found.error, found.desired - begin)


@given(st.floats(0.0, 4.0), st.floats(-2.0, 2.0))
def test_errors_on_the_way_are_those_of_the_path(time, error):
    goal = following(within(path=1.0))
    begin = np.array([[0.0, 1.0], [0.0, 0.0]])
    goal.update(at(0.0), begin)
    desired = goal.update(at(time), begin).desired
    goal = following(within(path=1.0))
    goal.update(at(0.0), begin)
    found = goal.update(at(time), desired + np.array([[0.0, error], [0.0, 0.0]]))
    if time >= 3.0:
        assert found.outcome is Outcome.REACHED
    elif abs(error) > 1.0 + 1e-9:
        assert found.outcome is Outcome.OFF_PATH
        assert "elbow" in found.message
    elif abs(error) < 1.0 - 1e-9:
        assert found.outcome is Outcome.UNDER_WAY


@pytest.mark.parametrize(
    ("time", "error", "outcome"),
    [
        (3.0, 0.05, Outcome.REACHED),
        (3.0, 0.3, Outcome.UNDER_WAY),
        (3.4, 0.05, Outcome.REACHED),
        (3.5, 0.3, Outcome.OFF_GOAL),
    ],
)
def test_at_the_end_there_is_time_to_come_nearer(time, error, outcome):
    goal = following(within(goal=0.1, goal_time=0.5))
    assert goal.update(at(time), off(error)).outcome is outcome


def test_at_the_end_the_joints_have_to_stop():
    goal = following(within(velocity=0.01))
    assert goal.update(at(3.0), off(0.0, 0.02)).outcome is Outcome.OFF_GOAL
    goal = following(within(velocity=0.01))
    assert goal.update(at(3.0), off(0.0, 0.005)).outcome is Outcome.REACHED


def test_a_joint_that_was_there_need_not_wait_for_the_others():
    goal = following(within(goal=0.1, goal_time=1.0))
    knee_off, elbow_off = off(0.0), off(0.5)
    knee_off[0, 0] += 0.5
    assert goal.update(at(3.1), knee_off).outcome is Outcome.UNDER_WAY
    assert goal.update(at(3.2), elbow_off).outcome is Outcome.REACHED


def test_whole_turns_of_a_continuous_joint_do_not_count():
    goal = following(within(goal=0.1), (False, True))
    assert goal.update(at(3.0), off(4.0 * np.pi + 0.05)).outcome is Outcome.REACHED
    goal = following(within(goal=0.1))
    assert goal.update(at(3.0), off(4.0 * np.pi)).outcome is Outcome.OFF_GOAL


@given(st.floats(-1.0, 4.0))
def test_what_remains_is_what_is_after_the_time(time):
    whole = motion(velocities=np.ones((3, 2)))
    rest = remaining(whole, time)
    later = whole.times > time + 1e-9
    if rest is None:
        assert not later.any()
    else:
        assert rest.times.tolist() == whole.times[later].tolist()
        assert rest.positions.tolist() == whole.positions[later].tolist()
        assert len(rest.velocities) == len(rest.times)
