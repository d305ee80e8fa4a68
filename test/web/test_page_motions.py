"""The motions of the pictures of the browser view show what the pages say."""

import sys
from pathlib import Path

from g1_description import Robot

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools"))
from pictures.motions import squat


def test_one_motion_has_faults_and_the_other_has_none():
    robot = Robot()
    assert robot.check(squat(robot, False)).findings == ()
    found = robot.check(squat(robot, True)).findings
    assert {finding.check for finding in found} == {"self_collision", "position"}
