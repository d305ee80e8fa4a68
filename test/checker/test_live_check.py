"""A robot is checked as it is now, again and again."""

from __future__ import annotations

from pathlib import Path

import genpy
import numpy as np
import pytest

from g1_description.checker.markers import KINDS, MarkerMaker
from g1_description.checks.checker import AT_REST, STANDSTILL, Checker, LiveCheck
from g1_description.checks.thresholds import Thresholds
from g1_description.errors import UnknownNameError
from g1_description.robot.description import Shape
from g1_description.robot.load import read_absolute
from g1_description.robot.state import RobotState
from g1_description.robot.urdf import parse_urdf

ROBOT = parse_urdf(
    read_absolute(str(Path(__file__).parents[2] / "urdf" / "g1_29dof.urdf")).text
)
JOINTS = {joint.name: 0.0 for joint in ROBOT.movable_joints}
BASE = np.array([0.0, 0.0, 0.793, 0.0, 0.0, 0.0, 1.0])
FAST = 10.0
"""Of the still speed: moves at so many times of it."""


@pytest.fixture(scope="module")
def checker():
    return Checker(ROBOT, Thresholds())


@pytest.fixture
def live(checker):
    return LiveCheck(checker)


def test_rviz_has_no_capsule_and_is_sent_triangles():
    pose = np.array([1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0])
    canvas = MarkerMaker("a", genpy.Time())
    canvas.shape("n", Shape("capsule", (0.1, 0.6), pose), (1.0, 0.0, 0.0), 0.5)
    (marker,) = canvas.markers
    corners = np.array([[point.x, point.y, point.z] for point in marker.points])
    assert marker.type == KINDS["capsule"] and marker.pose.position.z == 3.0
    assert np.ptp(corners, axis=0) == pytest.approx([0.2, 0.2, 0.8])


def state(time, positions=JOINTS, base=BASE, velocities=None):
    """Make the state of a robot from numbers by joint."""
    rates = None if velocities is None else np.array([*velocities.values()])
    values = np.array([*positions.values()])
    return RobotState(round(1e9 * time), tuple(positions), values, rates, base)


def moved(base, distance):
    other = base.copy()
    other[0] += distance
    return other


def is_at_rest(verdict):
    return {*AT_REST} <= {*verdict.checked}


def test_a_state_is_judged_as_the_checker_does(live, checker):
    verdict = live.check(state(1.0, JOINTS, BASE))
    assert verdict.findings == checker.check_state(JOINTS, BASE).findings
    assert is_at_rest(verdict)
    assert "contact_forces" not in verdict.checked


def test_what_has_not_changed_is_not_judged_again(live):
    first = live.check(state(1.0, JOINTS, BASE))
    again = live.check(state(2.0, dict(JOINTS), BASE.copy()))
    assert again is first
    assert is_at_rest(again)
    for other in (
        ({**JOINTS, "left_knee_joint": 1e-12}, BASE, None),
        (JOINTS, moved(BASE, 1e-12), None),
        (JOINTS, None, None),
        (JOINTS, BASE, JOINTS),
    ):
        assert live.check(state(2.0, *other)) is not first


def test_a_robot_that_moves_is_not_judged_as_one_at_rest(live, checker):
    still = checker.thresholds.still_speed
    live.check(state(0.0, JOINTS, BASE))
    verdict = live.check(state(0.1, JOINTS, moved(BASE, 0.1 * FAST * still)))
    assert not {*AT_REST} & {*verdict.checked}
    assert {verdict.skipped[name] for name in AT_REST} == {"the robot moves"}
    verdict = live.check(state(0.2, JOINTS, moved(BASE, 0.1 * FAST * still)))
    assert is_at_rest(verdict), "it has stopped"
    verdict = live.check(state(0.3, JOINTS, moved(BASE, 0.1 * (FAST + 0.5) * still)))
    assert is_at_rest(verdict), "so slowly that it counts as standing"


def test_a_robot_that_leans_out_is_told_only_at_rest(live):
    leaning = {**JOINTS, "left_ankle_pitch_joint": 0.5, "right_ankle_pitch_joint": 0.5}
    live.check(state(0.0, leaning, BASE))
    verdict = live.check(state(0.1, leaning, moved(BASE, 0.5)))
    assert not verdict.of("floating") and not verdict.of("center_of_mass")
    verdict = live.check(state(5.0, leaning, moved(BASE, 0.5)))
    assert verdict.of("floating") or verdict.of("center_of_mass")


def test_a_robot_that_is_placed_while_time_stands_still_does_not_move(live):
    live.check(state(1.0, JOINTS, BASE))
    verdict = live.check(state(1.0 + 0.5 * STANDSTILL, JOINTS, moved(BASE, 1.0)))
    assert is_at_rest(verdict)


def test_time_may_begin_again(live):
    live.check(state(100.0, JOINTS, BASE))
    live.begin_again()
    verdict = live.check(state(0.1, JOINTS, moved(BASE, 5.0)))
    assert is_at_rest(verdict)
    verdict = live.check(state(0.0, JOINTS, moved(BASE, 9.0)))
    assert is_at_rest(verdict), "nobody moves back in time"


def test_a_robot_without_a_base_is_judged_by_its_joints(live):
    verdict = live.check(state(0.0, {**JOINTS, "left_knee_joint": 9.0}, None))
    assert verdict.of("position")
    assert "floating" in verdict.skipped


def test_joints_of_others_are_passed_over(live):
    verdict = live.check(state(0.0, {**JOINTS, "left_thumb_0": 99.0}, BASE))
    assert not verdict.of("position")
    with pytest.raises(UnknownNameError, match="none of these joints: left_thumb_0"):
        live.check(state(0.0, {"left_thumb_0": 99.0}, BASE))


def test_too_fast_joints_are_told_where_velocities_are_known(live):
    joints = {**JOINTS, "left_thumb_0": 0.0}
    fast = {**joints, "left_knee_joint": 1000.0, "left_thumb_0": 1.0}
    verdict = live.check(state(0.0, joints, BASE, fast))
    (finding,) = verdict.of("velocity")
    assert finding.subject == ("left_knee_joint",)
    verdict = live.check(state(0.1, JOINTS, BASE, None))
    assert not verdict.of("velocity")
