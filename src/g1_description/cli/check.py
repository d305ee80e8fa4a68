"""A command that checks motions in files.

It needs ROS to read rosbags, but neither a master nor a screen.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Collection
from contextlib import closing

from g1_description.api import MODEL, Robot
from g1_description.checks.batch import FileChecker, Here, Processes, check_files
from g1_description.checks.cluster import Cluster
from g1_description.checks.report import (
    NO_MOTION,
    NOT_CHECKED,
    NOT_READ,
    FileResult,
    summary_text,
)
from g1_description.checks.verdict import FAILED
from g1_description.cli.check_options import MISUSE, STDOUT, parse
from g1_description.cli.check_reports import Reports, Results
from g1_description.cli.motion_paths import MotionFiles, motion_files
from g1_description.cli.start import INTERRUPTED
from g1_description.collisions.find_pairs import collisions_of
from g1_description.command_line import say
from g1_description.errors import ClusterError, G1DescriptionError
from g1_description.motion.files.read_any import read_motion_file
from g1_description.ros.lifecycle import own_arguments


def notify(text: str) -> None:
    """Print a message."""
    say(f"check: {text}", sys.stderr)


def check(args: argparse.Namespace) -> int:
    """Check motions; return the exit code.

    Raises:
        G1DescriptionError: If nothing can be checked.
        KeyboardInterrupt: If it is interrupted before anything is done.
    """
    files = motion_files(args.files)
    reports = Reports(args, files.tasks)
    checker = file_checker(args)
    is_free = STDOUT not in (args.json, args.csv)
    stream = sys.stdout if is_free and not args.quiet else None
    code = INTERRUPTED
    with closing(Results(len(files.tasks), stream)) as results:
        try:
            with closing(_pool(args, checker, len(files.tasks))) as pool:
                for task, outcome in check_files(pool, files.tasks):
                    reports.add(task, outcome)
                    results.add(task, outcome.without_plot())
        except (KeyboardInterrupt, ClusterError) as error:
            if not results.outcomes:
                raise
            if isinstance(error, ClusterError):
                notify(str(error))
                code = MISUSE
    reports.write(results.outcomes, results.n_missing)
    for problem in reports.problems:
        notify(problem)
    _summarize(results, files, sys.stdout if is_free else sys.stderr)
    if results.n_missing:
        return code
    code = exit_code(results.outcomes.values(), files.named)
    return code or (MISUSE if reports.problems else 0)


def file_checker(args: argparse.Namespace) -> FileChecker:
    """Prepare the checks of the robot.

    Raises:
        G1DescriptionError: If a file that is named is not what it should be.
    """
    robot = Robot(args.model or MODEL)
    collisions = collisions_of(
        robot.description, args.collisions, not args.no_visual_hulls
    )
    return FileChecker(
        robot.checker(args.thresholds, args.fixed_base, collisions, args.physics),
        args.only,
        bool(args.plot or args.html),
        args.fps,
        args.topic,
        read_motion_file,
    )


def _pool(args: argparse.Namespace, checker: FileChecker, n_files: int) -> Here:
    """Choose who checks."""
    if args.dask is not None:
        return Cluster(checker, args.dask)
    n_processes = min(args.jobs, n_files)
    return Here(checker) if n_processes == 1 else Processes(checker, n_processes)


def _summarize(results: Results, files: MotionFiles, stream) -> None:
    """Print the last line."""
    outcomes = [results.outcomes[number] for number in sorted(results.outcomes)]
    text = summary_text(outcomes, results.n_missing)
    others = files.n_left_out
    more = f"; {others} with other endings left out" if others else ""
    say(f"{text}{more}.", stream)


def exit_code(outcomes: Collection[FileResult], named: Collection[str]) -> int:
    """Decide what the command ends with.

    Args:
        outcomes: Of all files.
        named: Names of those that were named one by one: these have to be motions.
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
    args = parse(own_arguments())
    try:
        code = check(args)
    except (G1DescriptionError, OSError) as error:
        notify(str(error))
        code = MISUSE
    sys.exit(code)
