"""The tools that no other test runs can be started."""

import os
import runpy
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from forked import run_forked

pytest.importorskip("rospy", reason="rospy is not installed")
TOOLS = Path(__file__).resolve().parents[2] / "tools"


def test_all_scripts_can_be_read():
    scripts = [file for file in TOOLS.iterdir() if file.is_file() and not file.suffix]
    shells = [file for file in scripts if file.read_text().startswith("#!/bin/bash")]
    assert TOOLS / "test" in shells
    for file in shells:
        subprocess.run(["/bin/bash", "-n", str(file)], check=True)


def test_an_interpreter_that_is_none_is_refused():
    command = str(TOOLS / "other_python"), "/bin/false", "unit"
    done = subprocess.run(command, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 1
    assert done.stderr == "tools/test --python: '/bin/false' is no Python\n"


@pytest.mark.slow
@pytest.mark.parametrize("module", ["bench", "pictures", "soaking"])
def test_a_tool_starts(module):
    def main():
        sys.path[:0] = [str(TOOLS), str(TOOLS.parent / "test" / "rostest")]
        sys.argv[:] = [module, "--help"]
        runpy.run_module(module, run_name="__main__", alter_sys=True)

    done = run_forked(main)
    assert done.returncode == 0, done.stderr
    assert "usage: tools/" in done.stdout


@pytest.mark.slow
def test_the_meshes_are_those_of_the_table(tmp_path):
    """One small link, made anew: the same box and, nearly, the same volume."""
    trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")
    pytest.importorskip("skimage", reason="scikit-image needs numpy 1.21")
    code = (
        "import sys, yaml; from shapes.body import body; "
        "table = yaml.safe_load(open(sys.argv[1])); "
        "body(table['left_wrist_yaw_link']).export(sys.argv[2])"
    )
    table = TOOLS.parent / "urdf" / "g1_29dof_shapes.yaml"
    made = tmp_path / "made.stl"
    subprocess.run(
        [sys.executable, "-c", code, str(table), str(made)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(TOOLS), *sys.path])},
        check=True,
    )
    new = trimesh.load(str(made))
    old = trimesh.load(str(TOOLS.parent / "meshes" / "left_wrist_yaw_link.stl"))
    assert abs(new.bounds - old.bounds).max() < 1e-6
    assert new.volume == pytest.approx(old.volume, rel=0.01)


def test_each_rostest_file_runs_once():
    folder = TOOLS.parent / "test" / "rostest"
    named = [
        name
        for file in folder.glob("*.test")
        for test in ElementTree.parse(file).iter("test")
        for name in test.get("args").split()
    ]
    expected = {"test_physics.py": 2}  # with motors and without
    for file in folder.glob("test_*.py"):
        assert named.count(file.name) == expected.get(file.name, 1), file.name
