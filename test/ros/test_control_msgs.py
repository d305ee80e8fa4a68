"""Hold our definitions of control_msgs against the md5 sums of the package."""

import re

import pytest
from definitions import DESIGN, Definitions

DEFINITIONS = Definitions(
    "control_msgs", ["actionlib_msgs", "std_msgs", "trajectory_msgs"]
)
ACTION = DEFINITIONS.folder / "action" / "FollowJointTrajectory.action"
TABLE = DESIGN / "control_msgs.md"

MESSAGES = {
    "JointTolerance": "f544fe9c16cf04547e135dd6063ff5be",
    "JointTrajectoryControllerState": "10817c60c2486ef6b33e97dcd87f4474",
}
PARTS = {
    "FollowJointTrajectoryGoal": "69636787b6ecbde4d61d711979bc7ecb",
    "FollowJointTrajectoryResult": "493383b18409bfb604b4e26c676401d2",
    "FollowJointTrajectoryFeedback": "10817c60c2486ef6b33e97dcd87f4474",
}
GENERATED = {
    "FollowJointTrajectoryActionGoal": "cff5c1d533bf2f82dd0138d57f4304bb",
    "FollowJointTrajectoryActionResult": "c4fb3b000dc9da4fd99699380efcc5d9",
    "FollowJointTrajectoryActionFeedback": "d8920dc4eae9fc107e00999cce4be641",
    "FollowJointTrajectoryAction": "bc4f9b743838566551c0390c65f1a248",
}


@pytest.mark.parametrize(("name", "md5"), MESSAGES.items())
def test_messages_have_the_md5_sums_of_the_package(name, md5):
    assert DEFINITIONS.md5_of_file("msg", name) == md5


@pytest.mark.parametrize(("number", "name"), enumerate(PARTS))
def test_parts_of_the_action_have_the_md5_sums_of_the_package(number, name):
    text = ACTION.read_text(encoding="utf-8").split("\n---\n")[number]
    assert DEFINITIONS.md5_of_text("msg", name, text) == PARTS[name]


def test_the_build_generates_every_definition():
    files = (DEFINITIONS.folder / "CMakeLists.txt").read_text(encoding="utf-8")
    listed = re.findall(r"^ +(\w+\.(?:msg|action))$", files, re.M)
    paths = [*DEFINITIONS.folder.glob("*/*.msg"), *DEFINITIONS.folder.glob("action/*")]
    messages = sorted(path.name for path in paths if path.suffix == ".msg")
    assert listed == [*messages, ACTION.name]
    assert {f"{name}.msg" for name in MESSAGES} == {*listed} - {ACTION.name}


def test_the_built_classes_have_the_same_md5_sums():
    built = pytest.importorskip("control_msgs.msg")
    table = {**MESSAGES, **PARTS, **GENERATED}
    assert {name: getattr(built, name)._md5sum for name in table} == table


def test_error_codes_are_those_of_the_package():
    built = pytest.importorskip("control_msgs.msg").FollowJointTrajectoryResult
    names = ["SUCCESSFUL", "INVALID_GOAL", "INVALID_JOINTS", "OLD_HEADER_TIMESTAMP"]
    names += ["PATH_TOLERANCE_VIOLATED", "GOAL_TOLERANCE_VIOLATED"]
    assert [getattr(built, name) for name in names] == [0, -1, -2, -3, -4, -5]


def test_the_tables_agree_with_the_design():
    if not TABLE.exists():
        pytest.skip(f"{TABLE} is not there")
    rows = re.findall(r"^\| (\w+) \|.*\| ([0-9a-f]{32}) \|", TABLE.read_text(), re.M)
    assert dict(rows) == {**MESSAGES, **PARTS, **GENERATED}
