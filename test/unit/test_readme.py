"""The README's tables, the YAML files and the launch files say what the code does."""

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import yaml

rospy = pytest.importorskip("rospy", reason="rospy is not installed")

from g1_description.ros.bridge.parameters import BridgeParameters  # noqa: E402
from g1_description.ros.gazebo.parameters import GazeboParameters  # noqa: E402
from g1_description.ros.node.parameters import default_parameters  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
NODES = {"link_states_bridge": BridgeParameters, "gazebo": GazeboParameters}


def section(node):
    readme = (ROOT / "README.md").read_text()
    return re.split(rf"^### {node} .*$", readme, flags=re.M)[1].split("\n#")[0]


@pytest.mark.parametrize("node", NODES)
def test_the_readme_lists_every_parameter_with_its_default(node):
    rows = re.findall(r"^\| `~(\w+)` \| `?([^|`]*)`? \|", section(node), flags=re.M)
    told = {name: default.strip() for name, default in rows}
    known = default_parameters(NODES[node])
    written = {
        name: str(default).lower() if isinstance(default, bool) else str(default)
        for name, default in known.items()
    }
    empty = ("", "()")
    assert told == {
        name: "(empty)" if text in empty else text for name, text in written.items()
    }


@pytest.mark.parametrize(
    ("file", "kind"), [("bridge", BridgeParameters), ("gazebo", GazeboParameters)]
)
def test_the_yaml_files_hold_known_parameters_and_their_defaults(file, kind):
    values = yaml.safe_load((ROOT / "config" / f"{file}.yaml").read_text())
    assert values.items() <= default_parameters(kind).items()


def test_the_readme_lists_every_launch_argument():
    launch = ET.parse(ROOT / "launch" / "display.launch")
    names = {arg.get("name") for arg in launch.iter("arg") if arg.get("doc")}
    table = (ROOT / "README.md").read_text().split("## Launch files")[1]
    cells = re.findall(r"^\| `([^`]+)` \|", table.split("\n## ")[0], flags=re.M)
    assert names == {name for cell in cells for name in cell.split()}


def test_every_launch_argument_has_a_meaning_and_a_default():
    for path in (ROOT / "launch").glob("*.launch"):
        for arg in ET.parse(path).getroot().findall("arg"):
            assert arg.get("doc"), f"{path.name}: {arg.get('name')}"
            assert arg.get("default") is not None, f"{path.name}: {arg.get('name')}"
