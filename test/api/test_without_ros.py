"""The sentence where ROS, or a library that pip installs, is missing."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    ("name", "missing", "words"),
    [
        ("Client", "rospy", "it needs ROS. Source the workspace and use"),
        ("Robot", "numpy", "-m pip install "),
    ],
)
def test_a_missing_module_is_told_with_what_to_do(name, missing, words):
    program = (
        f"import sys; sys.modules['{missing}'] = None; import g1_description; "
        f"g1_description.{name}"
    )
    command = [sys.executable, "-c", program]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode != 0
    last = ended.stderr.strip().splitlines()[-1]
    assert f"g1_description.{name} needs {missing}" in last
    assert words in last


def test_a_star_imports_all_that_needs_no_ros():
    names = "import sys; sys.modules['rospy'] = None; from g1_description import *"
    subprocess.run([sys.executable, "-c", f"{names}; Robot, Target, line"], check=True)
