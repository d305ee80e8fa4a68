"""The command line of check."""

from __future__ import annotations

import argparse
from pathlib import Path

from g1_description.checks.rules import RULES
from g1_description.command_line import OneSentenceParser, number
from g1_description.text import listed, similar_first

MISUSE = 2
"""Exit code where the command line is wrong, or something cannot be checked."""

MAX_FPS = 1e6
MAX_JOBS = 256

STDOUT = "-"

ENDINGS = {"json": ".json", "csv": ".csv", "html": ".html"}
"""What names of reports end in."""


class CheckParser(OneSentenceParser):
    """A parser whose exit code is another than that of a motion that failed."""

    misuse = MISUSE


def parser() -> OneSentenceParser:
    """Make a parser of the command's arguments."""
    made = CheckParser(
        prog="check",
        description="Check motions in files: limits, jumps, self-collisions, the "
        "floor, balance, and with --physics what motors make of them. The exit code is "
        "0 if nothing failed, 1 if a motion failed, 2 if something could not be "
        "checked.",
    )
    made.add_argument(
        "files",
        type=Path,
        nargs="+",
        metavar="FILE",
        help="a motion (CSV, npz, pickle, bag, YAML of a trajectory), or a folder with "
        "motions below it",
    )
    _add_reading(made)
    _add_judging(made)
    _add_reports(made)
    made.add_argument(
        "--jobs",
        type=int,
        default=1,
        metavar="N",
        help="processes of this machine that work at once; default: 1",
    )
    made.add_argument(
        "--dask",
        metavar="HOST:PORT",
        help="let the workers of this Dask scheduler do it",
    )
    return made


def _add_reading(made: OneSentenceParser) -> None:
    """Add how files are read."""
    made.add_argument(
        "--model",
        help="the robot, as for model:= of the launch files; default: the G1",
    )
    made.add_argument(
        "--fps",
        type=number,
        help="samples per second of files without times; default: 30",
    )
    made.add_argument(
        "--topic",
        help="topic of bags with the joints, other files are then not read; default: "
        "joint_states, or what there is",
    )


def _add_judging(made: OneSentenceParser) -> None:
    """Add what is checked, and how."""
    made.add_argument(
        "--thresholds",
        type=Path,
        metavar="YAML",
        help="what is a warning and what a failure; default: config/checks.yaml",
    )
    made.add_argument(
        "--only",
        type=_checks,
        default=(),
        metavar="CHECK,...",
        help="make only these checks, such as position,self_collision",
    )
    made.add_argument(
        "--fixed-base",
        action="store_true",
        help="something holds the base: efforts are judged, the floor is not",
    )
    made.add_argument(
        "--no-visual-hulls",
        action="store_true",
        help="links without collision shapes have none, instead of the hulls of their "
        "visual ones",
    )
    made.add_argument(
        "--collisions",
        type=Path,
        metavar="YAML",
        help="pairs of links that may touch by design, as collision_pairs writes them",
    )
    made.add_argument(
        "--physics",
        action="store_true",
        help="also play the motions in physics, about as fast as they are",
    )


def _add_reports(made: OneSentenceParser) -> None:
    """Add what is written."""
    made.add_argument(
        "--json", metavar="FILE", help="write all that was found; -: on stdout"
    )
    made.add_argument(
        "--csv", metavar="FILE", help="write a row per file; -: on stdout"
    )
    made.add_argument(
        "--plot",
        type=Path,
        metavar="OUT",
        help="draw the motion: a picture .png, or a folder for several motions",
    )
    made.add_argument(
        "--html",
        type=Path,
        metavar="FILE",
        help="write a page with all of it, pictures too",
    )
    made.add_argument(
        "--quiet", action="store_true", help="print only the last line, with the counts"
    )


def parse(arguments: list[str]) -> argparse.Namespace:
    """Read a command line; end the program when it is wrong."""
    reader = parser()
    args = reader.parse_args(arguments)
    if args.fps is not None and not 0.0 < args.fps <= MAX_FPS:
        reader.error(f"--fps {args.fps:g} is no number of samples per second")
    if not 1 <= args.jobs <= MAX_JOBS:
        reader.error(f"--jobs {args.jobs} is not from 1 to {MAX_JOBS}")
    if args.dask is not None and args.jobs > 1:
        reader.error("--jobs is for this machine, --dask for others")
    played = [rule.name for rule in RULES if rule.needs_physics]
    physics = [name for name in args.only if name in played]
    if physics and not args.physics:
        reader.error(f"{listed(physics)} goes with --physics")
    for option, ending in ENDINGS.items():
        name = getattr(args, option)
        if name not in (None, STDOUT) and Path(name).suffix.lower() != ending:
            reader.error(f"--{option} {name} does not end in {ending}")
    if args.json == args.csv == STDOUT:
        reader.error("--json and --csv cannot both be on stdout")
    return args


def _checks(text: str) -> tuple[str, ...]:
    """Read names of checks."""
    known = [rule.name for rule in RULES]
    names = tuple(name.strip() for name in text.split(","))
    for name in names:
        if name not in known:
            raise argparse.ArgumentTypeError(
                f"there is no check '{name}'; there are "
                f"{', '.join(similar_first(name, known))}"
            )
    return names
