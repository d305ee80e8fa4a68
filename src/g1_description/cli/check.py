"""The command check, which checks motions in files.

It needs neither a master nor a screen.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
import time
from collections.abc import Collection
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from g1_description.api import Robot
from g1_description.bounds import MAX_PORT
from g1_description.checks.batch import FileChecker, Here, check_files, pool_of
from g1_description.checks.cluster import Cluster
from g1_description.checks.report import (
    NO_MOTION,
    NOT_CHECKED,
    NOT_READ,
    FileResult,
    outcome_text,
    summary_text,
)
from g1_description.checks.rules import RULES
from g1_description.checks.verdict import FAILED
from g1_description.cli import options
from g1_description.cli.check_reports import (
    STDOUT,
    ReportPlaces,
    Reports,
    check_place,
    comparisons,
    write_comparisons,
)
from g1_description.cli.motion_paths import (
    MotionFiles,
    motion_files,
    unmatched,
)
from g1_description.cli.progress import Printer
from g1_description.cli.start import INTERRUPTED
from g1_description.command_line import number, option, own_arguments, parse, say
from g1_description.errors import ClusterError, G1DescriptionError, InvalidValueError
from g1_description.motion import selection as selections
from g1_description.motion.files.formats import ENDINGS
from g1_description.motion.files.source import ReadOptions
from g1_description.motion.paths import split
from g1_description.motion.selection import Selection
from g1_description.render.page_data import motion_data
from g1_description.robot.launch_arguments import ENGINES
from g1_description.text import listed, similar_first

MISUSE = 2
"""Exit code for a wrong command line or a file that cannot be checked."""

REPORTS = {"json": ".json", "csv": ".csv", "html": ".html", "write_selection": ".yaml"}
"""File extensions of reports."""


def scheduler(text: str) -> str:
    """Parse the address of a Dask scheduler."""
    match = re.fullmatch(r"((tcp|tls)://)?(\[[^\]]+\]|[^:/\s]+):(\d+)", text)
    if match and 0 < int(match[4]) <= MAX_PORT:
        return text
    raise argparse.ArgumentTypeError(
        f"must be HOST:PORT, such as localhost:8786 (got '{text}')"
    )


def checks(text: str) -> tuple[str, ...]:
    """Read names of checks."""
    known = [rule.name for rule in RULES]
    names = tuple(name.strip() for name in text.split(","))
    for name in names:
        if name not in known:
            near = ", ".join(similar_first(name, known))
            raise argparse.ArgumentTypeError(
                f"unknown check '{name}'; known checks: {near}"
            )
    return names


@dataclass(frozen=True)
class CheckOptions:
    """Check motions in files.

    Checks limits, jumps, self-collisions, floor contact, balance, and with --physics
    the tracking by motors. The exit code is 0 if nothing failed, 1 if a motion failed,
    2 if something could not be checked.
    """

    files: list[Path] = options.motions()
    model: str = options.model()
    fps: float | None = options.fps()
    topic: str | None = options.topic()
    order: str | None = options.order()
    input_joint_order: str | None = options.input_joint_order()
    format: str | None = options.file_format()
    every: bool = option(
        "check all motions of files that have several", False, names=("--all",)
    )
    thresholds: Path | None = options.thresholds()
    only: tuple[str, ...] = option(
        "make only these checks, such as position,self_collision",
        (),
        checks,
        metavar="CHECK,...",
    )
    fixed_base: bool = option(
        "the base is fixed: efforts are checked, the floor is not", False
    )
    no_visual_hulls: bool = option(
        "do not substitute hulls of visual shapes for missing collision shapes", False
    )
    motors: Path | None = option(
        "with --physics: file of the motors",
        None,
        Path,
        metavar="YAML",
        shown="that of the robot's profile, or as in its URDF",
        see="[motors](motions.md#tracked-by-motors)",
    )
    collisions: Path | None = options.collisions()
    selection: Path | None = options.selection()
    write_selection: Path | None = option(
        "exclude the motions that a rule of the thresholds excludes in this selection, "
        "which need not exist",
        None,
        Path,
        metavar="YAML",
        see="[selections](many_motions.md#a-selection)",
    )
    physics: bool = option(
        "also simulate the motions with motors, about as fast as real time",
        False,
        see="[physics](physics_check.md)",
    )
    engine: str | None = option(
        "with --physics: physics engine, bullet or mujoco",
        None,
        str,
        choices=ENGINES,
        shown="bullet",
        see="[engines](launch.md#engines)",
    )
    json: str | None = option(
        "write a report with all findings; -: to stdout, instead of the tables",
        None,
        str,
        metavar="FILE",
    )
    csv: str | None = option(
        "write a table with a row per file; -: to stdout, instead of the tables",
        None,
        str,
        metavar="FILE",
    )
    plot: Path | None = option(
        "draw a .png for one motion, or a folder of them for several",
        None,
        Path,
        metavar="OUT",
    )
    html: Path | None = option(
        "write a page with the robot, causes and plots", None, Path, metavar="FILE"
    )
    against: Path | None = option(
        "compare with this reference, or with those of the same names in this folder",
        None,
        Path,
        metavar="REFERENCE",
        see="[executed motions](checks.md#executed-motions)",
    )
    shift: float | None = option(
        "time of the executed motion minus that of the reference in s, for --against",
        None,
        number,
        metavar="SECONDS",
        shown="found",
    )
    watch: bool = option(
        "check again whenever a motion changes, until Ctrl-C; faster than starting "
        "again",
        False,
    )
    quiet: bool = option("print only the last line, with the counts", False)
    jobs: int = options.jobs()
    dask: str | None = option(
        "check on the workers of this Dask scheduler",
        None,
        scheduler,
        metavar="HOST:PORT",
    )

    def __post_init__(self) -> None:
        """Check combinations of options.

        Raises:
            InvalidValueError: If options contradict each other.
        """
        if self.dask is not None and self.jobs > 1:
            raise InvalidValueError("--jobs and --dask cannot be combined")
        played = [rule.name for rule in RULES if rule.needs_physics]
        physics = [name for name in self.only if name in played]
        if physics and not self.physics:
            raise InvalidValueError(f"--only {listed(physics)} needs --physics")
        for name, ending in REPORTS.items():
            file = getattr(self, name)
            if file not in (None, STDOUT) and Path(file).suffix.lower() != ending:
                flag = f"--{name.replace('_', '-')}"
                raise InvalidValueError(f"{flag} must end in {ending} (got {file})")
        needed = {"motors": "physics", "engine": "physics", "shift": "against"}
        for name, other in needed.items():
            if getattr(self, name) is not None and not getattr(self, other):
                raise InvalidValueError(f"--{name} needs --{other}")
        if self.watch and self.dask is not None:
            raise InvalidValueError("--watch and --dask cannot be combined")
        names = ("csv", "plot", "html", "write_selection", "dask", "only", "quiet")
        names += ("watch",)
        unfit = [f"--{name.replace('_', '-')}" for name in names if getattr(self, name)]
        unfit += ["--jobs"] if self.jobs > 1 else []
        if self.against is not None and unfit:
            raise InvalidValueError(f"--against cannot be combined with {unfit[0]}")
        if self.json == self.csv == STDOUT:
            raise InvalidValueError("--json and --csv cannot both write to stdout")


def notify(text: str) -> None:
    """Print a message."""
    say(f"check: {text}", sys.stderr)


def check(args: CheckOptions, checker: FileChecker | None = None) -> int:
    """Check motions; return the exit code.

    Args:
        args: Arguments of the command line.
        checker: Checks the files; None: it is prepared.

    Raises:
        G1DescriptionError: If nothing can be checked.
        KeyboardInterrupt: If it is interrupted before the first outcome.
    """
    selection = Selection(args.selection) if args.selection else None
    places = _places(args)
    files = motion_files(args.files, args.every, selection, reports=places.files)
    if unmatched(selection):
        notify(unmatched(selection))
    if args.against is not None:
        return _compare(args, files, args.against)
    reports = Reports(places, files.tasks)
    checker = checker or file_checker(args)
    is_free = STDOUT not in (args.json, args.csv)
    stream = sys.stdout if is_free and not args.quiet else None
    code, is_interrupted = INTERRUPTED, False
    outcomes: dict[int, FileResult] = {}
    with closing(Printer(len(files.tasks), stream)) as printer:
        try:
            if args.dask is not None:
                pool: Here = Cluster(checker, args.dask)
            else:
                pool = pool_of(checker, args.jobs, len(files.tasks))
            with closing(pool):
                for task, outcome in check_files(pool, files.tasks):
                    reports.add(task, outcome)
                    outcomes[task.number] = replace(outcome, plot=b"", scene="")
                    printer.add(task.number, outcome_text(outcome) if stream else "")
        except (KeyboardInterrupt, ClusterError) as error:
            if not outcomes:
                raise
            if isinstance(error, ClusterError):
                notify(str(error))
                code = MISUSE
            is_interrupted = isinstance(error, KeyboardInterrupt)
    robot = checker.checker.description
    n_missing = len(files.tasks) - len(outcomes)
    reports.write(outcomes, n_missing, robot)
    for problem in reports.problems:
        notify(problem)
    done = [outcomes[number] for number in sorted(outcomes)]
    text = f"{summary_text(done, n_missing)}{files.remarks}."
    say(text, sys.stdout if is_free else sys.stderr)
    if is_interrupted and args.watch:
        raise KeyboardInterrupt
    if n_missing:
        return code
    code = exit_code(done, files.named)
    return code or (MISUSE if reports.problems else 0)


INTERVAL = 0.3
"""Time between two looks for changes of watched files, in [s]."""


def watch(args: CheckOptions) -> int:
    """Check motions whenever one changes, until Ctrl-C; return the last exit code.

    Raises:
        G1DescriptionError: If nothing can be checked at the start.
    """
    checker = file_checker(args)
    seen, code = stamps(args), INTERRUPTED
    try:
        code = check(args, checker)
        while True:
            notify("waiting for changes; Ctrl-C ends.")
            now = seen
            while now == seen or now != stamps(args):  # also until a file is complete
                now = stamps(args)
                time.sleep(INTERVAL)
            seen = now
            try:
                code = check(args, checker)
            except (G1DescriptionError, OSError) as error:
                notify(str(error))
                code = MISUSE
    except KeyboardInterrupt:
        pass
    return code


def stamps(args: CheckOptions) -> set[tuple[str, int, int]]:
    """Return the paths, times and sizes of all motions, to compare."""
    found, reports = set(), _places(args).files
    for path in args.files:
        file = Path(os.path.realpath(split(path)[0]))
        below = [file]
        if file.is_dir():
            below = [n for n in file.rglob("*") if n.suffix.lower() in ENDINGS]
        for name in below:
            if name.name == selections.FILE or str(name) in reports:
                continue
            with suppress(OSError):  # it is being replaced
                status = name.stat()
                found.add((str(name), status.st_mtime_ns, status.st_size))
    return found


def _places(args: CheckOptions) -> ReportPlaces:
    """Return where reports go."""
    return ReportPlaces(args.json, args.csv, args.html, args.plot, args.write_selection)


def _compare(args: CheckOptions, files: MotionFiles, against: Path) -> int:
    """Compare motions with their references; return the exit code."""
    if args.json not in (None, STDOUT):
        check_place(Path(str(args.json)))
    found = [*comparisons(file_checker(args), files, against, args.shift)]
    write_comparisons(found, args.json)
    return MISUSE if any(isinstance(result, str) for _, result in found) else 0


def file_checker(args: CheckOptions) -> FileChecker:
    """Prepare the checks of the robot.

    Raises:
        G1DescriptionError: If a given file is invalid.
    """
    robot = Robot(args.model, args.motors, args.collisions)
    description = robot.description
    return FileChecker(
        robot.checker(
            args.thresholds,
            args.fixed_base,
            args.physics,
            not args.no_visual_hulls,
            args.engine or ENGINES[0],
        ),
        args.only,
        bool(args.plot),
        ReadOptions(
            args.fps, args.topic, args.order, args.format, args.input_joint_order
        ),
        scene=partial(motion_data, description) if args.html else None,
    )


def exit_code(outcomes: Collection[FileResult], named: Collection[str]) -> int:
    """Return the exit code.

    Args:
        outcomes: Outcomes of all files.
        named: Names of files given one by one, which must be motions.
    """
    if any(outcome.result == FAILED for outcome in outcomes):
        return 1
    others = [outcome.file for outcome in outcomes if outcome.result == NO_MOTION]
    if len(others) == len(outcomes) or any(file in named for file in others):
        return MISUSE
    is_missing = any(o.result in (NOT_READ, NOT_CHECKED) for o in outcomes)
    return MISUSE if is_missing else 0


def main() -> None:
    """Run the command, or exit with a message."""
    args = parse(CheckOptions, "check", own_arguments(), MISUSE)
    try:
        code = watch(args) if args.watch else check(args)
    except (G1DescriptionError, OSError) as error:
        notify(str(error))
        code = MISUSE
    sys.exit(code)
