"""ROS' own Python finds what pip installed for the Python that catkin was given."""

import os
import subprocess
import sys
from importlib import util
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
OWN = "{}.{}".format(*sys.version_info)


@pytest.fixture
def search_path(tmp_path):
    """Give what says where a Python finds modules, after catkin was given another."""
    installed = tmp_path / "site-packages"
    generated = tmp_path / "devel" / "g1_description"
    for folder in (installed, generated):
        folder.mkdir(parents=True)
    (generated / "__init__.py").write_text("")

    def run(version, *extra):
        text = (ROOT / "cmake" / "built_with.py.in").read_text()
        for name, value in {
            "@PYTHON_VERSION_MAJOR@.@PYTHON_VERSION_MINOR@": version,
            "@SITE_PACKAGES@": str(installed),
        }.items():
            assert name in text
            text = text.replace(name, value)
        (generated / "built_with.py").write_text(text)
        path = os.pathsep.join([str(ROOT / "src"), str(generated.parent), *extra])
        program = "import g1_description, sys; print(*sys.path, sep='\\n')"
        found = subprocess.run(
            [sys.executable, "-c", program],
            env={"PYTHONPATH": path},
            cwd=tmp_path,
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        )
        return found.stdout.splitlines()

    run.installed = installed
    return run


def test_another_environment_of_the_same_version_is_searched_last(search_path):
    assert search_path(OWN)[-1] == str(search_path.installed)


def test_folders_that_an_environment_adds_are_searched_as_well(search_path):
    """As those of wheels that bring libraries."""
    more = search_path.installed / "more"
    more.mkdir()
    (search_path.installed / "more.pth").write_text("more\n")
    assert search_path(OWN)[-2:] == [str(search_path.installed), str(more)]


def test_what_is_searched_already_is_not_searched_twice(search_path):
    installed = str(search_path.installed)
    assert search_path(OWN, installed).count(installed) == 1


def test_an_environment_of_another_version_is_left_alone(search_path):
    assert str(search_path.installed) not in search_path("2.7")


@pytest.mark.slow
def test_the_robot_works_with_the_python_of_ros():
    if util.find_spec("g1_description.built_with") is None:
        pytest.skip("no workspace is sourced")
    if sys.prefix == sys.base_prefix:
        pytest.skip("these tests run with the Python of ROS themselves")
    program = "from g1_description import Robot; print(Robot().name)"
    run = subprocess.run(
        [Path(sys.executable).resolve(), "-c", program], capture_output=True, text=True
    )
    assert (run.stdout, run.stderr) == ("g1_29dof\n", "")
