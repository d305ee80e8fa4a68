"""pip installs what programs need that know neither ROS nor catkin.

Nothing is downloaded: the packages that the installed one asks for are links to those
of this environment, and nothing else is to be found.
"""

import os
import re
import shutil
import subprocess
import sys
from importlib import metadata, util
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
IMPORTED_AS = {"Pillow": "PIL", "ruamel.yaml": "ruamel", "PyYAML": "yaml"}
"""What packages are called in programs where that is not nearly their name."""

BUILT_FROM = ("config", "meshes", "motions", "src", "urdf")
BUILT_FROM += ("package.xml", "pyproject.toml", "setup.py")
"""A copy of these is installed: others may build in the clone at this moment."""

FURTHER = ("PyYAML", "pillow.libs")
"""What packages bring or ask for that the package asks for."""


def link(name, folder):
    """Put a package or module of this environment into a folder."""
    module = IMPORTED_AS.get(name, name.replace("-", "_"))
    found = util.find_spec(module) if "." not in module else None
    if found is None:  # no module, but libraries of one
        places = [Path(place, module) for place in sys.path]
        path = next((place for place in places if place.exists()), None)
    elif found.submodule_search_locations:
        path = Path(next(iter(found.submodule_search_locations)))
    else:
        path = Path(found.origin)
    if path is not None:
        (folder / path.name).symlink_to(path)


def copy(name, folder):
    """Copy a file or folder of the clone."""
    if (ROOT / name).is_file():
        shutil.copy(ROOT / name, folder)
    else:
        shutil.copytree(
            ROOT / name,
            folder / name,
            ignore=shutil.ignore_patterns("__pycache__", "*.egg-info"),
        )


@pytest.fixture(scope="module")
def python(tmp_path_factory):
    """Install the package, and give what runs programs with it and what it needs."""
    clone = tmp_path_factory.mktemp("clone")
    for name in BUILT_FROM:
        copy(name, clone)
    prefix = tmp_path_factory.mktemp("prefix")
    needed = tmp_path_factory.mktemp("needed")
    pip = [sys.executable, "-m", "pip", "install", "--disable-pip-version-check"]
    offline = ["--no-index", "--no-deps", "--no-build-isolation"]
    run = subprocess.run(
        [*pip, *offline, "--ignore-installed", f"--prefix={prefix}", str(clone)],
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stdout + run.stderr
    [installed] = prefix.glob("**/g1_description/__init__.py")
    [package] = metadata.distributions(
        name="g1_description", path=[str(installed.parents[1])]
    )
    lines = [line for line in package.requires if "extra ==" not in line]
    names = {re.match(r"[\w.-]+", line).group() for line in lines}
    for name in {*names, *FURTHER}:
        link(name, needed)

    def run_program(program):
        path = os.pathsep.join(map(str, (installed.parents[1], needed)))
        run = subprocess.run(
            [Path(sys.executable).resolve(), "-S", "-c", program],
            env={"PYTHONPATH": path, "HOME": str(prefix)},
            cwd=prefix,
            capture_output=True,
            text=True,
        )
        assert run.returncode == 0, run.stderr
        return run.stdout.strip()

    run_program.package = package
    run_program.share, run_program.clone = installed.parent, clone
    return run_program


pytestmark = pytest.mark.slow


def test_the_version_is_that_of_the_manifest(python):
    manifest = (ROOT / "package.xml").read_text(encoding="utf-8")
    assert f"<version>{python.package.version}</version>" in manifest


def test_the_robot_is_there_with_its_meshes_and_poses(python):
    program = (
        "import sys\n"
        "from importlib.util import find_spec\n"
        "from g1_description import Robot\n"
        "from g1_description.files.model_files import find_folder\n"
        "from g1_description.sim.meshes.shapes import find_meshes\n"
        "robot = Robot()\n"
        "links = robot.description.links\n"
        "shapes = [s for link in links for s in (*link.visuals, *link.collisions)]\n"
        "meshes, problems = find_meshes(shapes)\n"
        "poses = robot.forward_kinematics(robot.named_configuration('wave'))\n"
        "print(find_folder('g1_description'), bool(meshes), problems, poses.shape)\n"
        "print(*map(find_spec, ('rospkg', 'catkin_pkg', 'rospy')))"
    )
    assert python(program).splitlines() == [
        f"{python.share} True () (40, 7)",
        "None None None",
    ]


@pytest.mark.parametrize("name", ["config", "meshes", "motions", "urdf"])
def test_all_files_are_installed(python, name):
    def below(folder):
        return {path.relative_to(folder) for path in folder.rglob("*")}

    assert below(python.share / name) == below(ROOT / name)


def test_a_program_loads_only_what_it_uses(python):
    """Neither numpy nor PyBullet before a public name, and no PyBullet for a robot."""
    program = (
        "import sys, g1_description\n"
        "print({'numpy', 'pybullet'} & {*sys.modules})\n"
        "g1_description.Robot()\n"
        "print({'pybullet'} & {*sys.modules})\n"
        "from g1_description.sim.world import World\n"
        "from g1_description.importer.import_model import run\n"
        "print(World.__name__, callable(run))"
    )
    assert python(program).splitlines() == ["set()", "set()", "World True"]


def test_a_part_that_needs_ros_says_so(python):
    program = (
        "import g1_description\n"
        "robot = g1_description.Robot()\n"
        "for part in (lambda: g1_description.Client, lambda: g1_description.Stream,\n"
        "             lambda: robot.to_message(robot.neutral)):\n"
        "    try:\n        part()\n"
        "    except ImportError as error:\n        print(error)"
    )
    lines = python(program).splitlines()
    begins = "g1_description.Client needs ", "g1_description.Stream needs ", "Messages "
    assert len(lines) == len(begins)
    for line, begin in zip(lines, begins):
        assert line.startswith(begin)
        assert "ource the workspace" in line


def test_nothing_of_a_build_is_left_that_the_next_one_would_take(python):
    assert {path.name for path in python.clone.iterdir()} == {*BUILT_FROM}
