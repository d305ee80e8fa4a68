"""The profile that import_model begins."""

import pytest
from conftest import REPOSITORY

from g1_description.api import Robot
from g1_description.importer.import_model import run
from g1_description.importer.robot import _scalar, guessed_links
from g1_description.robot.poses import read_file

FIVE = REPOSITORY / "test" / "data" / "five_links.urdf"


@pytest.fixture
def out(tmp_path, monkeypatch):
    """Give the folder of the import, below that of the user's profiles."""
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    return tmp_path / "g1_description" / "robots" / "mine"


def leg(side):
    """Write a leg of two links and an arm of one; their names end in the side."""
    joints = (("hip", "trunk", "thigh"), ("ankle", "thigh", "sole"))
    text = ""
    for name, parent, child in (*joints, ("shoulder", "trunk", "claw")):
        parent += "" if parent == "trunk" else f"_{side}"
        text += (
            f'<link name="{child}_{side}"/><joint name="{side}_{name}" type="revolute">'
            f'<parent link="{parent}"/><child link="{child}_{side}"/><limit lower="-1" '
            'upper="1" effort="1" velocity="1"/></joint>'
        )
    return text


BIPED = f'<robot name="a b"><link name="trunk"/>{leg("left")}{leg("right")}</robot>'


def test_an_imported_robot_is_one_by_the_name_of_its_folder(out):
    said = run([str(FIVE), "--out", str(out)])
    assert f"robot:={out}, or its name if it is in {out.parent}." in said
    for given in ("mine", out, FIVE):
        assert Robot(given).profile.name == "mine"
    assert Robot("mine").pose_names == ("zero",)
    assert Robot("mine").profile.standing_pose == "zero"
    assert [*read_file(out / "poses.yaml")] == ["zero"]


def test_feet_and_hands_are_guessed_by_their_joints(out, tmp_path):
    file = tmp_path / "r.urdf"
    file.write_text(BIPED)
    run([str(file), "--out", str(out)])
    assert Robot(out).profile.links == {
        "left_foot": "sole_left",
        "right_foot": "sole_right",
        "left_hand": "claw_left",
        "right_hand": "claw_right",
    }
    assert Robot(file).profile.names == ("a b",)
    g1 = guessed_links(Robot().description)
    assert g1["left_foot"] == Robot().profile.links["left_foot"]


def test_a_robot_that_has_a_profile_gets_one_that_is_like_it(out):
    run(["g1_29dof", "--out", str(out)])
    text = (out / "robot.yaml").read_text()
    assert "\nlike: g1_29dof\n" in text
    assert not (out / "poses.yaml").exists()
    robot = Robot(out)
    assert robot.pose_names == Robot("g1_29dof").pose_names
    assert robot.profile.links == Robot("g1_29dof").profile.links


def test_what_its_user_wrote_stays(out):
    run([str(FIVE), "--out", str(out)])
    (out / "robot.yaml").write_text("names: [strider]\nstanding_pose: low\n")
    (out / "poses.yaml").unlink()
    run([str(FIVE), "--out", str(out), "--force"])
    assert Robot(FIVE).profile.standing_pose == "low"
    assert not (out / "poses.yaml").exists()


@pytest.mark.parametrize(
    ("name", "written"),
    [
        ("my_robot", "my_robot"),
        ("left/foot.1", "left/foot.1"),
        *(("false", '"false"'), ("12", '"12"'), ("a: b", '"a: b"'), ("a #b", '"a #b"')),
        *(("a, b", '"a, b"'), ("[a", '"[a"'), ("", '""')),
    ],
)
def test_names_are_quoted_where_yaml_would_read_something_else(name, written):
    assert _scalar(name) == written


def test_several_robots_have_no_profile(out, tmp_path):
    for name in ("a", "b"):
        (tmp_path / f"{name}.urdf").write_text(BIPED)
    said = run([str(tmp_path), "--out", str(out)])
    assert "Several robots have no profile: import one at a time to get it." in said
    assert not (out / "robot.yaml").exists()
