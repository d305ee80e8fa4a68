"""Commands that need no ROS do their work in a Python that has none.

Those that most need are tested from the wheel.
"""

import os
import re
import subprocess
import sys

import pytest
from conftest import REPOSITORY

TREE = REPOSITORY / "test" / "data" / "tree.urdf"

PROGRAM = r"""
import re, runpy, sys

class Finder:
    def find_spec(self, name, path=None, target=None):
        of_ros = r"ros(py|graph|pkg|lib)|genpy|actionlib|tf2_\w+|\w+_(msgs|srvs)"
        if re.match(rf"({of_ros}|g1_description\.(msg|srv))(\.|$)", name):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Finder())
del sys.argv[0]
runpy.run_path(sys.argv[0], run_name="__main__")
"""
"""Runs a command where modules of ROS are not found."""


def started(name, *words):
    """Start a command."""
    path = os.pathsep.join([str(REPOSITORY / "src"), *sys.path])
    program = [sys.executable, "-c", PROGRAM, str(REPOSITORY / "scripts" / name)]
    return subprocess.Popen(
        [*program, *map(str, words)],
        env={**os.environ, "PYTHONPATH": path},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.parametrize(
    ("words", "made"),
    [
        (["snapshot", "--model", TREE, "a.html"], "a.html"),
        (["import_model", TREE, "--out", "robot"], "robot/report.md"),
        (["collision_pairs", TREE, "--samples", 9, "--out", "a.yaml"], "a.yaml"),
        (["moveit_config", "--model", TREE, "moveit"], "moveit/robot.srdf"),
    ],
    ids=lambda words: words[0] if isinstance(words, list) else "",
)
def test_a_command_does_its_work(words, made, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with started(*words) as process:
        _, errors = process.communicate()
    assert process.returncode == 0, errors
    assert (tmp_path / made).stat().st_size > 0


@pytest.mark.parametrize("words", [["snapshot", "out.png"], ["snapshot", "out.html"]])
def test_a_running_robot_needs_ros(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with started(*words) as process:
        output, errors = process.communicate()
    assert process.returncode in (1, 2) and output == ""
    assert re.fullmatch(r"snapshot: .*need ROS .*\n", errors)
    assert not list(tmp_path.iterdir())
