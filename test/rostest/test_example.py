"""The example's test passes in a copy, made as its page says."""

import os
import re
import shlex
import shutil
import subprocess
import tempfile
import unittest
from pathlib import Path

from support.ros_testing import REPOSITORY

PAGE = REPOSITORY / "docs" / "testing_your_planner.md"
SLOW = 600.0
"""Longest time that the example's test takes on a slow machine, in [s]."""


class TestExample(unittest.TestCase):
    def setUp(self):
        self.folder = Path(tempfile.mkdtemp(prefix="example_"))
        self.addCleanup(shutil.rmtree, self.folder)
        (self.folder / "catkin_ws" / "src").mkdir(parents=True)
        self.environment = {**os.environ, "HOME": str(self.folder)}

    def run_page(self):
        """Do what the page says to make a copy; return the package."""
        source = str(REPOSITORY / "examples")
        for block in re.findall(r"^```text\n(.*?)^```$", PAGE.read_text(), re.M | re.S):
            if block.startswith(("cp ", "cd ")):
                block = block.replace("g1_description/examples", shlex.quote(source))
                subprocess.run(
                    ["bash", "-e", "-c", block], env=self.environment, check=True
                )
        return self.folder / "catkin_ws" / "src" / "my_planner"

    def test_a_copy_passes_where_another_python3_comes_first(self):
        package = self.run_page()
        self.assertEqual(
            {path.name for path in package.rglob("*.*") if path.is_file()},
            {"CMakeLists.txt", "package.xml", "my_planner.py"}
            | {"my_planner.test", "test_my_planner.py"},
        )
        other = self.folder / "bin" / "python3"
        other.parent.mkdir()
        other.write_text('#!/bin/sh\necho "the wrong python3 runs $*" >&2\nexit 1\n')
        other.chmod(0o755)
        for name, first in ("PATH", other.parent), ("ROS_PACKAGE_PATH", package):
            self.environment[name] = f"{first}:{self.environment[name]}"
        self.environment["ROS_HOME"] = str(self.folder / "ros")
        run = subprocess.run(
            ["rostest", "my_planner", "my_planner.test"],
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=SLOW,
        )
        self.assertEqual(run.returncode, 0, run.stdout)
        self.assertIn("* TESTS: 3\n", run.stdout)
