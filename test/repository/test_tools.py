"""Meshes that tools make, and the rostests that run."""

import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

TOOLS = Path(__file__).resolve().parents[2] / "tools"


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
