"""Each layer imports only what it may."""

import ast
import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[2] / "src" / "g1_description"
STANDARD = {"__future__", "argparse", "collections", "contextlib", "copy"}
STANDARD |= {"dataclasses", "difflib", "functools", "itertools", "logging", "math"}
STANDARD |= {"os", "pathlib", "re", "stat"}
STANDARD |= {"subprocess", "sys", "tempfile", "types", "typing"}
STANDARD |= {"urllib", "xml"}
ALLOWED = {
    "core": STANDARD
    | {"lxml", "numpy", "rospkg", "urdf_parser_py", "xacro", "yaml", ".core"},
    "sim": STANDARD
    | {"ctypes", "resource", "signal", "struct", "time", "warnings", "numpy", "PIL"}
    | {"pybullet", "pybullet_utils", ".core", ".sim"},
}
ALLOWED["importer"] = (
    STANDARD
    | {"shutil", "signal", "time"}
    | {"fast_simplification", "lxml", "numpy", "scipy", "trimesh"}
    | {".core", ".sim", ".importer"}
)
FORBIDDEN = {"ros": {"pybullet", "pybullet_utils", "scipy", "urdf_parser_py"}}


def imported_packages(path):
    """List what a module imports: top-level packages, or our own layers."""
    for node in ast.walk(ast.parse(path.read_text(), feature_version=(3, 8))):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            own = {0: None, 1: path.parent.name, 2: (node.module or "").split(".")[0]}
            layer = own[node.level]
            yield (node.module or "").split(".")[0] if layer is None else f".{layer}"


@pytest.mark.parametrize("layer", [*ALLOWED, *FORBIDDEN])
def test_a_layer_imports_only_what_it_may(layer):
    files = list((SOURCE / layer).glob("*.py"))
    assert files
    for path in files:
        found = set(imported_packages(path))
        assert found <= ALLOWED.get(layer, found), path.name
        assert not found & FORBIDDEN.get(layer, set()), path.name


def test_messages_that_nodes_import_are_dependencies():
    """Also where they are tested with: tests are not installed."""
    named = {
        element.text
        for element in ET.parse(SOURCE.parents[1] / "package.xml").getroot()
        if element.tag in {"depend", "exec_depend"}
    }
    used = {name for path in SOURCE.glob("*/*.py") for name in imported_packages(path)}
    messages = {name for name in used if name.endswith(("_msgs", "_srvs"))}
    assert {"gazebo_msgs", "std_srvs"} <= messages
    assert messages <= named


@pytest.mark.parametrize(
    ("package", "module"),
    [
        ("urdf_parser_py", "urdf.py"),
        ("yaml", "pose_text.py"),
        ("pybullet", "bullet.py"),
        ("pybullet_utils", "bullet.py"),
        ("resource", "read_meshes.py"),
    ],
)
def test_only_one_module_imports_it(package, module):
    readers = [
        path.name
        for path in SOURCE.glob("*/*.py")
        if package in set(imported_packages(path))
    ]
    assert readers == [module]


@pytest.mark.parametrize("program", ["ros.bridge_node", "importer.command"])
def test_the_bridge_and_the_import_do_without_pybullet(program):
    pytest.importorskip("rospy", reason="rospy is not there")
    module = f"g1_description.{program}"
    code = f"import sys, {module}; sys.exit('pybullet' in sys.modules)"
    path = os.pathsep.join([str(SOURCE.parent), *sys.path])
    environment = {**os.environ, "PYTHONPATH": path}
    assert subprocess.run([sys.executable, "-c", code], env=environment).returncode == 0
