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

from g1_description.core.checks.thresholds import read_thresholds
from g1_description.core.cli import say
from g1_description.core.errors import G1DescriptionError
from g1_description.core.files.absolute_urdf import absolute_urdf
from g1_description.core.files.share import share_folder
from g1_description.core.motion.motion import Motion
from g1_description.core.robot.description import Description
from g1_description.core.urdf.reader import parse_urdf
from g1_description.ros.motion.files.read import read_motion_file
from g1_description.ros.node.lifecycle import own_arguments
from g1_description.sim.checks.checker import Checker
from g1_description.web.robots.files import FileWorld, StillRobot
from g1_description.web.server.address import ServerOptions
from g1_description.web.show import Show, tell_address

from .options import parse

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
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler)
    thresholds = read_thresholds(args.thresholds)
    world, motions = make_world(args)
    options = ServerOptions(args.host, args.port, args.read_only)
    with suppress(KeyboardInterrupt):  # that is how it ends
        show = Show(
            world,
            options,
            lambda robot: Checker.of(robot, thresholds),
            thresholds.floor_height,
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
