"""The Python of the pages runs as it is printed, and docs/python.md names all of it.

What needs a robot runs in test/rostest/test_tutorials.py.
"""

import inspect
import re
import subprocess
import sys

import pytest
from pages import PAGES, ROOT, WITHOUT_LIBRARY, copy_motions, programs

import g1_description
from g1_description import Robot

TEXT = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
PARTS = re.split(r"^## ", TEXT, flags=re.M)
STREAMS, EXPERIMENTS = PARTS[-2:]
ROBOT = "".join(PARTS[:-2])
OFFLINE = {
    page.name: program
    for page in PAGES
    for program in programs(page, robot=False)
    if str(page.relative_to(ROOT)) not in WITHOUT_LIBRARY
}


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


@pytest.mark.parametrize("program", OFFLINE.values(), ids=OFFLINE)
def test_a_program_that_needs_no_robot_runs(program, tmp_path):
    copy_motions(tmp_path)
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", program],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert (run.returncode, run.stderr) == (0, "")


@pytest.mark.parametrize("page", WITHOUT_LIBRARY)
def test_a_program_whose_library_is_missing_has_no_undefined_name(page):
    pytest.importorskip("ruff", reason="ruff is not installed")
    found = programs(ROOT / page)
    assert found
    for program in found:
        run = subprocess.run(
            [sys.executable, "-m", "ruff", "check", "--select", "E9,F821", "-"],
            input=program,
            capture_output=True,
            text=True,
        )
        assert run.returncode == 0, run.stdout


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


def test_the_page_names_what_the_package_exports():
    assert [
        name for name in g1_description.PUBLIC if not re.search(rf"\b{name}\b", TEXT)
    ] == []
    assert all(
        callable(getattr(g1_description, name)) for name in g1_description.PUBLIC
    )
