"""Tab completes the names of poses in a real bash, and leaves the rest as it was."""

import shlex
import subprocess
from pathlib import Path

import pytest
from conftest import REPOSITORY

from g1_description.cli.doctor import CHECK_NAMES

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
    run = subprocess.run(
        ["bash", "--norc", "-c", script], capture_output=True, text=True, check=False
    )
    assert not run.stderr
    return [line.split() for line in run.stdout.splitlines()]


def typed(words, function):
    """Write the part of a script that lets a function complete the last word.

    The words are as readline splits them.
    """
    last = shlex.quote(words[-1])
    return f"""
    COMP_WORDS=({" ".join(map(shlex.quote, words))}); COMP_CWORD={len(words) - 1}
    COMPREPLY=(); {function} {words[0]} {last} '' 2>/dev/null
    echo "${{COMPREPLY[*]}}" """


def complete(*lines, before=""):
    """Let one bash complete lines, with what was sourced before ours.

    Ours is sourced twice, as by a user who sources setup.bash again.
    """
    script = f"set -u; {before}\nsource '{OURS}'; source '{OURS}'; set +u"
    for words in lines:
        script += f"\n[[ $(complete -p {words[0]}) =~ \\ -F\\ ([^ ]+) ]]"
        script += typed(words, '"${BASH_REMATCH[1]}"')
    return bash(script)


READ = str(REPOSITORY / "READ")
README = f"{READ}ME.md"
RUN = ("rosrun", "g1_description")
POSE = (*RUN, "pose")
DISPLAY = ("roslaunch", "g1_description", "display.launch")
COMPLETED = {
    (*POSE, ""): NAMES,
    (*POSE, "s"): ["stand", "squat", "sit"],
    (*POSE, "--save", "w"): ["wave"],
    (*POSE, "--se"): ["--seconds"],
    (*POSE, "stand", "--seconds", ""): [],
    (*RUN, "record", "--r"): ["--rate"],
    (*RUN, "record", "a.csv", "--rate", ""): [],
    (*RUN, "record", "--force", READ): [README],
    (*RUN, "check", "--c"): ["--collisions", "--csv"],
    (*RUN, "motion", "re"): ["retime", "resample", "rename"],
    (*RUN, "motion", "cut", "--f"): [
        "--fastest",
        "--force",
        "--format",
        "--fps",
        "--from",
    ],
    (*RUN, "motion", "info", READ): [README],
    (*RUN, "check", "a.csv", "--json", READ): [README],
    (*RUN, "doctor", "--j"): ["--json"],
    (*RUN, "doctor", "--until", "li"): ["link_states"],
    (*RUN, "doctor", "--until", ""): CHECK_NAMES,
    (*RUN, "doctor", "--namespace", ""): [],
    (*RUN, "play", READ): [README],
    (*RUN, "web", "--compare", "a.csv", READ): [README],
    (*DISPLAY, "initial_pose", ":="): NAMES,
    (*DISPLAY, "initial_pose", ":=", "s"): ["stand", "squat", "sit"],
    (*DISPLAY, "paused", ":=", "true", "initial_pose", ":=", "t"): ["t_pose"],
    (*DISPLAY, "initial_pose", ":=", "stand", "ph"): [],
    (*DISPLAY, "robot_name", ":=", "s"): [],
    ("roslaunch", "other", "a.launch", "initial_pose", ":=", "s"): [],
    (*RUN, "other", "s"): [],
    ("rosrun", "other", "pose", "s"): [],
}


def test_names_are_completed_where_they_belong():
    assert dict(zip(COMPLETED, complete(*COMPLETED))) == COMPLETED


def test_poses_of_the_user_are_completed_too(home):
    (home / "g1_description").mkdir()
    (home / "g1_description" / "poses.yaml").write_text("# mine:\nsalto: {}\n")
    assert complete((*POSE, "sa")) == [["salto"]]


def test_who_completed_before_still_does():
    before = "old() { COMPREPLY=(old $1 $2); }; complete -F old -o nospace rosrun"
    found = complete(("rosrun", "other", "x"), (*POSE, "wa"), before=before)
    assert found == [["old", "rosrun", "x"], ["wave"]]


def test_the_completion_of_rosbash_is_as_it_was():
    found = [file for file in ROSBASH if file.is_file()]
    if not found:
        pytest.skip("rosbash is not installed")
    lines = [("rosrun", "rosto"), ("rosrun", "--")]
    lines += [("roslaunch", "--wa"), ("roslaunch", "ros")]
    function = {"rosrun": "_roscomplete_exe", "roslaunch": "_roscomplete_launch"}
    script = "".join(typed(words, function[words[0]]) for words in lines)
    alone = bash(f"source '{found[0]}'{script}")
    assert all(alone)
    ours = complete(*lines, before=f"set +u; source '{found[0]}'")
    assert [*map(sorted, ours)] == [*map(sorted, alone)]
