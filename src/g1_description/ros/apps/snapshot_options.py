"""The command line of snapshot."""

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
        prog="snapshot",
        description="Write a picture or a film of the robot as it is now.",
    )
    made.add_argument("out", type=Path, help="output file: .png, or .gif with --gif")
    made.add_argument(
        "--view",
        choices=VIEWS,
        default="iso",
        help="direction to look from; side: from the robot's right; default: iso",
    )
    made.add_argument(
        "--size",
        type=size,
        help="width and height in pixels; default: 1280x960, for films 640x480",
    )
    made.add_argument(
        "--joints",
        type=joints,
        default={},
        help="override joint positions, such as a=1.2,b=-0.3",
    )
    made.add_argument(
        "--model",
        help="draw a model file, as for model:= of the launch files, without a master",
    )
    made.add_argument(
        "--namespace",
        action="append",
        help="namespace of the robot's topics; repeat it for several robots",
    )
    made.add_argument("--gif", action="store_true", help="record a film")
    made.add_argument("--seconds", type=number, help="duration of the film; default: 5")
    made.add_argument(
        "--fps", type=number, help="pictures per second of the film; default: 15"
    )
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
    args = reader.parse_args(arguments)
    if args.model and (args.gif or args.namespace):
        reader.error("--model draws a file, without --gif and --namespace")
    if args.joints and len(args.namespace or []) > 1:
        reader.error("--joints is for one robot, not for several --namespace")
    if not args.gif and not (args.seconds is None and args.fps is None):
        reader.error("--seconds and --fps go with --gif")
    args.seconds = 5.0 if args.seconds is None else args.seconds
    args.fps = 15.0 if args.fps is None else args.fps
    args.size = args.size or ((640, 480) if args.gif else (1280, 960))
    check_place(args.out, ".gif" if args.gif else ".png")
    if args.gif:
        check_length(args.seconds, args.fps, args.size)
    return args
