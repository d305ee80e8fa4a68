"""Files of poses: what is read, what is refused, and how they are written."""

import resource
from contextlib import contextmanager

import numpy as np
import pytest
import yaml
from conftest import PROFILE, REPOSITORY
from hypothesis import given, settings
from hypothesis import strategies as st

from g1_description.errors import (
    G1DescriptionError,
    InvalidValueError,
    PoseFileError,
    UnknownNameError,
)
from g1_description.robot import poses
from g1_description.robot.poses import (
    Pose,
    check_pose,
    find_pose,
    parse_poses,
    pose_positions,
    save_pose,
    with_pose,
)
from g1_description.robot.urdf import parse_urdf

POSES = parse_poses(
    (PROFILE / "poses.yaml").read_text(),
    "poses.yaml",
)
G1 = parse_urdf((REPOSITORY / "urdf" / "g1_29dof.urdf").read_text())
DATA = REPOSITORY / "test" / "data"


def test_the_package_has_these_poses_each_with_a_line_of_text():
    names = ["zero", "stand", "squat", "t_pose", "hands_up", "wave", "sit"]
    assert list(POSES) == names
    assert all(pose.about for pose in POSES.values())


@pytest.mark.parametrize("name", POSES)
def test_a_pose_of_the_package_is_one_of_the_g1(g1_text, name):
    check_pose(POSES[name], parse_urdf(g1_text))


@pytest.mark.parametrize("name", ["stand", "squat", "sit", "t_pose", "hands_up"])
def test_left_and_right_mirror_each_other(name):
    positions = POSES[name].positions
    for joint, position in positions.items():
        turned = -1.0 if joint.endswith(("_roll_joint", "_yaw_joint")) else 1.0
        if joint.startswith("left_"):
            assert positions[f"right_{joint[5:]}"] == turned * position


def test_a_file_maps_names_to_joints_and_joints_to_positions():
    text = "low:\n  about: one\n    line\n  knee: 1\n  hip: -0.5\nzero: {}\n"
    assert parse_poses(text, "here") == {
        "low": Pose("low", {"knee": 1.0, "hip": -0.5}, "one line", "here"),
        "zero": Pose("zero", {}, "", "here"),
    }
    assert parse_poses("# nothing yet\n", "here") == {}


def test_a_keyframe_has_a_time_and_a_base_unless_a_joint_has_its_name():
    key = {"time": 1.5, "base": [0.0, 0.0, 0.8, 0.0, 0.0, 0.0, 1.0], "through": "pass"}
    pose = Pose("low_1", {"hip": 1.0}, "", "here", key)
    text = with_pose("", pose, "here")
    assert parse_poses(text, "here") == {"low_1": pose}
    assert len(text.splitlines()) == 3
    old = parse_poses("low: {keyframe: 0.5}", "here")["low"]
    assert (old.positions, old.keyframe) == ({"keyframe": 0.5}, {})


def test_a_pose_may_begin_with_another_one():
    text = "low: &low {knee: 1, hip: 2}\nlower:\n  <<: *low\n  hip: 3\n"
    assert parse_poses(text, "here")["lower"].positions == {"knee": 1.0, "hip": 3.0}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "- knee",
            "here must map names of poses to joint positions (got a list)",
        ),
        ("low: 3", "Pose low of here must map joints to positions (got 3)."),
        ("low:", "Pose low of here must map joints to positions (got None)."),
        ("two words: {}", "Invalid name: 'two words'"),
        ("1: {}", "Invalid name: 1. Names must begin with a letter"),
        ("low: {about: 3}", "Pose low of here: about must be text (got 3)."),
        (
            "low: {keyframe: {time: 0, base: [0, 0, 1]}}",
            "Pose low of here: a keyframe must have a time in s, and a base",
        ),
        ("low: {keyframe: {time: .nan, base: [0, 0, 0, 0, 0, 0, 1]}}", "finite number"),
        (
            "low: {keyframe: {time: 0, base: [0, 0, 0, 0, 0, 0, 1], fixed_links: x}}",
            "fixed_links must be a list of names.",
        ),
        ("low: {3: 1.0}", "Pose low of here: names of joints must be text (got 3)."),
        ("low: {}\nhigh: {}\nlow: {}", 'line 3: found duplicate key "low".'),
        ("low:\n  knee: 1\n  knee: 2", 'line 3: found duplicate key "knee".'),
        ("low: {knee: [}", "here cannot be read: line 1: "),
        (
            "low: {? [a] : 1}",
            "Pose low of here: names of joints must be text (got ('a',)).",
        ),
        ("low: \x00", "here cannot be read: "),
        ("[" * 500, "here cannot be read"),
    ],
)
def test_a_text_of_another_form_is_refused(text, words):
    with pytest.raises(PoseFileError) as told:
        parse_poses(text, "here")
    assert words in str(told.value)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("value", [".nan", "true", "null"])
def test_a_position_is_a_finite_number(value):
    with pytest.raises(
        InvalidValueError, match="the position of knee must be a finite number"
    ):
        parse_poses(f"low: {{knee: {value}}}", "here")


FILE = """# mine

low:  # deep
  knee: 1.0  # bent
# the next one
high: {hip: 2}
"""


def test_a_new_pose_is_added_behind_all_others():
    text = with_pose(FILE, Pose("flat", {"hip": -0.5}, "lies: down"), "here")
    assert text == FILE + "\nflat:\n  about: 'lies: down'\n  hip: -0.5\n"
    assert with_pose("", Pose("flat"), "here") == "flat: {}\n"


POSES_OF_A_USER = [
    "low:  {knee:  1.50,  # bent\n  hip: 1e-3}\n\n\n# end\n",
    "low:\n    about: one\n      line\n    knee:   1\n    # more\n\n",
    "low:\n  knee: 1\n  about: |\n    one\n    # line\n\n# the next\n",
    "low: &low {knee: 1}\nlower:\n  <<: *low\n  hip: 3\n",
    "? low\n: {knee: 1}\n",
    "low: {}\r\n# one\r\n\r\nlower:\r\n  knee: 1  # two\r\n",
]


def flat_for(text):
    """Make a pose as a file gets it that has such ends of lines."""
    end = "\r\n" if "\r\n" in text else "\n"
    return end, f"flat:{end}  hip: 1.0{end}"


@pytest.mark.parametrize(
    "text", [*POSES_OF_A_USER, "---\nlow: {}\n", "# one\n---\n# two\nlow: {}\n"]
)
def test_the_lines_before_a_new_pose_stay_whatever_they_look_like(text):
    end, flat = flat_for(text)
    added = with_pose(text, Pose("flat", {"hip": 1.0}), "here")
    assert added == text.rstrip() + end * 2 + flat


@pytest.mark.parametrize("text", POSES_OF_A_USER)
def test_the_lines_behind_a_replaced_pose_stay_whatever_they_look_like(text):
    end, flat = flat_for(text)
    old = f"flat: {{}}{end}# low{end}{text}"
    replaced = with_pose(old, Pose("flat", {"hip": 1.0}), "here")
    assert replaced == f"{flat}# low{end}{text}"


def test_a_pose_with_lines_of_text_at_its_end_is_replaced_as_a_whole():
    old = "low:\n  about: |\n    one\n\n    two\n\n# the next one\nhigh: {}\n"
    text = with_pose(old, Pose("low", {"hip": 1.0}), "here")
    assert text == "low:\n  hip: 1.0\n\n# the next one\nhigh: {}\n"


def test_small_positions_are_numbers_for_yaml_1_1_and_1_2():
    text = with_pose("", Pose("low", {"knee": 1e-06}), "here")
    assert yaml.safe_load(text) == {"low": {"knee": 1e-06}}
    assert parse_poses("low: {knee: 1e-06}", "here")["low"].positions["knee"] == 1e-06


def aliases(entry):
    """Write ten poses, each with ten aliases of the one before."""
    poses = ["x0: &x0 {x: 1}\n"]
    for n in range(1, 10):
        ten = ", ".join([f"*x{n - 1}"] * 10)
        poses.append(f"x{n}: &x{n} {{{entry}: [{ten}]}}\n")
    return "".join(poses)


@pytest.mark.parametrize(
    ("name", "old"),
    [("low", "low:  # deep\n  knee: 1.0  # bent\n"), ("high", "high: {hip: 2}\n")],
)
def test_a_pose_is_replaced_and_all_other_lines_stay(name, old):
    text = with_pose(FILE, Pose(name, {"hip": 3.0}), "here")
    assert text == FILE.replace(old, f"{name}:\n  hip: 3.0\n")


@pytest.mark.parametrize(
    "text",
    [
        "{low: {knee: 1}, high: {}}",
        "low: &low {knee: 1}\nhigh: *low\n",
    ],
)
def test_a_form_that_cannot_be_edited_is_refused(text):
    with pytest.raises(PoseFileError, match="here cannot be edited"):
        with_pose(text, Pose("low", {"knee": 2.0}), "here")


@settings(max_examples=20)
@given(
    st.lists(st.sampled_from(["on", "low", "e1", "null", "n-o"]), max_size=4),
    st.dictionaries(
        st.sampled_from(["knee", "no", "hip"]), st.floats(-1e9, 1e9), max_size=3
    ),
    st.text(max_size=20),
)
def test_what_is_written_is_read_back(names, positions, about):
    text, expected = "", {}
    for number, name in enumerate(names):
        shifted = {joint: value + number for joint, value in positions.items()}
        expected[name] = Pose(name, shifted, " ".join(about.split()), "here")
        text = with_pose(text, Pose(name, shifted, about), "here")
    assert parse_poses(text, "here") == expected


def test_an_unknown_pose_is_answered_with_the_near_names_first():
    with pytest.raises(UnknownNameError) as told:
        find_pose("sqat", POSES)
    assert "Unknown pose 'sqat'. Known poses: squat, zero, stand" in str(told.value)


def test_a_joint_that_the_robot_does_not_have_is_named_with_near_ones():
    with pytest.raises(UnknownNameError) as told:
        check_pose(Pose("low", {"left_kne_joint": 0.0}, "", "here"), G1)
    assert "'g1_29dof' has no movable joint 'left_kne_joint'" in str(told.value)
    assert "Its joints: left_knee_joint, " in str(told.value)


@pytest.mark.parametrize("position", [-0.1, 2.9])
def test_a_position_is_inside_the_limits(position):
    with pytest.raises(InvalidValueError) as told:
        check_pose(Pose("low", {"left_knee_joint": position}, "", "here"), G1)
    words = f"left_knee_joint must be from -0.087267 to 2.8798 (got {position})."
    assert words in str(told.value)


def test_joints_that_are_not_named_are_at_zero_or_the_limit_next_to_it():
    (joint,) = (
        robot := parse_urdf((DATA / "range_2_8.urdf").read_text())
    ).movable_joints
    np.testing.assert_array_equal(pose_positions(Pose("zero"), robot), [joint.lower])
    positions = dict(zip((j.name for j in G1.movable_joints), range(29)))
    squat = pose_positions(POSES["squat"], G1)
    for name, row in positions.items():
        assert squat[row] == POSES["squat"].positions.get(name, 0.0)


@contextmanager
def tiny_files():
    """Let no file grow beyond ten bytes, as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_pose_that_cannot_be_written_leaves_nothing(tmp_path):
    told = pytest.raises(G1DescriptionError, match="cannot be written: File too large")
    with told, tiny_files():  # as short as can be: pytest writes to a file, too
        save_pose(Pose("low", {"knee": 1.0}), tmp_path / "poses.yaml")
    assert not list(tmp_path.iterdir())


def test_poses_of_the_package_are_not_replaced(tmp_path, monkeypatch):
    """What is beside the package may be."""
    package = tmp_path / "g1" / "config" / "robots" / "g1_29dof" / "poses.yaml"
    monkeypatch.setattr(poses, "share_folder", lambda: tmp_path / "g1")
    for file in (package, tmp_path / "g1" / "mine.yaml"):
        with pytest.raises(G1DescriptionError, match="belongs to the package"):
            save_pose(Pose("low", {"knee": 1.0}), file)
        assert not file.exists()
    save_pose(Pose("low", {"knee": 1.0}), tmp_path / "mine.yaml")
    assert (tmp_path / "mine.yaml").read_text() == "low:\n  knee: 1.0\n"
