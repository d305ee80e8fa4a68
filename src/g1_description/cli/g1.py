"""The command g1, which runs those that need no ROS, where there is no rosrun."""

from __future__ import annotations

import ast
import sys
from importlib.util import find_spec
from pathlib import Path

from g1_description.cli.start import run
from g1_description.command_line import MISUSE, OneSentenceParser, entered

UNWRITTEN = "interrupted, nothing is written."

COMMANDS = {
    "check": ("check",),
    "collision_pairs": ("collision_pairs", UNWRITTEN),
    "import_model": (".importer.import_model", UNWRITTEN),
    "motion": ("motion",),
    "moveit_config": ("moveit_config",),
    "snapshot": ("snapshot", UNWRITTEN),
    "web": ("web",),
}
"""Arguments of ``start.run``."""

OF_ROS = ("doctor", "play", "pose", "record")


def about(name: str) -> str:
    """Return what a command does, as its module says, which is not imported."""
    spec = find_spec(f".{COMMANDS[name][0]}", __package__)
    assert spec is not None and spec.origin is not None
    text = Path(spec.origin).read_text(encoding="utf-8")
    lines = str(ast.get_docstring(ast.parse(text))).splitlines()
    return lines[0].partition(", which ")[2]


def main() -> None:
    """Run the command that is named, or list them."""
    name = "".join(sys.argv[1:2])
    if name in COMMANDS:
        del sys.argv[1]
        run(*COMMANDS[name])
        return
    top = OneSentenceParser(
        prog=entered(),
        usage=f"{entered()} [-h] COMMAND ...",
        description="Check, convert, show and draw motions of robots, without ROS.",
        epilog=f"{entered()} COMMAND -h lists the options of a command.",
    )
    top.misuse = MISUSE
    commands = top.add_subparsers(title="commands", metavar="COMMAND")
    for known in COMMANDS:
        commands.add_parser(known, help=about(known))
    if name in OF_ROS:
        own = f"rosrun g1_description {name}"
        top.error(f"{name} needs ROS: source the workspace, and run {own}")
    top.parse_args(sys.argv[1:2])
    top.print_help()
