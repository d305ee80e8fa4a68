"""The Python of docs/python.md does what the page says."""

import inspect
import re
import subprocess
import sys

import pytest
from pages import ROOT, blocks

import g1_description
from g1_description import Robot

TEXT = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
PARTS = re.split(r"^## ", TEXT, flags=re.M)
STREAMS, EXPERIMENTS = PARTS[-2:]
ROBOT = "".join(PARTS[:-2])
"""What needs no ROS; the rest is run in test/rostest."""


def rows(text, name):
    """List the arguments that tables give a function."""
    found = re.findall(rf"`(?:robot\.)?{name}\(([^)]*)\)`[^|]*\|", text)
    return [[word for word in arguments.split(", ") if word] for arguments in found]


def unknown(kind, text):
    """List public members that a text does not name, or with other arguments."""
    members = [(n, m) for n, m in inspect.getmembers(kind) if not n.startswith("_")]
    return [
        name
        for name, member in members
        if not re.search(rf"\b{name}\b", text)
        or any(
            arguments != [*inspect.signature(member).parameters][1:]
            for arguments in rows(text, name)
        )
    ]


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
    assert (tmp_path / "my_wave.csv").exists()


def test_the_page_names_every_public_method():
    assert unknown(Robot, ROBOT + STREAMS) == []


@pytest.mark.parametrize(
    ("name", "text"), [("Client", EXPERIMENTS), ("Stream", STREAMS)]
)
def test_the_page_names_every_method_of_what_needs_ros(name, text):
    pytest.importorskip("rospy", reason="rospy is not there")
    pytest.importorskip("g1_description.srv", reason="no workspace is sourced")
    kind = getattr(g1_description, name)
    assert unknown(kind, text) == []
    assert rows(text, name) == [[*inspect.signature(kind).parameters]]
