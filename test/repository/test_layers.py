"""Packages import what lies below them only, and nothing imports itself."""

import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from layers import Layers, package_of

SOURCE = Path(__file__).parents[2] / "src" / "g1_description"
LAYERS = Layers(SOURCE)

TOP = {
    "errors",
    "text",
    "bounds",
    "choices",
    "former",
    "interrupts",
    "libraries",
    "command_line",
    "threads",
}
"""Modules that lie in no package, below all of these."""

ROBOT = {"files", "robot"}
SIM = ROBOT | {"sdf", "motion", "sim"}
SCENES = SIM | {"scenes"}
CHECKS = SCENES | {"collisions", "checks"}
ROS = CHECKS | {"mend", "ik", "render", "ros", "api"}
BELOW = {
    "files": set(),
    "robot": {"files"},
    "sdf": ROBOT,
    "motion": ROBOT,
    "sim": SIM,
    "scenes": SIM,
    "collisions": SCENES,
    "checks": SCENES | {"collisions"},
    "mend": CHECKS,
    "ik": CHECKS,
    "render": CHECKS,
    "api": CHECKS | {"mend", "ik", "render", "ros"},
    "importer": CHECKS | {"render"},
    "ros": CHECKS | {"render"},
    "bridge": ROS,
    "checker": ROS | {"bridge"},
    "interactive": ROS | {"checker"},
    "gazebo": ROS | {"bridge"},
    "web": ROS | {"bridge", "checker"},
    "client": ROS | {"bridge"},
    "stream": ROS,
    "cli": ROS | {"bridge", "web", "client"},
}
"""What packages may import of ours: what stands above them in this table."""

MODULES = {"api", "client", "stream"}
"""Modules of that table."""

WITH_ROSPY = {"ros", "bridge", "checker", "interactive", "gazebo", "web"}
WITH_ROSPY |= {"client", "stream", "cli"}
"""What may import rospy and messages."""

ONE_MODULE = {
    "urdf_parser_py": "robot.urdf",
    "pybullet": "sim.bullet.client",
    "pybullet_utils": "sim.bullet.client",
    "resource": "sim.meshes.read_meshes",
    "distributed": "checks.cluster",
    "daqp": "collisions.closest_points ik.solver",
    "tqdm": "cli.progress",
    "interactive_markers": "interactive.markers",
}
"""Libraries that few modules import."""


def forbidden(layers, package):
    """List what modules of a package import and may not: pairs of module and import."""
    found = []
    modules = [package] if package in MODULES else layers.of_package(package)
    for name in modules:
        known = BELOW[package] | TOP | {package}
        wrong = {m for m in layers.own(name) if (package_of(m) or m) not in known}
        if package not in WITH_ROSPY:
            wrong |= {m for m in layers.foreign(name) if needs_ros(m)}
        found += [(name, module) for module in sorted(wrong)]
    return found


def needs_ros(module):
    """Return whether a library needs a workspace or ROS' own Python."""
    return module in {"rospy", "rosgraph", "genpy", "actionlib", "tf2_ros"} or (
        module.endswith(("_msgs", "_srvs"))
    )


def test_all_packages_are_known():
    names = {package_of(name) or name for name in LAYERS.paths}
    assert names == TOP | set(BELOW)


@pytest.mark.parametrize("package", sorted(BELOW))
def test_a_package_imports_only_what_lies_below(package):
    assert package in LAYERS.paths if package in MODULES else LAYERS.of_package(package)
    assert forbidden(LAYERS, package) == []


def test_modules_without_a_package_import_each_other_only():
    for name in TOP:
        assert LAYERS.own(name) <= TOP, name


def test_imports_name_modules():
    """Of folders only those inside a package, and nothing that is not there."""
    for name in LAYERS.paths:
        assert LAYERS.own(name) <= set(LAYERS.paths) | {"web.old_libraries"}, name


def test_the_world_knows_no_engine():
    """Engines know the world's models, and ``sim.engine`` finds them by name."""
    world = [name for name in LAYERS.paths if name.startswith("sim.")]
    for name in (name for name in world if not name.startswith("sim.bullet")):
        assert not {m for m in LAYERS.own(name) if m.startswith("sim.bullet")}, name


def test_nothing_imports_itself_in_a_circle():
    assert LAYERS.circles() == []
    assert LAYERS.package_circles() == []


def test_messages_that_nodes_import_are_dependencies():
    """Also where they are tested with: tests are not installed."""
    named = {
        element.text
        for element in ET.parse(SOURCE.parents[1] / "package.xml").getroot()
        if element.tag in {"depend", "exec_depend"}
    }
    used = {package for name in LAYERS.paths for package in LAYERS.foreign(name)}
    messages = {name for name in used if name.endswith(("_msgs", "_srvs"))}
    assert {"gazebo_msgs", "std_srvs"} <= messages
    # Our own where a workspace lacks it: it is in no distribution.
    assert messages - {"robot_msgs"} <= named


@pytest.mark.parametrize(("library", "modules"), ONE_MODULE.items())
def test_few_modules_import_it(library, modules):
    assert [n for n in LAYERS.paths if library in LAYERS.foreign(n)] == modules.split()


@pytest.mark.slow
def test_the_bridge_and_the_import_do_without_pybullet():
    pytest.importorskip("rospy", reason="rospy is not there")
    modules = "g1_description.bridge.node, g1_description.importer.import_model"
    code = f"import sys, {modules}; sys.exit('pybullet' in sys.modules)"
    path = os.pathsep.join([str(SOURCE.parent), *sys.path])
    environment = {**os.environ, "PYTHONPATH": path}
    assert subprocess.run([sys.executable, "-c", code], env=environment).returncode == 0
