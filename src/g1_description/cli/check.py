"""The command check, which checks motions in files.

It needs neither a master nor a screen.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Collection
from contextlib import closing, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

from g1_description.api import Robot
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
from g1_description.checks.verdict import FAILED
from g1_description.cli import options
from g1_description.cli.check_options import STDOUT, CheckOptions
from g1_description.cli.check_reports import (
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
from g1_description.command_line import EXIT_ERROR, exit_with_error, say
from g1_description.errors import ClusterError, G1DescriptionError
from g1_description.motion import selection as selections
from g1_description.motion.files.formats import ENDINGS
from g1_description.motion.files.source import ReadOptions
from g1_description.motion.paths import split
from g1_description.motion.selection import Selection
from g1_description.render.page_data import motion_data
from g1_description.scenes.objects import SceneObject
from g1_description.scenes.scene import Scene


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
                code = EXIT_ERROR
            is_interrupted = isinstance(error, KeyboardInterrupt)
    robot = checker.checker.description
    n_missing = len(files.tasks) - len(outcomes)
    reports.write(outcomes, n_missing, robot, objects_of(args) if args.html else [])
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
    return code or (EXIT_ERROR if reports.problems else 0)


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
                code = EXIT_ERROR
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
    return EXIT_ERROR if any(isinstance(result, str) for _, result in found) else 0


def file_checker(args: CheckOptions) -> FileChecker:
    """Prepare the checks of the robot.

    Raises:
        G1DescriptionError: If a given file is invalid.
    """
    if args.plot:  # where matplotlib is missing, nothing is checked in vain
        import g1_description.checks.plot  # noqa: F401
    robot = Robot(args.model, args.motors, args.collisions)
    description, around = robot.description, objects_of(args)
    return FileChecker(
        robot.checker(
            args.thresholds,
            args.fixed_base,
            args.physics,
            not args.no_visual_hulls,
            args.engine or "",
            Scene(around) if around else None,
        ),
        args.only,
        bool(args.plot),
        ReadOptions(
            args.fps, args.topic, args.order, args.format, args.input_joint_order
        ),
        scene=partial(motion_data, description, objects=around) if args.html else None,
    )


def objects_of(args: CheckOptions) -> list[SceneObject]:
    """Read the objects around the robot.

    Raises:
        SceneError: If they cannot be read.
    """
    scene = options.scene_of(args.scene, args.files)
    return [*scene.values()] if scene else []


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
        return EXIT_ERROR
    is_missing = any(o.result in (NOT_READ, NOT_CHECKED) for o in outcomes)
    return EXIT_ERROR if is_missing else 0


def main(args: CheckOptions) -> None:
    """Run the command, or exit with a message."""
    try:
        sys.exit(watch(args) if args.watch else check(args))
    except (G1DescriptionError, OSError) as error:
        exit_with_error("check", error)
