"""Tables of launch files, messages and services, written from these files."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from xml.sax.saxutils import escape

ROOT = Path(__file__).resolve().parents[1]

SEE = {
    "anchor": "[anchors](poses.md#an-anchor)",
    "checks": "[the checker](nodes.md#checker)",
    "collisions": "[allowed pairs](self_collision.md#allowed-pairs)",
    "controllers": "[motions](motions.md#controllers)",
    "engine": "[engines](launch.md#engines)",
    "format": "[formats](motion_formats.md#which-format-is-it)",
    "history": "[history](nodes.md#history)",
    "host": "[from another machine](browser.md#from-another-machine)",
    "initial_pose": "[named poses](poses.md)",
    "interactive": "[in RViz](poses.md#in-rviz)",
    "model": "[xacro](launch.md#xacro)",
    "motion": "[motions of this package](motions.md#motions-of-this-package)",
    "motors": "[motors](motions.md#tracked-by-motors)",
    "physics": "[physics](launch.md#physics)",
    "rate": "[rate](launch.md#rate)",
    "robot": "[robots](robots.md)",
    "robots": "[several robots](nodes.md#several-robots)",
    "scene": "[scenes](scenes.md)",
    "topic": "[rosbags](motions.md#rosbags)",
    "trails": "[in RViz](motions.md#seen-in-rviz)",
    "web": "[the web UI](browser.md)",
    "z": "[height](launch.md#height)",
}
"""Where pages say more of an argument of launch files, or the parameter behind it."""

LAUNCH_FILES = ("display", "bridge", "checks", "view", "replay", "web")
"""The first of these that declares an argument says what it means."""

OWN_MEANING = {("bridge", "rate"), ("view", "use_sim_time"), ("web", "robot_name")}
"""Launch files where an argument means something else."""


def row(cells: Iterable[object]) -> str:
    """Write a row of a table; an empty cell is one space."""
    return "|".join(["", *(f" {cell} " if str(cell) else " " for cell in cells), ""])


def launch_files() -> list[Path]:
    """List the launch files; the first that declares an argument describes it."""
    first = [ROOT / "launch" / f"{stem}.launch" for stem in LAUNCH_FILES]
    return [*first, *sorted({*(ROOT / "launch").glob("*.launch")} - {*first})]


def declared(path: Path) -> dict[str, tuple[str, str]]:
    """Return default and meaning of the arguments that users of a launch file give."""
    found = (arg.attrib for arg in ET.parse(path).getroot().findall("arg"))
    return {a["name"]: (a["default"], a["doc"]) for a in found if "value" not in a}


@lru_cache(maxsize=None)
def launch_meanings() -> dict[str, str]:
    """Return what arguments of launch files mean."""
    found: dict[str, str] = {}
    for path in launch_files():
        for name, (_, doc) in declared(path).items():
            if (path.stem, name) not in OWN_MEANING:
                found.setdefault(name, doc)
    return found


def launch_texts() -> dict[Path, str]:
    """Return the launch files with the meanings of the first that declares them."""
    found = {}
    for path in launch_files():

        def replaced(match: re.Match[str], path: Path = path) -> str:
            if (path.stem, match[2]) in OWN_MEANING:
                return match[0]
            return f'{match[1]}{escape(launch_meanings()[match[2]])}"'

        pattern = r'(<arg name="(\w+)"[^>]*?doc=")[^"]*"'
        found[path] = re.sub(pattern, replaced, path.read_text())
    return found


CODE = re.compile(
    r"(?:^|(?<=; ))(?!empty:)[\w.]+(?=: )"  # a value that is explained
    r"|(?<![\w/])(?:\w+:)?\w*[_/][\w/.:]*|(?<!\w)'[^']+'"  # a name, a path; a quotation
)


def argument_text(name: str, doc: str, page: str) -> str:
    """Write the ``doc`` of a launch argument for a page: values as code, and a link."""
    see = f"; see {SEE[name]}" if name in SEE else ""
    text = CODE.sub(lambda found: "`{}`".format(found[0].strip("'")), doc)
    return text + see.replace(f"({page}#", "(#")


def launch_rows(stem: str, page: str) -> str:
    """Write the table of a launch file; what is as in display.launch is one row."""
    lines, same = ["| argument | default | meaning |", "| --- | --- | --- |"], []
    known = declared(ROOT / "launch" / "display.launch") if stem != "display" else {}
    for name, (default, doc) in declared(ROOT / "launch" / f"{stem}.launch").items():
        if (stem, name) not in OWN_MEANING:
            doc = launch_meanings()[name]
        if known.get(name) == (default, doc):
            same.append(f"`{name}`")
            continue
        if "by default" in doc:
            default = ""
        elif default.startswith("$(arg"):
            default = f"value of `{default[6:-1]}`"
        elif default:
            default = f"`{default.replace('$(find g1_description)/', '')}`"
        lines.append(row((f"`{name}`", default, argument_text(name, doc, page))))
    if same:
        see = "as for [display.launch](launch.md#launch-files)"
        lines.append(row((", ".join(same), "", see.replace(f"({page}#", "(#"))))
    return "\n".join(lines)


FIELD = re.compile(r"(\S+) (\S+)\s*(?:# *(.*))?")


def fields_of(text: str) -> list[str]:
    """Describe a message, or half of a service, and list its fields in a table."""
    about, pending = "", ""
    lines: list[list[str]] = []
    for line in text.strip().splitlines():
        words = line.strip("# ").replace("|", "\\|")
        field = FIELD.fullmatch(line)
        if line.startswith("#"):
            pending = f"{pending} {words}".strip()
        elif line.startswith(" "):
            lines[-1][2] += f" {words}"
        elif field:
            if not lines:
                about, pending = pending, ""
            kind, name, comment = field.groups("")
            own = re.fullmatch(r"g1_description/(\w+)(.*)", kind)
            kind = f"[{own[1]}](#{own[1].lower()}){own[2]}" if own else f"`{kind}`"
            lines.append([f"`{name}`", kind, f"{pending} {comment}".strip()])
            pending = ""
    head = ["| field | type | meaning |", "| --- | --- | --- |"]
    table = "\n".join([*head, *map(row, lines)] if lines else ["No fields."])
    return [part for part in (about or pending, table) if part]


def interface_rows(folder: str) -> str:
    """Write the fields of all messages or services."""
    parts = []
    for file in sorted((ROOT / folder).iterdir()):
        request, *response = file.read_text().split("---\n")
        parts += [f"### {file.stem}", *fields_of(request)]
        for half in response:
            parts += ["Response:", *fields_of(half)]
    return "\n\n".join(parts)
