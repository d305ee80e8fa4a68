"""The tools that no other test runs can be started."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rospy", reason="rospy is not installed")
TOOLS = Path(__file__).resolve().parents[2] / "tools"


@pytest.mark.slow
@pytest.mark.parametrize(
    "module", ["bench", "pictures", "shapes.compare", "soaking", "interrupting"]
)
def test_a_tool_starts(module):
    folders = [TOOLS, TOOLS.parent / "src", TOOLS.parent / "test" / "ros"]
    path = os.pathsep.join([*map(str, folders), *sys.path])
    done = subprocess.run(
        [sys.executable, "-m", module, "--help"],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
    )
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
