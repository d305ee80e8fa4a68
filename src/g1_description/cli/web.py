"""A command that shows robots and motions of files in a browser.

It needs ROS to read rosbags, but neither a master nor a screen.
"""

from __future__ import annotations

import argparse
import logging
import signal
import sys
from contextlib import suppress
from functools import partial
from pathlib import Path

from g1_description.checks.checker import Checker
from g1_description.checks.thresholds_file import read_thresholds
from g1_description.command_line import OneSentenceParser, number, say
from g1_description.errors import G1DescriptionError
from g1_description.files.model_files import share_folder
from g1_description.motion.files.read_any import read_motion_file
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description
from g1_description.robot.load import absolute_urdf
from g1_description.robot.urdf import parse_urdf
from g1_description.ros.lifecycle import own_arguments
from g1_description.web.file_world import FileWorld, StillRobot
from g1_description.web.server.address import ServerOptions
from g1_description.web.show import Show, tell_address

MAX_FPS = 1e6


def parser() -> OneSentenceParser:
    """Make a parser of the command's arguments."""
    made = OneSentenceParser(
        prog="web",
        description="Show a robot and its motions in a browser, without ROS: pose it, "
        "play files, see what checks find. Ctrl-C ends it. For a robot that runs: "
        "roslaunch g1_description display.launch web:=true.",
    )
    what = made.add_mutually_exclusive_group()
    what.add_argument("--motion", type=Path, metavar="FILE", help="a motion to open")
    what.add_argument(
        "--compare",
        type=Path,
        nargs=2,
        metavar=("FILE", "FILE"),
        help="two motions, of two robots beside each other, in step",
    )
    made.add_argument(
        "--model",
        help="the robot, as for model:= of the launch files; default: the G1",
    )
    made.add_argument(
        "--fps",
        type=number,
        help="samples per second of these files, if they have no times; default: 30",
    )
    made.add_argument(
        "--topic",
        help="topic of bags with the joints; default: joint_states, or what there is",
    )
    made.add_argument(
        "--thresholds",
        type=Path,
        metavar="YAML",
        help="what is a warning and what a failure; default: config/checks.yaml",
    )
    defaults = ServerOptions()
    made.add_argument(
        "--host",
        default=defaults.host,
        help="address to listen on; default: 127.0.0.1, this machine only; 0.0.0.0: "
        "all, with a token in the address",
    )
    made.add_argument(
        "--port",
        type=int,
        default=defaults.port,
        help=f"port to listen on; 0: any that is free; default: {defaults.port}",
    )
    made.add_argument(
        "--read-only", action="store_true", help="show, and take nothing from browsers"
    )
    return made


def parse(arguments: list[str]) -> argparse.Namespace:
    """Read a command line; end the program when it is wrong."""
    reader = parser()
    args = reader.parse_args(arguments)
    if args.fps is not None and not 0.0 < args.fps <= MAX_FPS:
        reader.error(f"--fps {args.fps:g} is no number of samples per second")
    return args


G1 = "urdf/g1_29dof.urdf"
"""The robot where none is given, in the package's folder."""


def notify(text: str) -> None:
    """Print a message."""
    say(f"web: {text}")


def make_world(args: argparse.Namespace) -> tuple[FileWorld, list[tuple[Path, Motion]]]:
    """Read the robot, and the motions that were named.

    Raises:
        G1DescriptionError: If a file is not what it should be.
    """
    robot = parse_urdf(absolute_urdf(args.model or str(share_folder() / G1)))
    files = args.compare or ([args.motion] if args.motion else [])
    motions = [(file, _read(args, file, robot, args.fps)) for file in files]
    names = [file.name for file in files] if len(files) > 1 else [robot.name]
    if len({*names}) < len(names):
        names = [f"{file.name} {number}" for number, file in enumerate(files, 1)]
    robots = [StillRobot(name, robot) for name in names]
    world = FileWorld(robots, partial(_read, args))
    return world, motions


def _read(
    args: argparse.Namespace, file: Path, robot: Description, rate: float | None
) -> Motion:
    """Read a motion."""
    topic = args.topic if file in (args.motion, *(args.compare or ())) else None
    return read_motion_file(file, robot, rate, topic)


def web(args: argparse.Namespace) -> None:
    """Show robots until a signal ends it.

    Raises:
        G1DescriptionError: If a file cannot be read, or the page not be opened.
    """
    for signum in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(signum) is not signal.SIG_IGN:
            signal.signal(signum, signal.default_int_handler)
    thresholds = read_thresholds(args.thresholds)
    world, motions = make_world(args)
    options = ServerOptions(args.host, args.port, args.read_only)
    with suppress(KeyboardInterrupt):  # that is how it ends
        show = Show(
            world,
            options,
            lambda robot: Checker(robot, thresholds),
        )
        for (file, motion), robot in zip(motions, world.robots):
            show.page.motion.open(file.name, robot, motion)
        tell_address(show, options, notify)
        show.run()


def main() -> None:
    """Run the command, or exit with a message."""
    args = parse(own_arguments())
    logging.basicConfig(format="web: %(message)s")
    try:
        web(args)
    except G1DescriptionError as error:
        sys.exit(f"web: {error}")
    except OSError as error:
        sys.exit(f"web: {error.filename or ''}: {error.strerror or error}")
