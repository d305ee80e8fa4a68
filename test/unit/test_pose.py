"""The command line of pose: one sentence for each mistake."""

import pytest

pytest.importorskip("rospy", reason="rospy is not installed")

from g1_description.ros.pose import parse


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ([], "one of the arguments NAME --list --save is required"),
        (["squat", "--list"], "not allowed with"),
        (["squat", "--seconds", "-1"], "time does not go back"),
        (["squat", "--seconds=-1"], "time does not go back"),
        (["squat", "--seconds", "nan"], "'nan' is not a number"),
        (["squat", "--force"], "--force and --about go with --save"),
        (["squat", "--namespace", "a b"], "'a b' is no ROS name"),
        (["--save", "zero"], "--save: every robot has zero, choose another name"),
        (["--save", "zero", "--force"], "every robot has zero"),
    ],
)
def test_a_wrong_command_line_ends_with_a_sentence(words, told, capsys):
    with pytest.raises(SystemExit) as ended:
        parse(words)
    assert ended.value.code == 1
    output, errors = capsys.readouterr()
    assert told in errors
    assert (output, len(errors.splitlines())) == ("", 1)


def test_a_namespace_may_be_written_as_in_a_launch_file():
    for text in ("left", "/left", "left/"):
        assert parse(["squat", "--namespace", text]).namespace == "left"
