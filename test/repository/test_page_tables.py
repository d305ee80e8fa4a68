"""Tables of the pages, YAML files and launch files say what the code does."""

import re
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import yaml

rospy = pytest.importorskip("rospy", reason="rospy is not installed")

from g1_description.bridge.parameters import BridgeParameters  # noqa: E402
from g1_description.ros.parameters import default_parameters  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools"))

import tables  # noqa: E402

LAUNCH = ROOT / "launch"
OWN_DEFAULT = {(file, "rvizconfig") for file in ("two_robots", "view", "replay")}
OWN_DEFAULT.add(("view", "use_sim_time"))


def section(page, title):
    """Return what stands below a heading, down to the next one of its level."""
    text = (ROOT / "docs" / page).read_text()
    return re.split(rf"^## {title}$", text, flags=re.M)[1].split("\n## ")[0]


def launch_arguments(file):
    """Return the arguments of a launch file that people may give, by name."""
    args = ET.parse(file).getroot().findall("arg")
    return {arg.get("name"): arg for arg in args if arg.get("value") is None}


@pytest.mark.parametrize("node", tables.NODES)
def test_the_page_lists_every_parameter_with_its_default(node):
    table = section("nodes.md", node).split("| parameter |")[1]
    rows = re.findall(r"^\| `~([\w/]+)` \| `?([^|`]*)`? \|", table, flags=re.M)
    listed = {name: default.strip() for name, default in rows}
    known = default_parameters(tables.NODES[node])
    written = {
        name: str(default).lower() if isinstance(default, bool) else str(default)
        for name, default in known.items()
    }
    empty = ("", "()")
    assert listed == {
        name: "(empty)" if text in empty else text for name, text in written.items()
    }


def test_nothing_that_tells_of_options_is_stale():
    for path, text in tables.texts().items():
        assert path.read_text() == text, f"{path.name}: run tools/tables"


def test_common_options_are_described_once():
    pages = "".join(page.read_text() for page in (ROOT / "docs").rglob("*.md"))
    known = tables.arguments_of(tables.Reading)
    abouts = [known[name].about for name in tables.COMMON if name != "model"]
    assert [about for about in abouts if pages.count(f"| {about}") != 1] == []


def test_the_yaml_file_holds_known_parameters_and_their_defaults():
    values = yaml.safe_load((ROOT / "config" / "bridge.yaml").read_text())
    assert values.items() <= default_parameters(BridgeParameters).items()


def test_every_launch_argument_has_a_meaning_and_a_default():
    for path in LAUNCH.glob("*.launch"):
        for name, arg in launch_arguments(path).items():
            assert arg.get("doc"), f"{path.name}: {name}"
            assert arg.get("default") is not None, f"{path.name}: {name}"


def test_an_argument_has_the_same_default_in_every_launch_file():
    """Several declare the same, as roslaunch lists those of one file only."""
    defaults = {}
    for path in LAUNCH.glob("*.launch"):
        for name, arg in launch_arguments(path).items():
            if (path.stem, name) not in OWN_DEFAULT:
                defaults.setdefault(name, set()).add(arg.get("default"))
    assert {name for name, texts in defaults.items() if len(texts) > 1} == set()


def test_files_that_are_only_included_declare_no_arguments():
    included = [*LAUNCH.glob("*.launch.xml")]
    assert included
    for path in included:
        assert launch_arguments(path) == {}, path.name
