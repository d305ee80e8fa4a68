"""The motions of the package: sound ones, and one with six faults."""

import re
from pathlib import Path

import numpy as np
import pytest

from g1_description import Robot

ROOT = Path(__file__).resolve().parents[2]
MOTIONS = ROOT / "motions"
SOUND = ("reach", "squat", "step_in_place", "wave")


@pytest.fixture(scope="module")
def robot():
    return Robot()


@pytest.mark.parametrize("name", SOUND)
def test_nothing_is_wrong_with_a_motion(robot, name):
    motion = robot.read_motion(MOTIONS / f"{name}.csv")
    verdict = robot.check(motion)
    assert (verdict.findings, verdict.notes) == ((), ())
    assert verdict.figures["largest_drift"] < 0.005
    assert 4.0 <= motion.duration <= 8.0
    np.testing.assert_allclose(np.diff(motion.times), 0.02, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("name", SOUND)
def test_motors_can_follow_a_motion(robot, name):
    motion = robot.read_motion(MOTIONS / f"{name}.csv")
    verdict = robot.checker(physics=True, engine="mujoco").check(motion)
    assert verdict.findings == ()
    assert "does not fall" in verdict.notes[-1]


@pytest.mark.parametrize("name", ("reach", "squat", "wave"))
def test_feet_stay_where_they_are(robot, name):
    motion = robot.read_motion(MOTIONS / f"{name}.csv")
    poses = robot.link_poses(robot.positions_of(motion), motion.base)
    for foot in ("left_ankle_roll_link", "right_ankle_roll_link"):
        assert np.ptp(poses[foot], axis=0).max() < 4e-4  # files have 4 digits


def test_the_faulty_motion_has_the_faults_that_its_header_names(robot):
    text = (MOTIONS / "faulty.csv").read_text()
    told = dict(re.findall(r"^# (\w+) +([\d.]+) s  ", text, flags=re.M))
    assert len(told) == 6
    verdict = robot.check(MOTIONS / "faulty.csv")
    assert {finding.check for finding in verdict.findings} == {*told}
    for check, time in told.items():
        found = [f for f in verdict.findings if f.check == check]
        failures = [f for f in found if f.severity == "failed"]
        assert failures
        for begin, end in (i for f in failures for i in f.intervals):
            assert begin - 0.02 <= float(time) <= end + 0.02, check
