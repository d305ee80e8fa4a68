"""The command g1, which runs those that need no ROS, where there is no rosrun."""

from __future__ import annotations

import sys

from g1_description.cli.start import run
from g1_description.command_line import OneSentenceParser, program_name

NOTHING_WRITTEN = "interrupted, nothing is written."

COMMANDS = {
    "check": ("Check motions in files.", "check"),
    "collision_pairs": (
        "Find pairs of links that need no check.",
        "collision_pairs",
        NOTHING_WRITTEN,
    ),
    "import_model": (
        "Copy a robot and its meshes to a folder.",
        ".importer.import_model",
        NOTHING_WRITTEN,
    ),
    "motion": ("Describe, convert and edit motions in files.", "motion"),
    "moveit_config": ("Write a MoveIt configuration of a robot.", "moveit_config"),
    "snapshot": ("Draw a robot or a motion.", "snapshot", NOTHING_WRITTEN),
    "web": ("Show a robot and its motions in a browser.", "web"),
}
"""Descriptions, and arguments of ``start.run``."""

ROS_COMMANDS = ("doctor", "play", "pose", "record", "why")


def main() -> None:
    """Run the command that is named, or list them."""
    name = "".join(sys.argv[1:2])
    if name in COMMANDS:
        del sys.argv[1]
        run(*COMMANDS[name][1:])
        return
    top = OneSentenceParser(
        prog=program_name(),
        usage=f"{program_name()} [-h] COMMAND ...",
        description="Check, convert, show and draw motions of robots, without ROS.",
        epilog=f"{program_name()} COMMAND -h lists the options of a command.",
    )
    commands = top.add_subparsers(title="commands", metavar="COMMAND")
    for known, (about, *_) in COMMANDS.items():
        commands.add_parser(known, help=about)
    if name in ROS_COMMANDS:
        own = f"rosrun g1_description {name}"
        top.error(f"{name} needs ROS: source the workspace, and run {own}")
    top.parse_args(sys.argv[1:2])
    top.print_help()
