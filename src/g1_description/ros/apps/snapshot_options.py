"""What snapshot can be asked for."""

from __future__ import annotations

import argparse
from pathlib import Path

from g1_description.core.cli import OneSentenceParser, number
from g1_description.sim.render.camera import VIEWS

from .film import check_length
from .picture_files import check_place

SIDES = (16, 4096)
"""Smallest and largest width and height of a picture, in pixels."""


def parser() -> OneSentenceParser:
    """Make a parser of snapshot's arguments."""
    made = OneSentenceParser(
        prog="snapshot", description="Write a picture of the robot as it is now."
    )
    made.add_argument("out", type=Path, help="file to write: .png, or .gif with --gif")
    made.add_argument(
        "--view",
        choices=VIEWS,
        default="iso",
        help="side is from the robot's right; default: iso",
    )
    made.add_argument(
        "--size", type=size, help="pixels, default: 1280x960, of a film 640x480"
    )
    made.add_argument("--joints", type=joints, default={}, help="such as a=1.2,b=-0.3")
    made.add_argument("--model", help="draw what model:= takes; needs no master")
    made.add_argument(
        "--namespace",
        action="append",
        help="of the robot's topics; may be repeated for several robots",
    )
    made.add_argument("--gif", action="store_true", help="a film of what it does")
    made.add_argument("--seconds", type=number, help="of a film, default: 5")
    made.add_argument("--fps", type=number, help="of a film, default: 15")
    return made


def size(text: str) -> tuple[int, int]:
    """Read a width and a height in pixels."""
    sides = text.lower().split("x")
    if len(sides) == 2 and all(side.isdigit() for side in sides):
        width, height = (int(side) for side in sides)
        if min(width, height) >= SIDES[0] and max(width, height) <= SIDES[1]:
            return width, height
    raise argparse.ArgumentTypeError(
        f"'{text}' is no size such as 1280x960, of {SIDES[0]} to {SIDES[1]} pixels"
    )


def joints(text: str) -> dict[str, float]:
    """Read positions of joints."""
    pairs = [pair.partition("=") for pair in text.split(",")]
    for name, equals, position in pairs:
        if not (name.strip() and equals and position.strip()):
            raise argparse.ArgumentTypeError(f"'{text}' is not such as a=1.2,b=-0.3")
    return {name.strip(): number(position) for name, _, position in pairs}


def parse(arguments: list[str]) -> argparse.Namespace:
    """Read a command line; end the program when it is wrong.

    Raises:
        InvalidValueError: If the file cannot be written, or a film be made.
    """
    reader = parser()
    asked = reader.parse_args(arguments)
    if asked.model and (asked.gif or asked.namespace):
        reader.error("--model draws a file, without --gif and --namespace")
    if asked.joints and len(asked.namespace or []) > 1:
        reader.error("--joints is for one robot, not for several --namespace")
    if not asked.gif and not (asked.seconds is None and asked.fps is None):
        reader.error("--seconds and --fps go with --gif")
    asked.seconds = 5.0 if asked.seconds is None else asked.seconds
    asked.fps = 15.0 if asked.fps is None else asked.fps
    asked.size = asked.size or ((640, 480) if asked.gif else (1280, 960))
    check_place(asked.out, ".gif" if asked.gif else ".png")
    if asked.gif:
        check_length(asked.seconds, asked.fps, asked.size)
    return asked
