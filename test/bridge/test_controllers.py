"""The controllers of ~controllers, or one sentence."""

import pytest

for module in ("rospy", "control_msgs.msg"):
    pytest.importorskip(module, reason=f"{module} is not there")

from g1_description.bridge.controllers import Controller, read_controllers  # noqa: E402
from g1_description.errors import InvalidValueError  # noqa: E402
from g1_description.motion.tolerances import Constraints  # noqa: E402

JOINTS = ("knee", "elbow", "wrist")
ARM = {"name": "arm", "joints": ["wrist", "elbow"]}


def test_without_any_one_controller_has_all_joints():
    assert read_controllers((), JOINTS, "x") == (Controller("", JOINTS),)


def test_a_robot_without_joints_has_no_controller():
    assert read_controllers((), (), "x") == ()


def test_they_are_as_listed():
    leg = {"name": "left/leg", "joints": ["knee"], "constraints": {"goal_time": 2.0}}
    arm, found = read_controllers((ARM, leg), JOINTS, "x")
    assert arm == Controller("arm", ("wrist", "elbow"))
    assert found == Controller("left/leg", ("knee",), Constraints({}, {}, 2.0))


def test_without_joints_it_has_all_of_them():
    (one,) = read_controllers(({"name": "body"},), JOINTS, "x")
    assert one.joints == JOINTS


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        ([3], "must be a dictionary with .*got 3"),
        ([{**ARM, "type": "x"}], "name, joints, constraints"),
        ([{"joints": ["knee"]}], "name must be a ROS name .got None"),
        ([{"name": "a b"}], "got 'a b'"),
        ([{"name": ""}], "got ''"),
        ([{"name": "arm", "joints": []}], "must be a list"),
        ([{"name": "arm", "joints": "knee"}], "must be a list"),
        ([{"name": "arm", "joints": ["elbo"]}], "'elbo' .did you mean elbow."),
        ([{"name": "arm", "joints": [["knee"]]}], "unknown joint"),
        ([{"name": "arm", "joints": ["knee", "knee"]}], "must not repeat"),
        ([{**ARM, "constraints": {"knee": {}}}], "unknown key knee"),
        ([ARM, ARM], "have the name 'arm'"),
        ([ARM, {"name": "b", "joints": ["elbow"]}], "arm and b, both have elbow"),
    ],
)
def test_what_is_wrong_is_told_in_a_sentence(entries, words):
    with pytest.raises(InvalidValueError, match=words) as told:
        read_controllers(entries, JOINTS, "controllers of g1")
    text = str(told.value)
    assert "controllers of g1" in text
    assert text.endswith(".")
    assert not text.endswith("..")
