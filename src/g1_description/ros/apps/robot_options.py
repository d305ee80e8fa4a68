"""What the commands for a robot that runs have in common on their command lines."""

from __future__ import annotations

import argparse

import rosgraph


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
    if name and not rosgraph.names.is_legal_name(name):
        raise argparse.ArgumentTypeError(f"'{text}' is no ROS name")
    return name
