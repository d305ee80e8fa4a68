"""Each layer imports only what it may."""

import ast
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[2] / "src" / "g1_description"
ROS = {"rospy", "rospkg", "tf2_ros", "genpy", "std_msgs", "geometry_msgs"}
ROS |= {"gazebo_msgs", "sensor_msgs", "rosgraph_msgs", "std_srvs", "rosgraph"}
FORBIDDEN = {
    "core": ROS | {"pybullet", "pybullet_utils", "scipy", "sim", "ros"},
    "sim": ROS | {"scipy", "ros", "urdf_parser_py"},
    "ros": {"pybullet", "scipy", "urdf_parser_py"},
}


def imported_names(path):
    for node in ast.walk(ast.parse(path.read_text(), feature_version=(3, 8))):
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            yield from (getattr(node, "module", None) or "").split(".")
            for alias in node.names:
                yield from alias.name.split(".")


@pytest.mark.parametrize("layer", FORBIDDEN)
def test_a_layer_imports_only_what_it_may(layer):
    files = list((SOURCE / layer).glob("*.py"))
    assert files
    for path in files:
        assert not FORBIDDEN[layer] & set(imported_names(path)), path.name


def test_only_one_module_reads_urdf():
    readers = [
        path.name
        for path in (SOURCE / "core").glob("*.py")
        if "urdf_parser_py" in set(imported_names(path))
    ]
    assert readers == ["description.py"]
