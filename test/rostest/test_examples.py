"""Examples that move a robot print what their page shows."""

import subprocess
import sys

import pytest
from support.ros_testing import DEADLINE, REPOSITORY

EXAMPLES = sorted((REPOSITORY / "examples").glob("*.py"))
WITH_ROBOT = [
    path
    for path in EXAMPLES
    if any(f"import {name}" in path.read_text() for name in ("rospy", "Client"))
]


@pytest.mark.parametrize("path", WITH_ROBOT, ids=[path.stem for path in WITH_ROBOT])
def test_an_example_prints_what_the_page_shows(path):
    run = subprocess.run(
        [sys.executable, path], stdout=subprocess.PIPE, text=True, timeout=DEADLINE
    )
    assert run.returncode == 0
    assert run.stdout == (path.parent / "output" / f"{path.stem}.txt").read_text()
