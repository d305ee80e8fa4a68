"""The command g1, which lists and runs the commands that need no ROS."""

import re
import subprocess
import sys

import pytest

PROGRAM = (
    "import sys; sys.modules['rospy'] = None; sys.argv[0] = 'bin/g1'; "
    "from g1_description.cli.g1 import main; main()"
)
NAMES = ("check", "collision_pairs", "import_model", "motion", "moveit_config")
NAMES += ("snapshot", "web")


def g1(*words):
    """Run it; return its exit code and what it prints."""
    command = [sys.executable, "-c", PROGRAM, *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize("words", [[], ["--help"]])
def test_it_lists_the_commands_with_a_line_each(words):
    code, output, errors = g1(*words)
    assert (code, errors) == (0, "") and output.startswith("usage: g1 ")
    assert re.findall(r"^    (\w+)\s+[A-Z].*\.$", output, re.M) == [*NAMES]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["chek"], "g1: argument COMMAND: invalid choice: 'chek'"),
        (["play", "squat.csv"], "g1: play needs ROS: source the workspace, and run "),
        (["motion", "check"], "g1 motion: check is a command of its own: g1 check"),
        (["motion", "info"], "g1 motion info: the following arguments are required"),
    ],
)
def test_what_it_does_not_know_is_refused_in_a_sentence(words, sentence):
    code, output, errors = g1(*words)
    assert (code, output, len(errors.splitlines())) == (2, "", 1)
    assert errors.startswith(sentence)
    assert words != ["chek"] or "(did you mean check?)" in errors
