"""The example's test passes in a copy, made as its page says."""

import os
import re
import shlex
import subprocess

from support.ros_testing import REPOSITORY

PAGE = REPOSITORY / "docs" / "testing_your_planner.md"
SLOW = 600.0
"""Longest time that the example's test takes on a slow machine, in [s]."""


def copy_as_the_page_says(environment):
    """Run the page's commands that make a copy."""
    source = str(REPOSITORY / "examples")
    for block in re.findall(r"^```text\n(.*?)^```$", PAGE.read_text(), re.M | re.S):
        if block.startswith(("cp ", "cd ")):
            block = block.replace("g1_description/examples", shlex.quote(source))
            subprocess.run(["bash", "-e", "-c", block], env=environment, check=True)


def test_a_copy_passes_where_another_python3_comes_first(tmp_path):
    package = tmp_path / "catkin_ws" / "src" / "my_planner"
    package.parent.mkdir(parents=True)
    environment = {**os.environ, "HOME": str(tmp_path)}
    copy_as_the_page_says(environment)
    assert {path.name for path in package.rglob("*.*") if path.is_file()} == {
        *("CMakeLists.txt", "package.xml", "my_planner.py"),
        *("my_planner.test", "test_my_planner.py"),
    }
    other = tmp_path / "bin" / "python3"
    other.parent.mkdir()
    other.write_text('#!/bin/sh\necho "the wrong python3 runs $*" >&2\nexit 1\n')
    other.chmod(0o755)
    for name, first in ("PATH", other.parent), ("ROS_PACKAGE_PATH", package):
        environment[name] = f"{first}:{environment[name]}"
    environment["ROS_HOME"] = str(tmp_path / "ros")
    run = subprocess.run(
        ["rostest", "my_planner", "my_planner.test"],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=SLOW,
    )
    assert run.returncode == 0, run.stdout
    assert "* TESTS: 3\n" in run.stdout
