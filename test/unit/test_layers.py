"""Layers import only what they may, no module imports itself, rooms are small."""

import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from layers import MOST_IN_A_ROOM, Layers

SOURCE = Path(__file__).parents[2] / "src" / "g1_description"
LAYERS = Layers(SOURCE)
STANDARD = {"__future__", "argparse", "array", "collections", "contextlib", "copy"}
STANDARD |= {"base64", "codecs", "csv", "html", "json"}
STANDARD |= {"dataclasses", "difflib", "enum", "functools", "io", "itertools", "math"}
STANDARD |= {"logging", "os", "pathlib", "pickle", "pickletools", "re", "shutil"}
STANDARD |= {"shlex", "stat", "zipfile", "zlib"}
STANDARD |= {"subprocess", "sys", "tempfile", "types", "typing"}
STANDARD |= {"urllib", "xml"}
FOREIGN = {
    "core": STANDARD
    | {"signal", "threading"}
    | {"lxml", "numpy", "rospkg", "ruamel", "urdf_parser_py", "xacro"},
    "sim": STANDARD
    | {"ctypes", "resource", "signal", "struct", "time", "warnings", "numpy", "PIL"}
    | {"concurrent", "hashlib", "multiprocessing", "threading", "traceback", "uuid"}
    | {"distributed", "matplotlib", "pybullet", "pybullet_utils", "scipy"},
    "api": STANDARD | {"numpy"},
    "web": STANDARD
    | {"asyncio", "hmac", "http", "queue", "secrets", "socket", "threading", "time"}
    | {"atexit", "concurrent", "errno", "gzip", "hashlib", "ipaddress", "weakref"}
    | {"PIL", "numpy", "rich", "trimesh", "viser", "websockets"},
    "importer": STANDARD
    | {"signal", "time"}
    | {"fast_simplification", "lxml", "numpy", "scipy", "trimesh"},
}
"""What layers may import of others."""

BELOW = {
    "core": {"core"},
    "sim": {"core", "sim"},
    "api": {"core", "sim", "api"},
    "web": {"core", "sim", "web"},
    "ros": {"core", "sim", "api", "web", "ros"},
    "importer": {"core", "sim", "importer"},
}
"""What layers may import of ours."""

FORBIDDEN = {
    "ros": {"pybullet", "pybullet_utils", "scipy", "urdf_parser_py"}
    | {"trimesh", "viser", "websockets"}
}


def strangers(layers, layer):
    """List what modules of a layer import and may not: pairs of module and import."""
    found = []
    for name in layers.of_layer(layer):
        foreign = layers.foreign(name)
        wrong = foreign - FOREIGN.get(layer, foreign)
        wrong |= foreign & FORBIDDEN.get(layer, set())
        wrong |= {m for m in layers.own(name) if m.split(".")[0] not in BELOW[layer]}
        found += [(name, module) for module in sorted(wrong)]
    return found


def test_all_layers_are_known():
    assert {name.split(".")[0] for name in LAYERS.paths} == set(BELOW)


@pytest.mark.parametrize("layer", BELOW)
def test_a_layer_imports_only_what_it_may(layer):
    assert LAYERS.of_layer(layer)
    assert strangers(LAYERS, layer) == []


def test_imports_name_modules():
    """Not folders, and nothing that is not there."""
    for name in LAYERS.paths:
        assert LAYERS.own(name) <= set(LAYERS.paths), name


def test_no_module_imports_itself_in_a_circle():
    assert LAYERS.circles() == []


def test_rooms_are_small():
    assert LAYERS.full_rooms() == []


def test_imports_are_relative_inside_a_room_only():
    assert LAYERS.stretched() == []


@pytest.fixture()
def write(tmp_path):
    """Give what writes modules, and what reads them as layers."""

    def write_all(**texts):
        for name, text in texts.items():
            path = tmp_path / f"{name.replace('__', '/')}.py"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        return Layers(tmp_path)

    return write_all


@pytest.mark.parametrize(
    ("module", "text", "wrong"),
    [
        ("core__a", "import rospy", "rospy"),
        ("core__room__a", "import rospy.names", "rospy"),
        ("core__room__a", "from g1_description.sim.b import c", "sim.b"),
        ("core__room__a", "from g1_description.sim import b", "sim.b"),
        ("core__room__a", "def f():\n    import pybullet", "pybullet"),
        ("core__room__deeper__a", "from ....sim.b import c", "sim.b"),
        ("core__a", "if TYPE_CHECKING:\n    from ..sim.b import c", "sim.b"),
        ("sim__room__a", "from g1_description.ros.b import c", "ros.b"),
        ("api__a", "from g1_description.ros.b import c", "ros.b"),
        ("api__a", "import rospy", "rospy"),
        ("core__a", "from g1_description.api.d import c", "api.d"),
        ("ros__room__a", "import scipy.linalg", "scipy"),
        ("importer__a", "from g1_description.ros.b import c", "ros.b"),
        ("web__a", "import rospy", "rospy"),
        ("web__room__a", "from g1_description.ros.b import c", "ros.b"),
        ("ros__a", "import viser", "viser"),
    ],
)
def test_a_stranger_is_found(write, module, text, wrong):
    layers = write(sim__b="", ros__b="", api__d="", **{module: text})
    name = module.replace("__", ".")
    assert strangers(layers, module.split("__")[0]) == [(name, wrong)]


def test_circles_are_found(write):
    layers = write(
        core__a="from .b import x",
        core__b="from g1_description.core.room.c import x",
        core__room__c="if TYPE_CHECKING:\n    from g1_description.core.a import x",
        core__d="from .a import x",
    )
    assert layers.circles() == ["core.a", "core.b", "core.room.c"]


def test_full_rooms_and_stretched_imports_are_found(write):
    many = {f"core__room__m{number}": "" for number in range(MOST_IN_A_ROOM + 1)}
    layers = write(core__a="", core__room__b="from ..a import x", **many)
    assert layers.full_rooms() == ["core/room"]
    assert layers.stretched() == ["core.room.b"]


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
    assert messages <= named


@pytest.mark.parametrize(
    ("package", "module"),
    [
        ("urdf_parser_py", "core.urdf.reader"),
        (
            "ruamel",
            "core.checks.thresholds core.collisions.pairs_file "
            "core.motion.formats.trajectory_yaml core.motion.motors "
            "core.poses.yaml_text",
        ),
        ("pybullet", "sim.bullet.client"),
        ("pybullet_utils", "sim.bullet.client"),
        ("resource", "sim.meshes.read_meshes"),
        ("distributed", "sim.batch.cluster sim.batch.worker"),
        ("tqdm", "ros.apps.checks.results"),
    ],
)
def test_only_one_module_imports_it(package, module):
    assert [n for n in LAYERS.paths if package in LAYERS.foreign(n)] == module.split()


@pytest.mark.slow
@pytest.mark.parametrize("program", ["ros.bridge.node", "importer.command"])
def test_the_bridge_and_the_import_do_without_pybullet(program):
    pytest.importorskip("rospy", reason="rospy is not there")
    module = f"g1_description.{program}"
    code = f"import sys, {module}; sys.exit('pybullet' in sys.modules)"
    path = os.pathsep.join([str(SOURCE.parent), *sys.path])
    environment = {**os.environ, "PYTHONPATH": path}
    assert subprocess.run([sys.executable, "-c", code], env=environment).returncode == 0
