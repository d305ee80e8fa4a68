"""The command line of web."""

from __future__ import annotations

import argparse
from pathlib import Path

from g1_description.core.cli import OneSentenceParser, number
from g1_description.web.server.address import ServerOptions

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
