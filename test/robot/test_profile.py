"""Profiles: which robot has which, and what is wrong with a folder."""

import re
from dataclasses import replace

import pytest
from conftest import PROFILE, REPOSITORY, VENDOR

from g1_description.api import Robot
from g1_description.errors import DescriptionError, ProfileError, UnknownNameError
from g1_description.gazebo.node import figures
from g1_description.motion.files.conventions import G1_JOINTS
from g1_description.motion.motors import ServoMotor, motors_of
from g1_description.robot.description import Joint
from g1_description.robot.load import read_description
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.poses import check_pose, fits, read_poses
from g1_description.robot.profile import (
    LinkPoint,
    Profile,
    find_profile,
    is_profile,
)
from g1_description.robot.urdf import parse_urdf

G1 = parse_urdf((REPOSITORY / "urdf" / "g1_29dof.urdf").read_text())
FIVE = REPOSITORY / "test" / "data" / "five_links.urdf"


def with_joints(name, names):
    """Make a G1 with other movable joints."""
    pose = G1.joints[0].pose
    joints = [Joint(n, "revolute", "pelvis", n, pose, lower=-3, upper=3) for n in names]
    return replace(G1, name=name, joints=tuple(joints))


@pytest.fixture
def home(tmp_path, monkeypatch):
    """Give the folder of the user's profiles."""
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    return tmp_path / "g1_description" / "robots"


@pytest.fixture
def add(home):
    """Give what writes a profile of the user's: robot.yaml, and further files."""

    def write(name, text, **files):
        (home / name).mkdir(parents=True)
        for file, content in {"robot": text, **files}.items():
            (home / name / f"{file}.yaml").write_text(content)
        return home / name

    return write


def test_the_g1_has_all_that_a_profile_may_have():
    profile = G1.profile
    assert profile.name == "g1_29dof"
    assert set(profile.links.values()) <= {*G1.link_names}
    assert figures(lump_fixed_joints(G1, is_dynamic=False), "hold").endswith("g1_29dof")
    poses = read_poses(G1)
    assert profile.standing_pose in poses
    for pose in poses.values():
        check_pose(pose, G1)
    motors = motors_of(G1)
    assert all(motors.of(joint.name) != ServoMotor() for joint in G1.movable_joints)
    assert profile.collisions == PROFILE / "collisions.yaml"


def test_a_robot_is_found_by_its_name_and_its_joints():
    """Others call 29 other joints g1_29dof."""
    names = [joint.name for joint in G1.movable_joints]
    assert with_joints("g1_29dof", names[::-1]).profile.name == "g1_29dof"
    for others in (names[1:], [*names[1:], "left_toe_joint"], [*names, "left_thumb"]):
        assert with_joints("g1_29dof", others).profile == Profile()
    assert with_joints("robot", names).profile == Profile()


@pytest.mark.parametrize("name", ["g1_23dof", "g1_23dof_rev_1_0"])
def test_the_g1_of_23_joints_has_the_poses_that_need_no_more(name):
    robot = with_joints(name, G1_JOINTS[23])
    assert robot.profile.name == "g1_23dof"
    found = {pose.name for pose in read_poses(robot).values() if fits(pose, robot)}
    assert found == {*read_poses(G1)} - {"squat"}
    assert motors_of(robot).of("left_knee_joint").effort == 139.0
    assert robot.profile.collisions.parent.name == "g1_23dof"


def test_the_revision_is_like_the_g1():
    file = VENDOR.with_name("g1_29dof_rev_1_0.urdf")
    if not file.exists():
        pytest.skip("the vendor's g1_29dof_rev_1_0.urdf is not beside the repository")
    robot = Robot(file)
    assert robot.profile.name == "g1_29dof_rev_1_0"
    assert robot.profile.links == G1.profile.links
    assert robot.pose_names == Robot().pose_names
    assert robot.checker().notes == Robot().checker().notes


def test_a_robot_is_named_by_its_profile_a_folder_or_a_file(add):
    folder = add("mine", f"names: [strider]\nmodel: {FIVE}\n")
    assert Robot("g1_29dof").joint_names == Robot().joint_names
    for given in ("mine", folder, f"{folder}/"):
        robot = Robot(given)
        assert (robot.name, robot.profile.name) == ("strider", "mine")
    assert Robot(FIVE).profile.name == "mine"
    assert Robot(FIVE.read_text()).profile.name == "mine"


def test_a_profile_elsewhere_is_that_of_the_robot_it_names(tmp_path, home):
    (tmp_path / "it").mkdir()
    (tmp_path / "it" / "r.urdf.xacro").write_text(
        '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg '
        'name="root" default="a"/><link name="$(arg root)"/></robot>'
    )
    text = (
        "model: r.urdf.xacro root=trunk\nlinks: {left_foot: trunk, head: nose}\n"
        "points: {tip: {link: nose, point: [0, 0, 0]}, trunk: {link: trunk, point: "
        "[0, 0, 1]}, left_foot: {link: trunk, point: [0, 0, 1]}}\n"
    )
    (tmp_path / "it" / "robot.yaml").write_text(text)
    robot = Robot(tmp_path / "it")
    assert robot.link_names == ("trunk",)
    assert robot.profile.links == {"left_foot": "trunk"}
    assert robot.profile.points == {}  # of no link, and with names of links
    assert robot.profile.missing_links == {"head": "nose"}
    told = figures(lump_fixed_joints(robot.description, is_dynamic=False), "hold")
    assert told.endswith(", whose links head: nose the robot does not have")
    assert parse_urdf('<robot name="r"><link name="a"/></robot>').profile == Profile()


def test_a_file_or_folder_is_no_profile(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert is_profile("g1_29dof")
    (tmp_path / "g1_29dof").write_text(FIVE.read_text())
    assert not is_profile("g1_29dof")
    assert Robot("g1_29dof").name == "strider"
    for name in ("robot.urdf", "a/g1_29dof", "package://a/b", "robot.xacro hand=1", ""):
        assert not is_profile(name)


def test_the_users_profile_comes_before_the_packages(add):
    folder = add("g1_29dof", "names: [g1_29dof]\nstanding_pose: high\n")
    assert find_profile("g1_29dof").standing_pose == "high"
    assert replace(G1).profile.motors is None
    with (folder / "robot.yaml").open("a") as file:
        file.write("like: g1_29dof\n")
    assert find_profile("g1_29dof").standing_pose == "high"
    assert replace(G1).profile.motors == PROFILE / "motors.yaml"


def test_a_profile_like_another_changes_a_part_of_it(add):
    add(
        "mine",
        "like: g1_29dof\nnames: [my_g1]\nlinks: {left_hand: claw}\nmotors:\n"
        "points: {left_palm: {link: claw, point: [0, 0.1, 0]}}\n",
        poses="low: {}\n",
    )
    add("more", "like: ../mine\nposes: ../mine/poses.yaml\n")
    mine, more = find_profile("mine"), find_profile("more")
    assert mine.links == {**G1.profile.links, "left_hand": "claw"}
    palm = LinkPoint("claw", (0.0, 0.1, 0.0), (1.0, 0.0, 0.0))
    assert mine.points == {**G1.profile.points, "left_palm": palm}
    assert mine.standing_pose == more.standing_pose == "stand"
    assert mine.poses.resolve() == more.poses.resolve()
    assert (mine.motors, more.motors) == (None, None)
    assert more.collisions == G1.profile.collisions
    assert (more.names, more.joints, more.model) == (("more",), (), "")


def test_a_change_of_a_file_is_seen(add):
    folder = add("mine", "names: [one]\n")
    assert find_profile("mine").names == ("one",)
    (folder / "robot.yaml").write_text("names: [one, two]\n")
    assert find_profile("mine").names == ("one", "two")


def test_an_unknown_name_is_told_with_those_that_are_known():
    with pytest.raises(UnknownNameError) as error:
        find_profile("g1_29dof_rev")
    assert str(error.value) == (
        "There is no profile and no file 'g1_29dof_rev'. Known profiles: "
        "g1_29dof_rev_1_0, g1_29dof, g1_23dof."
    )
    with pytest.raises(DescriptionError, match=r"Cannot use the model h1: There is no"):
        read_description("h1")


def test_a_profile_without_a_urdf_needs_the_users(add):
    add("mine", "names: [strider]\n")
    with pytest.raises(DescriptionError) as error:
        Robot("mine")
    assert str(error.value) == (
        "Cannot use the model mine: the profile mine names no URDF; give the "
        "robot's own file instead, such as /path/to/strider.urdf."
    )


WRONG = {
    "nmaes: [a]": "unknown key nmaes. Known keys: names, ",
    "- a": "it must be a mapping",
    "names: a": "names must be a list of names (got 'a')",
    "joints: [1]": "joints must be a list of names (got [1])",
    "model: 1": "model must be text (got 1)",
    "links: [a]": "links must map roles to links (got ['a'])",
    "links: {head: 1}": "head of links must be a link (got 1)",
    "points: [a]": "points must map names to points (got ['a'])",
    "points: {palm: hand}": "palm of points must have link, point and axis: ",
    "points: {palm: {link: a}}": "palm of points must have link, point and axis: ",
    "points: {palm: {link: a, point: [0, 0]}}": "palm of points must have link, ",
    "points: {p: {link: a, point: [0, 0, 0], axis: [0, 0, 0]}}": "the axis not 0 ",
    "motors: none.yaml": "/wrong/none.yaml, which is not a file",
    "like: h1": "like has no profile 'h1'. Known profiles: ",
    "like: wrong": "it is like itself",
    "names: [a": "it is not valid YAML: line 1",
}


@pytest.mark.parametrize("text", WRONG)
def test_a_wrong_profile_is_refused_in_a_sentence(add, text):
    """Also for another robot, whose profile it might be."""
    folder = add("wrong", text)
    for use in (lambda: find_profile("wrong"), lambda: Robot(FIVE).profile):
        with pytest.raises(ProfileError) as error:
            use()
        said = str(error.value)
        assert said.startswith(f"The profile {folder / 'robot.yaml'}: ")
        assert WRONG[text] in said
        assert said.endswith(".") and "\n" not in said


def test_poses_of_the_users_other_robots_hide_none_of_this_one(home):
    """The user's file is for all robots."""
    home.parent.mkdir(parents=True)
    text = "stand: {l_hip: 0.5}\nwave: {left_elbow_joint: 0.5}\nlow: {l_hip: 0.1}\n"
    (home.parent / "poses.yaml").write_text(text)
    five = Robot(FIVE)
    assert five.pose_names == ("zero", "stand", "low")
    assert five.named_configuration("stand").tolist() == [0.5, 0.0, 0.0, 0.0]
    robot = Robot()
    assert robot.pose_names == Robot("g1_29dof").pose_names
    assert "low" not in robot.pose_names
    assert robot.named_configuration("stand")[robot.joint_row("left_knee_joint")] == 0.6
    assert robot.named_configuration("wave")[robot.joint_row("left_elbow_joint")] == 0.5
    with pytest.raises(UnknownNameError, match="no movable joint 'l_hip'"):
        robot.named_configuration("low")


def test_the_profiles_of_the_page_are_profiles(add):
    """Its first three blocks of YAML are files of strider, the last one is a G1."""
    page = (REPOSITORY / "docs" / "robots.md").read_text()
    *blocks, like = re.findall("^```yaml\n(.*?)^```", page, re.M | re.S)
    files = {re.match(r"# (\w+)\.yaml", block)[1]: block for block in blocks}
    folder = add("strider", files.pop("robot"), **files)
    (folder / "strider.urdf").write_text(FIVE.read_text())
    strider = Robot("strider")
    assert strider.named_configuration(strider.profile.standing_pose)[0] == -0.4
    assert strider.pose_names == ("zero", "stand")
    assert set(strider.profile.links) == {"left_foot", "right_foot"}
    assert motors_of(strider.description).of("l_ankle") == ServoMotor(effort=20.0)
    assert motors_of(strider.description).of("l_hip") == ServoMotor()
    add("my_g1", like)
    mine = replace(G1, name="my_g1").profile
    assert mine.poses == G1.profile.poses
    assert "left_hand" not in mine.links  # the gripper, which this URDF does not have
    assert mine.links["right_hand"] == "right_rubber_hand"
