"""The command why, which explains why a robot fell."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import rosgraph

from g1_description.bridge.history import last_bag, written
from g1_description.checks.checker import Checker
from g1_description.checks.first_cause import failure_text
from g1_description.choices import DEFAULT
from g1_description.cli.options import MODEL, namespace
from g1_description.command_line import (
    argument,
    exit_with_error,
    option,
    own_arguments,
    parse,
    positive,
    say,
)
from g1_description.errors import G1DescriptionError
from g1_description.motion.files.history_bag import read_history
from g1_description.motion.history import CommandStream
from g1_description.motion.history_chunks import Stretch
from g1_description.robot.description import Description
from g1_description.robot.load import read_description
from g1_description.ros.history import fetch_commands, fetch_history
from g1_description.ros.lifecycle import start_node
from g1_description.ros.robot_view import wait_for_description


@dataclass(frozen=True)
class WhyOptions:
    """Explain why a robot fell, or why a joint strayed from its command.

    The exit code is 0 if nothing failed, and 1 if something did.
    """

    file: Path | None = argument(
        "a rosbag with joint_states, such as last.bag", Path, nargs="?", metavar="BAG"
    )
    seconds: float = option(
        "time before the end that is looked at [s]", 60.0, positive(3600.0)
    )
    namespace: str = namespace()
    model: str = option(f"the robot of a rosbag: {MODEL}", DEFAULT)


def why(args: WhyOptions) -> int:
    """Explain the last failure; return the exit code.

    Raises:
        G1DescriptionError: If there is no history.
    """
    if args.file is None and rosgraph.is_master_online():
        robot, states, commands = _running(args)
    else:
        file = args.file or last_bag(args.namespace)
        reason = "no ROS master runs; " if args.file is None else ""
        when = f", written at {written(file)}" if file.is_file() else ""
        say(f"why: {reason}reading {file}{when}.", sys.stderr)
        robot = read_description(args.model)
        states, commands = read_history(file, robot, args.seconds)
    found = Checker(robot).explain(states, commands)
    print(failure_text(found, states))
    return 0 if found is None else 1


def _running(
    args: WhyOptions,
) -> tuple[Description, Stretch, Sequence[CommandStream]]:
    """Ask the bridge of a running robot."""
    start_node("why", anonymous=True, disable_rosout=True)
    robot = wait_for_description(
        args.namespace, lambda text: say(f"why: {text}", sys.stderr)
    )
    states, _ = fetch_history(args.seconds, args.namespace)
    return robot, states, fetch_commands(args.seconds, args.namespace)


def main() -> None:
    """Run the command, or exit with a message."""
    try:
        sys.exit(why(parse(WhyOptions, "why", own_arguments())))
    except (G1DescriptionError, OSError) as error:
        exit_with_error("why", error)
