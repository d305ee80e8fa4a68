"""The Python of docs/python.md does what the page says."""

import inspect
import re
import subprocess
import sys

from pages import ROOT, blocks

from g1_description import Robot

TEXT = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
PARTS = re.split(r"^## ", TEXT, flags=re.M)
ROBOT = "".join(part for part in PARTS if not part.startswith("Experiments"))
"""What needs no ROS; the rest is run in test/ros/test_client.py."""


def test_the_page_is_one_program(tmp_path):
    program = "\n".join(blocks(ROBOT, "python"))
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", program],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert (run.returncode, run.stderr) == (0, "")
    assert "g1_29dof" in run.stdout
    assert "(1000, 3)" in run.stdout
    assert (tmp_path / "wave.csv").exists()


def test_the_page_names_every_public_method():
    """And every argument of those in a table."""
    for name, member in inspect.getmembers(Robot):
        if name.startswith("_"):
            continue
        assert re.search(rf"\b{name}\b", ROBOT), name
        for row in re.findall(rf"`(?:robot\.)?{name}\(([^)]*)\)`[^|]*\|", ROBOT):
            arguments = [*inspect.signature(member).parameters][1:]
            assert row.split(", ") == arguments, name
