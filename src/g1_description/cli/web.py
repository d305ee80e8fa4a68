"""The command web, which shows robots and motions of files in a browser.

It needs neither a master nor a screen.
"""

from __future__ import annotations

import logging
import signal
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from g1_description.checks.checker import Checker
from g1_description.checks.thresholds_file import read_thresholds
from g1_description.choices import MAX_PORT
from g1_description.cli import options
from g1_description.cli.motion_paths import motion_files
from g1_description.collisions.find_pairs import collisions_of
from g1_description.command_line import (
    argument,
    exit_with_error,
    option,
    own_arguments,
    parse,
    say,
    within,
)
from g1_description.errors import G1DescriptionError, InvalidValueError
from g1_description.interrupts import ENDING_SIGNALS
from g1_description.motion.files.formats import read_motion
from g1_description.motion.files.source import ReadOptions
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description
from g1_description.robot.load import read_description
from g1_description.web.file_world import FileWorld, StillRobot
from g1_description.web.library import REPORTS, Library
from g1_description.web.page import Page, report_address
from g1_description.web.server.address import ServerOptions


def motion_or_folder(text: str) -> Path:
    """Read the name of a motion, as ``options.motion_file``, or of a folder."""
    return Path(text) if Path(text).is_dir() else options.motion_file(text)


@dataclass(frozen=True)
class WebOptions:
    """Show a robot and its motions in a browser, without a ROS master.

    Move it, play files, see findings. Ctrl-C ends it. For a running robot, use
    roslaunch g1_description display.launch web:=true.
    """

    path: Path | None = argument(
        "a motion to open, or a folder of motions to look through",
        motion_or_folder,
        nargs="?",
        default=None,
        metavar="FILE",
    )
    report: Path | None = option(
        "what check found in the folder, as written by check --csv or --json",
        None,
        Path,
        shown="report.csv or report.json in the folder, if it is there",
        metavar="FILE",
    )
    selection: Path | None = option(
        "which motions of the folder are kept",
        None,
        Path,
        shown="selection.yaml in the folder",
        metavar="YAML",
        see="[selections](many_motions.md#a-selection)",
    )
    motion: Path | None = option(
        "a motion to open", None, options.motion_file, metavar="FILE"
    )
    compare: list[Path] | None = option(
        "two motions, played in sync by two robots",
        None,
        options.motion_file,
        nargs=2,
        metavar=("FILE", "FILE"),
        see="[two motions](browser.md#two-motions)",
    )
    model: str = options.model()
    fps: float | None = options.fps()
    topic: str | None = options.topic()
    order: str | None = options.order()
    format: str | None = options.file_format()
    scene: Path | None = options.scene()
    collisions: Path | None = options.collisions()
    thresholds: Path | None = options.thresholds()
    host: str = option(
        "address to listen on; 0.0.0.0: all, with a token in the address",
        ServerOptions().host,
        see="[from another machine](browser.md#from-another-machine)",
    )
    port: int = option(
        "port to listen on; 0: any that is free",
        ServerOptions().port,
        within(0, MAX_PORT, int),
    )
    read_only: bool = option("show the robot without controls", False)

    def __post_init__(self) -> None:
        """Check combinations of options.

        Raises:
            InvalidValueError: If some exclude each other.
        """
        if self.path and (self.motion or self.compare):
            raise InvalidValueError(
                "FILE cannot be combined with --motion or --compare"
            )
        if self.folder and self.read_only:
            raise InvalidValueError("a folder cannot be combined with --read-only")
        if not self.folder and (self.report or self.selection):
            raise InvalidValueError("--report and --selection need a folder as FILE")
        if self.motion and self.compare:
            raise InvalidValueError("--motion and --compare cannot be combined")

    @property
    def folder(self) -> Path | None:
        """The folder of motions, if FILE is one."""
        return self.path if self.path and self.path.is_dir() else None

    @property
    def files(self) -> list[Path]:
        """The motions that are opened."""
        opened = self.motion or (None if self.folder else self.path)
        return self.compare or ([opened] if opened else [])


def notify(text: str) -> None:
    """Print a message."""
    say(f"web: {text}")


def make_world(args: WebOptions) -> tuple[FileWorld, list[tuple[Path, Motion]]]:
    """Read the robot, and the motions that were named.

    Raises:
        G1DescriptionError: If a file is invalid.
    """
    robot = read_description(args.model)
    files = args.files
    motions = [(file, _read(args, file, robot, args.fps)) for file in files]
    names = [file.name for file in files] if len(files) > 1 else [robot.name]
    if len({*names}) < len(names):
        names = [f"{file.name} {number}" for number, file in enumerate(files, 1)]
    robots = [StillRobot(name, robot) for name in names]
    scene = options.scene_of(args.scene, files)
    world = FileWorld(robots, partial(_read, args), scene)
    return world, motions


def make_library(args: WebOptions) -> Library | None:
    """Find the motions of the folder that was named.

    Raises:
        InvalidValueError: If it has none, or its report or selection is invalid.
    """
    if args.folder is None:
        return None
    files = [task.path for task in motion_files([args.folder]).tasks]
    usual = (args.folder / name for name in REPORTS)
    report = args.report or next((path for path in usual if path.exists()), None)
    return Library(args.folder, files, report, args.selection)


def _read(
    args: WebOptions, file: Path, robot: Description, rate: float | None
) -> Motion:
    """Read a motion."""
    is_listed = args.folder is not None and args.folder in file.parents
    rate = args.fps if is_listed else rate
    if is_listed or file in args.files:
        options = ReadOptions(rate, args.topic, args.order, args.format)
    else:
        options = ReadOptions(rate)
    return read_motion(file, robot, options)


def web(args: WebOptions) -> None:
    """Show robots until a signal ends it.

    Raises:
        G1DescriptionError: If a file cannot be read, or the page cannot be opened.
    """
    for signum in ENDING_SIGNALS[1:]:
        if signal.getsignal(signum) is not signal.SIG_IGN:
            signal.signal(signum, signal.default_int_handler)
    thresholds = read_thresholds(args.thresholds)
    world, motions = make_world(args)
    library = make_library(args)
    server = ServerOptions(args.host, args.port, args.read_only)
    with suppress(KeyboardInterrupt):  # the normal end
        page = Page(
            world,
            server,
            lambda robot: Checker(
                robot, thresholds, collisions=collisions_of(robot, args.collisions)
            ),
            library,
            motion_first=bool(motions),
        )
        for (file, motion), robot in zip(motions, world.robots):
            page.motion.open(file.name, robot, motion)
        report_address(page, server, notify)
        page.run()


def main() -> None:
    """Run the command, or exit with a message."""
    args = parse(WebOptions, "web", own_arguments())
    logging.basicConfig(format="web: %(message)s")
    try:
        web(args)
    except (G1DescriptionError, OSError) as error:
        exit_with_error("web", error)
