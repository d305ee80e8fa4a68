"""The command why without a robot that runs."""

import os
import time

import numpy as np
import pytest

pytest.importorskip("rosbag", reason="rosbag is not installed")

from g1_description import Robot
from g1_description.bridge.history import keep_last_bag, last_bag
from g1_description.bridge.parameters import RobotParameters
from g1_description.bridge.status import RobotStatus
from g1_description.cli.why import WhyOptions, why
from g1_description.motion.history import History
from g1_description.robot.state import RobotState

ROBOT = Robot().description
NAMES = tuple(joint.name for joint in ROBOT.movable_joints)


def test_it_says_how_old_the_history_of_an_ended_bridge_is(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    monkeypatch.setenv("ROS_MASTER_URI", "http://localhost:1")
    history = History(60.0)
    for number in range(1, 5):
        history.add(RobotState(5_000_000 * number, NAMES, np.zeros(len(NAMES))))
    keep_last_bag(RobotParameters("g1", ""), RobotStatus("g1", ROBOT, history))
    at = time.mktime((2026, 3, 4, 5, 6, 7, 0, 0, -1))
    os.utime(last_bag(""), (at, at))
    assert why(WhyOptions(None)) == 0
    printed = capsys.readouterr()
    assert printed.out.startswith("Nothing is known to have failed.")
    assert printed.err == (
        f"why: no ROS master runs; reading {last_bag('')}, "
        "written at 2026-03-04 05:06:07.\n"
    )
