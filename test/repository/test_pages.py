"""The pages show links, files and commands that exist; the README is short."""

import os
import re
import subprocess
import xml.etree.ElementTree as ET
from functools import lru_cache
from pathlib import Path

import pytest
import yaml
from forked import run_script
from pages import (
    FENCE,
    NAMES,
    PAGES,
    ROOT,
    broken_links,
    commands,
    copy_motions,
    inline_code,
    links,
    tutorial_commands,
)

PACKAGES = {
    "g1_description": (ROOT / "launch", ROOT / "scripts", ROOT / "test" / "rostest"),
    "gazebo_ros": (
        ROOT / "interfaces" / "gazebo_ros" / "launch",
        ROOT / "interfaces" / "gazebo_ros" / "scripts",
        None,
    ),
}
"""Where launch files, executables and rostests of our packages are."""

FOREIGN_NODES = {("dynamic_reconfigure", "dynparam"), ("tf", "tf_echo")}
FOREIGN = {
    "cd",
    "cp",
    "docker",
    "git",
    "mkdocs",
    "source",
    "catkin_make",
    "catkin_test_results",
    "pip",
    "pip3",
    "python3",
}
FOREIGN |= {
    "export",
    "mkdocs",
    "python",
    "rosbag",
    "rosnode",
    "rostopic",
    "ssh",
    "sudo",
    "xdg-open",
}
"""Commands of others, taken on trust."""

FOLDERS = {path.name for path in ROOT.iterdir() if path.is_dir()}


@lru_cache(maxsize=None)
def help_of(file, *command):
    """Return what an executable, or a command of it, prints for --help."""
    environment = {**os.environ, "DISPLAY": ""}
    if file.parent.name == "tools":
        run = subprocess.run(
            [str(file), "-h"],
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
        )
    else:
        run = run_script(file, *command, "-h", environment=environment)
    assert run.returncode == 0, run.stderr
    return run.stdout


def declared(file):
    """Return the arguments that a launch file declares."""
    return {arg.get("name") for arg in ET.parse(file).getroot().findall("arg")}


def unknown_options(file, words):
    """List options that the help of an executable does not have."""
    options = [word.split("=")[0] for word in words if re.match(r"--?[a-zA-Z]", word)]
    command = words[: file.name == "motion"]
    return [
        f"{file.name} {o}"
        for o in options
        if not _is_option(o, help_of(file, *command))
    ]


def _is_option(option, text):
    """Tell whether a help text names an option."""
    return re.search(rf"(?<![\w-]){re.escape(option)}(?![\w-])", text)


def wrong_launch(words, kind):
    """Say what is wrong with the words behind roslaunch or rostest."""
    words = [word for word in words if not word.startswith("--")]
    if not words:
        return []  # the command itself is meant
    package, name, *arguments = words
    if package not in PACKAGES:
        return [f"package {package}"]
    file = PACKAGES[package][kind] / name
    if not file.exists():
        return [name]
    given = {argument.split(":=")[0] for argument in arguments}
    return [f"{name} {argument}" for argument in sorted(given - declared(file))]


def wrong_run(words):
    """Say what is wrong with the words behind rosrun."""
    package, name, *arguments = words
    if (package, name) in FOREIGN_NODES:
        return []
    file = PACKAGES[package][1] / name if package in PACKAGES else ROOT / "no such"
    return unknown_options(file, arguments) if file.exists() else [name]


def wrong_tool(words):
    """Say what is wrong with a command of ours."""
    file = ROOT / words[0]
    if file.suffix == ".py" and file.exists():
        return []  # part of a tool
    if not os.access(file, os.X_OK):
        return [words[0]]
    if words[0] == "tools/demo":
        given = {word.split(":=")[0] for word in words[1:] if ":=" in word}
        unknown = given - declared(ROOT / "launch" / "display.launch")
        return [f"{words[0]} {name}" for name in sorted(unknown)]
    return unknown_options(file, words[1:])


def wrong_service(words):
    """Say what is wrong with the words behind rosservice."""
    name = words[1].rpartition("/")[2]
    sources = (ROOT / "src" / "g1_description").rglob("*.py")
    known = any(re.search(rf'"~?{name}"', file.read_text()) for file in sources)
    return [] if words[0] == "call" and known else [words[1]]


def wrong(words):
    """Say what a command names that does not exist: a list, empty if it is right."""
    program = words[0].rpartition("/")[2]
    if words[0].startswith("tools/"):
        return wrong_tool(words)
    if program == "roslaunch":
        is_written = "/" in [*words, ""][1]  # a file that a command of the page writes
        return [] if is_written else wrong_launch(words[1:], 0)
    if program == "rostest":
        return wrong_launch(words[1:], 2)
    if program in ("rosrun", "g1"):  # g1 has those that need no ROS
        own = [] if program == "rosrun" else ["g1_description"]
        return wrong_run([*own, *words[1:]])
    if program == "rosservice":
        return wrong_service(words[1:])
    return [] if program in FOREIGN else [words[0]]


def missing_files(text):
    """List names of files or folders in this repository that do not exist."""
    paths = [code for code in inline_code(text) if " " not in code]
    paths = [path for path in paths if path.split("/")[0] in FOLDERS and "/" in path]
    return [path for path in paths if not [*ROOT.glob(path.rstrip("/"))]]


INPUT = re.compile(r"\.(csv|npz|npy|pkl|bag|ya?ml|urdf|xacro)$")
"""Files that commands read."""

OF_USERS = re.compile(r"(\$PWD/|\$ROS_\w+/)?my_|/path/to/|~/|\$\(|package://")
"""How names of files begin that a page does not promise."""

WRITES = {"--out", "-o", "--json", "--csv", "--html", "--write-selection", ">"}
"""A file follows that the command writes."""


SHIPPED = {file.name for file in (ROOT / "motions").iterdir()}
PYTHON_WRITES = re.compile(r"""write_\w+\(\s*["'](?:.*/)?([^"'/]+)["']""")


def written_files(text):
    """List the names of files that commands and Python of a text write."""
    found = PYTHON_WRITES.findall(text)
    for words in commands(text):
        found += [
            Path(word).name
            for option, word in zip(["", *words], words)
            if option in (*WRITES, "record") or words[1:2] == ["filter"]
        ]
    return found


@pytest.mark.parametrize(
    "file", [*PAGES, *(ROOT / "examples").rglob("*.py")], ids=lambda file: file.name
)
def test_nothing_is_written_over_the_name_of_a_shipped_motion(file):
    """Such a file would be read in its place from then on."""
    assert SHIPPED.isdisjoint(written_files(file.read_text(encoding="utf-8")))


def absent_inputs(text):
    """List files that a page's commands read and that nobody has.

    A file is there if it is in this repository, among its motions, or written by an
    earlier command of the page.
    """
    found, written = [], set()
    for words in commands(text):
        before = ["", *words]
        for option, word in zip(before, words):
            name = word.partition(":=")[2] or word
            if not INPUT.search(name) or OF_USERS.match(name):
                continue
            if option in (*WRITES, "record") or words[:2] == ["rosbag", "filter"]:
                written.add(name)
            elif name not in written and not any(
                [*folder.glob(name)] for folder in (ROOT, ROOT / "motions")
            ):
                found.append(name)
    return found


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_motions_and_models_in_commands_are_there(page):
    assert absent_inputs(page.read_text(encoding="utf-8")) == []


def test_the_readme_is_short():
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 120
    prose = [line for line in lines if not line.startswith(("|", "rostopic"))]
    assert [line for line in prose if len(line) > 105] == []


def test_the_index_links_every_page():
    index = ROOT / "docs" / "README.md"
    listed = {
        (index.parent / target).resolve()
        for target in links(index.read_text(encoding="utf-8"))
    }
    assert {*PAGES} - {index} <= listed
    assert "docs/README.md" in links((ROOT / "README.md").read_text(encoding="utf-8"))


def test_the_architecture_has_a_line_for_each_package():
    source = ROOT / "src" / "g1_description"
    inits = [init.parent.relative_to(source) for init in source.rglob("__init__.py")]
    packages = {str(package) for package in inits} - {"."}
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    table = text.split("## Packages")[1].split("\n## ")[0]
    assert set(re.findall(r"^\| `([^`]+)` \|", table, flags=re.M)) == packages


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_links_and_pictures_exist(page):
    assert broken_links(page) == []


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_blocks_of_a_page_can_be_read(page):
    """Python and commands have tests of their own."""
    text = page.read_text(encoding="utf-8")
    found = FENCE.findall(text)
    assert text.count("```") == 2 * len(found)
    for language, block in found:
        assert language in ("bash", "python", "text", "xml", "yaml")
        if language == "xml":
            ET.fromstring(f"<all>{block}</all>")
        if language == "yaml":
            yaml.safe_load(block)


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_files_that_a_page_names_exist(page):
    assert missing_files(page.read_text(encoding="utf-8")) == []


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_commands_exist_with_their_arguments(page):
    pytest.importorskip("rospy", reason="rospy is not installed")
    text = page.read_text(encoding="utf-8")
    assert [fault for words in commands(text) for fault in wrong(words)] == []


@pytest.mark.slow
def test_commands_of_tutorials_that_need_no_robot_run(tmp_path):
    """Two of their motions fail, which ``check`` says by its exit code."""
    pytest.importorskip("rospy", reason="rospy is not installed")
    copy_motions(tmp_path)
    found = [*tutorial_commands(offline=True)]
    assert len(found) > 3
    for _, _, name, *words in found:
        run = run_script(ROOT / "scripts" / name, *words, folder=tmp_path)
        is_faulty = name == "check" and words[0] in ("motions/faulty.csv", "motions/")
        assert run.returncode == int(is_faulty), (words, run.stdout, run.stderr)


def test_pictures_are_shown_somewhere():
    shown = {
        (page.parent / link).resolve()
        for page in PAGES
        for link in links(page.read_text(encoding="utf-8"))
    }
    assert {*(ROOT / "docs" / "images").iterdir()} <= shown
