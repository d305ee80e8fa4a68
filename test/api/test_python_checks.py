"""Checks as Python programs make them."""

import numpy as np
import pytest

from g1_description import Robot
from g1_description.checks.verdict import Verdict
from g1_description.errors import (
    InvalidValueError,
    MotionError,
    ThresholdError,
    UnknownNameError,
)
from g1_description.motion.edit import joined

ROBOT = Robot()
ELBOW = "left_elbow_joint"
BASE = [0.0, 0.0, 0.792, 0.0, 0.0, 0.0, 1.0]


def test_a_configuration_is_judged_with_and_without_a_base():
    verdict = ROBOT.check_state({ELBOW: 2.2})
    (finding,) = verdict.findings
    assert (finding.check, finding.subject) == ("position", (ELBOW,))
    assert "penetration" in verdict.skipped
    deep = [*BASE[:2], 0.6, *BASE[3:]]
    found = ROBOT.check_state({}, deep, only=["penetration"]).findings
    assert {finding.check for finding in found} == {"penetration"}
    assert max(f.worst for f in found) == pytest.approx(0.192, abs=1e-3)


def test_a_motion_is_judged_from_file_and_arrays(tmp_path):
    times = np.linspace(0.0, 1.0, 61)
    wave = {ELBOW: 2.2 * np.sin(np.pi * times), "left_shoulder_roll_joint": 0.6}
    motion = ROBOT.trajectory(times, wave)
    ROBOT.write_motion(tmp_path / "wave.csv", motion)
    verdict = ROBOT.check(motion)
    assert not verdict.passed
    from_file = ROBOT.check(tmp_path / "wave.csv")
    assert from_file.findings == verdict.findings
    assert ROBOT.check(motion, thresholds={"position": {"failure": 1.0}}).passed
    file = tmp_path / "mild.yaml"
    file.write_text("position: {warning: null, failure: 1.0}\n")
    assert ROBOT.check(motion, thresholds=file).findings == ()


def test_a_result_that_has_a_motion_is_taken_for_it(tmp_path):
    keys = ROBOT.keyframes(["stand", "squat"], [0.0, 0.5])

    def written(write, motion):
        write(tmp_path / "file.csv", motion)
        return (tmp_path / "file.csv").read_bytes()

    for take in (
        ROBOT.check,
        ROBOT.checker().check,
        ROBOT.mirrored,
        ROBOT.on_floor,
        ROBOT.padded,
        ROBOT.positions_of,
        lambda motion: joined([motion, motion]),
        lambda motion: ROBOT.compare(motion, motion),
        lambda motion: written(ROBOT.write_motion, motion),
        lambda motion: written(ROBOT.write_page, motion),
    ):
        assert repr(take(keys)) == repr(take(keys.motion))
        with pytest.raises(MotionError, match="must be a Motion, or a result that has"):
            take(3)


def test_a_checker_also_plays_motions_in_physics():
    times = np.linspace(0.0, 0.2, 11)
    motion = ROBOT.trajectory(times, np.zeros((11, 29)))
    checker = ROBOT.checker(
        {"position": {"failure": 1.0}}, fixed_base=True, physics=True
    )
    verdict = checker.check(motion)
    assert {"position", "effort", "tracking"} <= {*verdict.checked}
    assert verdict.skipped["fall"] == "the base is fixed"
    assert verdict.measured.positions.shape == (len(verdict.measured.times), 29)
    alone = checker.check(motion, ["tracking"])
    assert alone.checked == ("tracking",)
    error = "largest_tracking_error"
    assert alone.figures[error] == verdict.figures[error]
    with pytest.raises(UnknownNameError, match="Unknown check 'tracking'"):
        ROBOT.checker().check(motion, ["tracking"])


def test_a_held_base_shows_efforts():
    times = np.array([0.0, 10.0])
    still = ROBOT.trajectory(times, np.zeros((2, 29)))
    assert "effort" in ROBOT.check(still).skipped
    assert "effort" in ROBOT.check(still, fixed_base=True).checked


def test_contacts_are_those_of_each_configuration():
    arm = {"left_shoulder_roll_joint": [0.4, -0.5], "left_shoulder_yaw_joint": -1.0}
    given = ROBOT.positions(
        {name: np.broadcast_to(value, 2) for name, value in arm.items()}
    )
    contacts = ROBOT.self_collisions(given)
    assert 0 not in contacts.sample
    names = {name for pair in contacts.pair for name in ROBOT.collision_pairs[pair]}
    assert "torso_link" in names
    assert (contacts.distance < 0.0).all()
    alone = ROBOT.self_collisions(given[1], base=BASE)
    np.testing.assert_array_equal(alone.pair, contacts.pair)
    np.testing.assert_allclose(alone.distance, contacts.distance, atol=1e-5)
    assert len(ROBOT.self_collisions(given, margin=0.05).pair) > len(contacts.pair)


def test_mistakes_are_told():
    with pytest.raises(UnknownNameError, match="Unknown check"):
        ROBOT.check_state({}, only=["colision"])
    with pytest.raises(ThresholdError, match="Unknown threshold"):
        ROBOT.check_state({}, thresholds={"colision": 1})
    with pytest.raises(UnknownNameError, match="left_elbow_joint"):
        ROBOT.check_state({"left_elbow": 0.0})
    with pytest.raises(InvalidValueError):
        ROBOT.check_state({}, base=[0.0, 1.0])
    two = np.zeros((2, len(ROBOT.joint_names)))
    with pytest.raises(InvalidValueError, match="margin"):
        ROBOT.self_collisions({}, margin=float("nan"))
    for rate in (0, -1.0, float("nan"), "a"):
        with pytest.raises(MotionError, match="rate"):
            ROBOT.read_motion("nowhere.csv", rate)
    assert ROBOT.check_state({}, only="self_collision").checked == ("self_collision",)
    with pytest.raises(InvalidValueError, match=r"positions of shape \(29,\)"):
        ROBOT.check_state(two)
    with pytest.raises(MotionError):
        ROBOT.check("nowhere.csv")


def test_a_verdict_says_which_checks_there_are():
    with pytest.raises(KeyError, match="known: position"):
        Verdict("r", checked=("position",)).of("velocity")
