"""Tab completes the names of poses in a real bash, and leaves the rest as it was."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import REPOSITORY

from g1_description.cli.doctor import LINKS

ROSBASH = [
    *Path("/opt/ros").glob("*/share/rosbash/rosbash"),
    Path("/usr/share/bash-completion/completions/rosbash"),
]
OURS = REPOSITORY / "config" / "completion.bash"
NAMES = ["zero", "stand", "squat", "t_pose", "hands_up", "wave", "sit"]


@pytest.fixture(autouse=True)
def home(tmp_path, monkeypatch):
    """Give the folder of the user's poses; rospack keeps its cache there."""
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    monkeypatch.setenv("PATH", "/usr/bin:/bin")
    return tmp_path


def bash(script):
    """Run a script in a bash that has read nothing else."""
    return subprocess.run(
        ["bash", "--norc", "-c", script], capture_output=True, text=True, check=False
    )


def complete(*words, before=""):
    """Let bash complete the last word, with what was sourced before ours.

    The words are as readline splits them; ours is sourced twice, as by a user who
    sources setup.bash again.
    """
    quoted = " ".join(f"'{word}'" for word in words)
    script = f"""set -u; {before}
    source '{OURS}'; source '{OURS}'
    [[ $(complete -p {words[0]}) =~ \\ -F\\ ([^ ]+) ]]
    COMP_WORDS=({quoted}); COMP_CWORD={len(words) - 1}; COMPREPLY=()
    set +u; "${{BASH_REMATCH[1]}}" {words[0]} '{words[-1]}' '' 2>/dev/null
    printf '%s\\n' "${{COMPREPLY[@]}}" """
    run = bash(script)
    assert not run.stderr
    return run.stdout.split()


README = str(REPOSITORY / "README.md")
RUN = ("rosrun", "g1_description")
POSE = ("rosrun", "g1_description", "pose")
DISPLAY = ("roslaunch", "g1_description", "display.launch")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ([*POSE, ""], NAMES),
        ([*POSE, "s"], ["stand", "squat", "sit"]),
        ([*POSE, "--save", "w"], ["wave"]),
        ([*POSE, "--se"], ["--seconds"]),
        ([*POSE, "stand", "--seconds", ""], []),
        ([*RUN, "record", "--r"], ["--rate"]),
        ([*RUN, "record", "a.csv", "--rate", ""], []),
        ([*RUN, "record", "--force", str(REPOSITORY / "READ")], [README]),
        ([*RUN, "check", "--c"], ["--collisions", "--csv"]),
        ([*RUN, "check", "a.csv", "--json", str(REPOSITORY / "READ")], [README]),
        ([*RUN, "check", "a.csv", "--jobs", ""], []),
        ([*RUN, "doctor", "--j"], ["--json"]),
        ([*RUN, "doctor", "--until", "li"], ["link_states"]),
        ([*RUN, "doctor", "--namespace", ""], []),
        ([*RUN, "collision_pairs", "--s"], ["--samples", "--seed"]),
        ([*RUN, "play", "--s"], ["--speed", "--start-here"]),
        ([*RUN, "play", str(REPOSITORY / "READ")], [README]),
        ([*RUN, "web", "--mo"], ["--model", "--motion"]),
        ([*RUN, "web", "--motion", str(REPOSITORY / "READ")], [README]),
        ([*RUN, "web", "--compare", "a.csv", str(REPOSITORY / "READ")], [README]),
        ([*RUN, "web", "--port", ""], []),
        ([*DISPLAY, "initial_pose", ":="], NAMES),
        ([*DISPLAY, "initial_pose", ":=", "s"], ["stand", "squat", "sit"]),
        ([*DISPLAY, "paused", ":=", "true", "initial_pose", ":=", "t"], ["t_pose"]),
        ([*DISPLAY, "initial_pose", ":=", "stand", "ph"], []),
        ([*DISPLAY, "robot_name", ":=", "s"], []),
        (["roslaunch", "other", "a.launch", "initial_pose", ":=", "s"], []),
        (["rosrun", "g1_description", "other", "s"], []),
        (["rosrun", "other", "pose", "s"], []),
    ],
)
def test_names_are_completed_where_they_belong(words, expected):
    assert complete(*words) == expected


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    ["check", "collision_pairs", "doctor", "pose", "play", "record", "web"],
)
def test_all_options_are_completed(command):
    run = [sys.executable, REPOSITORY / "scripts" / command, "--help"]
    path = os.pathsep.join([str(REPOSITORY / "src"), *sys.path])
    text = subprocess.run(
        run, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True
    ).stdout
    options = {*re.findall(r"--[a-z][a-z-]*", text)}
    assert {*complete(*RUN, command, "--")} == options | {"--help"}


def test_all_links_of_the_doctor_are_completed():
    assert complete(*RUN, "doctor", "--until", "") == LINKS


def test_poses_of_the_user_are_completed_too(home):
    (home / "g1_description").mkdir()
    (home / "g1_description" / "poses.yaml").write_text("# mine:\nsalto: {}\n")
    assert complete(*POSE, "sa") == ["salto"]


def test_who_completed_before_still_does():
    before = "old() { COMPREPLY=(old $1 $2); }; complete -F old -o nospace rosrun"
    assert complete("rosrun", "other", "x", before=before) == ["old", "rosrun", "x"]
    assert complete(*POSE, "wa", before=before) == ["wave"]


@pytest.mark.parametrize(
    "words",
    [
        ["rosrun", "rosto"],
        ["rosrun", "--"],
        ["roslaunch", "--wa"],
        ["roslaunch", "ros"],
    ],
)
def test_the_completion_of_rosbash_is_as_it_was(words):
    found = [file for file in ROSBASH if file.is_file()]
    if not found:
        pytest.skip("rosbash is not installed")
    function = {"rosrun": "_roscomplete_exe", "roslaunch": "_roscomplete_launch"}
    quoted = " ".join(f"'{word}'" for word in words)
    script = f"""source '{found[0]}'; COMP_WORDS=({quoted}); COMP_CWORD=1
    {function[words[0]]} {words[0]} '{words[1]}' '' 2>/dev/null
    printf '%s\\n' "${{COMPREPLY[@]}}" """
    alone = bash(script).stdout.split()
    assert alone
    ours = complete(*words, before=f"set +u; source '{found[0]}'")
    assert sorted(ours) == sorted(alone)
