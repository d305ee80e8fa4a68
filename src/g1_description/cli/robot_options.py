"""What the commands for a robot that runs have in common on their command lines."""

from __future__ import annotations

import argparse
import re

NAME = re.compile(r"[A-Za-z]\w*(/\w+)*", re.ASCII)
"""A name of ROS without slashes around. rosgraph has this too, but cannot be imported
where the command is to say that ROS is missing."""


def add_namespace(parser: argparse.ArgumentParser) -> None:
    """Add an option for the robot's namespace, which is read without its slashes."""
    parser.add_argument(
        "--namespace",
        type=_namespace,
        default="",
        help="namespace of the robot's topics",
    )


def _namespace(text: str) -> str:
    """Read a namespace."""
    name = text.strip("/")
    if name and not NAME.fullmatch(name):
        raise argparse.ArgumentTypeError(f"'{text}' is no ROS name")
    return name
