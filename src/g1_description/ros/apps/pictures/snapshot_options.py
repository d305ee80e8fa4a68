"""The command line of snapshot."""

from __future__ import annotations

import argparse
from pathlib import Path

from g1_description.core.cli import OneSentenceParser, number
from g1_description.sim.render.camera import VIEWS

from .film import check_length
from .picture_files import FILMS, check_place

SIDES = (16, 4096)
"""Smallest and largest width and height of a picture, in pixels."""

MAX_TIMES = 60
"""Most pictures of a contact sheet."""


def parser() -> OneSentenceParser:
    """Make a parser of snapshot's arguments."""
    made = OneSentenceParser(
        prog="snapshot",
        description="Write a picture or a film of the robot as it is now, or of a "
        "motion from a file.",
    )
    made.add_argument(
        "out", type=Path, help="output file: a picture .png, or a film .gif or .mp4"
    )
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
    made.add_argument(
        "--motion",
        help="draw the motion in this file (CSV, npz, pickle, bag, YAML of a "
        "trajectory) without a master: a film, or a sheet of pictures",
    )
    made.add_argument(
        "--motion-fps",
        type=number,
        help="samples per second of a motion without times; default: 30",
    )
    made.add_argument(
        "--motion-topic",
        help="topic of a bag with the joints; default: joint_states, or what there is",
    )
    made.add_argument(
        "--times",
        type=times,
        help="moments of the motion to draw side by side, such as 0,1.5,3",
    )
    made.add_argument(
        "--gif", action="store_true", help="record a film; as the name of the file says"
    )
    made.add_argument(
        "--seconds",
        type=number,
        help="duration of the film; default: 5, or the whole motion",
    )
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


def times(text: str) -> list[float]:
    """Read moments of a motion, in [s]."""
    found = [number(part) for part in text.split(",")]
    if len(found) > MAX_TIMES:
        raise argparse.ArgumentTypeError(f"a sheet has at most {MAX_TIMES} pictures")
    return found


def parse(arguments: list[str]) -> argparse.Namespace:
    """Read a command line; end the program when it is wrong.

    Raises:
        InvalidValueError: If the file cannot be written, or a film be made.
    """
    reader = parser()
    args = reader.parse_args(arguments)
    args.is_film = args.gif or args.out.suffix.lower() in FILMS
    _check_together(reader, args)
    if args.seconds is None and not args.motion:
        args.seconds = 5.0
    args.fps = 15.0 if args.fps is None else args.fps
    args.size = args.size or ((640, 480) if args.is_film else (1280, 960))
    check_place(args.out, FILMS if args.is_film else (".png",))
    if args.is_film:
        check_length(1.0 if args.seconds is None else args.seconds, args.fps, args.size)
    return args


def _check_together(reader: OneSentenceParser, args: argparse.Namespace) -> None:
    """End the program where arguments do not go together."""
    if args.model and args.is_film and not args.motion:
        reader.error("--model draws a file, a film of it needs --motion")
    if (args.model or args.motion) and args.namespace:
        reader.error("--model and --motion draw files, without --namespace")
    if args.joints and len(args.namespace or []) > 1:
        reader.error("--joints is for one robot, not for several --namespace")
    if not args.is_film and not (args.seconds is None and args.fps is None):
        reader.error("--seconds and --fps go with a film")
    of_motion = (args.motion_fps, args.motion_topic, args.times)
    if not args.motion and any(value is not None for value in of_motion):
        reader.error("--motion-fps, --motion-topic and --times go with --motion")
    if args.times is not None and args.is_film:
        reader.error("--times goes with a picture, not with a film")
    if args.motion_fps is not None and not 0.0 < args.motion_fps <= 1e6:
        reader.error(
            f"--motion-fps {args.motion_fps:g} is no number of samples per second"
        )
    if (
        args.out.suffix.lower() == ".mp4"
        and args.size
        and any(n % 2 for n in args.size)
    ):
        reader.error("--size of an mp4 has even numbers")
