"""A command that judges motions in files.

It needs ROS to read rosbags, but neither a master nor a screen.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Collection, Iterator
from contextlib import closing

from g1_description.checks.batch import Judge, Setup, Task, judged_here
from g1_description.checks.cluster import Cluster
from g1_description.checks.processes import Workers
from g1_description.checks.report import (
    NO_MOTION,
    NOT_CHECKED,
    NOT_READ,
    Outcome,
    summary_text,
)
from g1_description.checks.thresholds import read_thresholds
from g1_description.checks.verdict import FAILED
from g1_description.cli.check_options import MISUSE, STDOUT, parse
from g1_description.cli.check_reports import Reports, Results
from g1_description.cli.motion_paths import MotionFiles, motion_files
from g1_description.cli.start import INTERRUPTED
from g1_description.command_line import say
from g1_description.errors import ClusterError, G1DescriptionError
from g1_description.files.model_files import share_folder
from g1_description.motion.files.read_any import read_motion_file
from g1_description.motion.motors import g1_motors
from g1_description.robot.load import absolute_urdf
from g1_description.ros.lifecycle import own_arguments

G1 = "urdf/g1_29dof.urdf"
"""The robot where none is given, in the package's folder."""


def notify(text: str) -> None:
    """Print a message."""
    say(f"check: {text}", sys.stderr)


def setup_of(args: argparse.Namespace) -> Setup:
    """Read the robot, and how it is judged.

    Raises:
        G1DescriptionError: If a file that is named is not what it should be.
    """
    share = share_folder()
    motors = g1_motors() if args.physics else None
    return Setup(
        urdf=absolute_urdf(args.model or str(share / G1)),
        thresholds=read_thresholds(args.thresholds),
        only=args.only,
        pairs=args.collisions,
        visual_hulls=not args.no_visual_hulls,
        fixed_base=args.fixed_base,
        physics=args.physics,
        motors=motors,
        plot=bool(args.plot or args.html),
        rate=args.fps,
        topic=args.topic,
    )


def check(args: argparse.Namespace) -> int:
    """Check motions; return the exit code.

    Raises:
        G1DescriptionError: If nothing can be checked.
        KeyboardInterrupt: If it is interrupted before anything is done.
    """
    files = motion_files(args.files)
    reports = Reports(args, files.tasks)
    setup = setup_of(args)
    judge = Judge(setup)  # here, so that its errors are told at once
    is_free = STDOUT not in (args.json, args.csv)
    stream = sys.stdout if is_free and not args.quiet else None
    code = INTERRUPTED
    with closing(Results(len(files.tasks), stream)) as results:
        try:
            with closing(_judged(args, judge, setup, files.tasks)) as found:
                for task, outcome in found:
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


def _judged(
    args: argparse.Namespace, judge: Judge, setup: Setup, tasks: tuple[Task, ...]
) -> Iterator[tuple[Task, Outcome]]:
    """Judge files, in one of the ways that there are."""
    if args.dask is not None:
        with closing(Cluster(setup, judge, read_motion_file, args.dask)) as cluster:
            yield from cluster.judged(tasks)
        return
    if min(args.jobs, len(tasks)) == 1:
        yield from judged_here(judge, tasks, read_motion_file)
        return
    with closing(Workers(setup, read_motion_file, args.jobs)) as workers:
        yield from workers.judged(tasks)


def _summarize(results: Results, files: MotionFiles, stream) -> None:
    """Print the last line."""
    outcomes = [results.outcomes[number] for number in sorted(results.outcomes)]
    text = summary_text(outcomes, results.n_missing)
    others = files.n_left_out
    more = f"; {others} with other endings left out" if others else ""
    say(f"{text}{more}.", stream)


def exit_code(outcomes: Collection[Outcome], named: Collection[str]) -> int:
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
