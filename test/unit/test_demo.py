"""The demo: what it says when roslaunch refuses its arguments."""

import os
import subprocess

import pytest
from conftest import REPOSITORY

from ports import free_port

pytest.importorskip("rospy", reason="rospy is not installed")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("argument", "words"),
    [
        ("physics:=holdd", "There is no physics 'holdd'; there are hold,"),
        ("model:=", "model:= is empty"),
    ],
)
def test_wrong_arguments_end_it_with_their_sentence_alone(argument, words):
    run = subprocess.run(
        ["/usr/bin/python3", REPOSITORY / "tools" / "demo.py", argument],
        env={**os.environ, "ROS_MASTER_URI": f"http://localhost:{free_port()}"},
        capture_output=True,
        text=True,
    )
    assert run.returncode == 1
    (line,) = run.stderr.splitlines()
    assert line.startswith(f"tools/demo: {words}")
