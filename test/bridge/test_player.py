"""Joints of a motion that newer commands take."""

import pytest

for module in ("rospy", "gazebo_msgs.msg"):
    pytest.importorskip(module, reason=f"{module} is not there")

from g1_description.bridge.player import BASE, Claim  # noqa: E402

START = 100


@pytest.mark.parametrize(
    ("commands", "is_empty", "lost"),
    [
        ([], False, None),
        ([({"knee"}, 0)], False, None),
        ([({"elbow"}, 0)], False, 0),  # a command
        ([({"elbow"}, START)], False, 0),  # a motion that begins with it
        ([({"elbow"}, START + 7)], False, START + 7),  # one that begins later
        ([({"elbow"}, START + 7), ({BASE}, START + 3)], False, START + 3),
        ([({"elbow", BASE, "knee"}, START)], True, 0),
        ([({"elbow"}, START), ({BASE}, START)], True, 0),
        ([({"elbow", BASE}, START + 7)], False, START + 7),
    ],
)
def test_a_motion_has_its_joints_until_a_newer_command_begins(commands, is_empty, lost):
    claim = Claim(["elbow", BASE], START)
    given = [claim.give(parts, start) for parts, start in commands]
    assert any(given) is is_empty
    for time in (0, START, START + 3, START + 6, START + 7, START + 1000):
        assert claim.is_lost(time) is (lost is not None and time >= lost)
