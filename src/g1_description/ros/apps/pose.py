"""A command that puts a robot into a named pose, lists poses or saves one."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import rosgraph

from g1_description.core.cli import OneSentenceParser, number, say
from g1_description.core.errors import G1DescriptionError, PoseFileError
from g1_description.core.poses.pose import (
    ZERO,
    Pose,
    check_pose,
    find_pose,
    pose_positions,
)
from g1_description.core.poses.store import (
    package_file,
    read_file,
    read_poses,
    save_pose,
    user_file,
)
from g1_description.core.poses.yaml_text import check_name
from g1_description.ros.node.lifecycle import own_arguments, start_node
from g1_description.ros.node.waiting import NoAnswerError

from .posed_robot import PosedRobot
from .robot_options import add_namespace

DIGITS = 6
"""Decimals of the positions that are saved."""


def parser() -> OneSentenceParser:
    """Make a parser of the command's arguments."""
    made = OneSentenceParser(
        prog="pose",
        description="Move a robot to a named pose, list the poses, or save one.",
    )
    what = made.add_mutually_exclusive_group(required=True)
    what.add_argument("name", nargs="?", metavar="NAME", help="pose to go to")
    what.add_argument("--list", action="store_true", help="list all poses")
    what.add_argument("--save", metavar="NAME", help="save the current pose")
    made.add_argument(
        "--seconds",
        type=number,
        default=0.0,
        help="duration of a smooth motion in seconds of simulated time; default: 0, "
        "set the joints at once",
    )
    add_namespace(made)
    made.add_argument(
        "--file", type=Path, help=f"file of your own poses; default: {user_file()}"
    )
    made.add_argument(
        "--force", action="store_true", help="replace a saved pose of that name"
    )
    made.add_argument("--about", default="", help="description of the saved pose")
    return made


def parse(arguments: list[str]) -> argparse.Namespace:
    """Read a command line; end the program when it is wrong."""
    reader = parser()
    args = reader.parse_args(arguments)
    if args.seconds < 0.0:
        reader.error("argument --seconds: time does not go back")
    if (args.force or args.about) and args.save is None:
        reader.error("--force and --about go with --save")
    if args.save == ZERO:
        reader.error(f"argument --save: every robot has {ZERO}, choose another name")
    return args


def list_poses(args: argparse.Namespace) -> None:
    """Print a line for each pose."""
    poses = read_poses(args.file)
    width = max(map(len, poses), default=0)
    for pose in poses.values():
        print(f"{pose.name:{width}}  {pose.about or pose.place}")


def go(args: argparse.Namespace) -> None:
    """Move the robot to a pose.

    Raises:
        G1DescriptionError: If there is no such pose, or it does not get there.
    """
    pose = find_pose(args.name, read_poses(args.file))
    robot = _connect(args)
    check_pose(pose, robot.description)
    goal = pose_positions(pose, robot.description)
    if args.seconds:
        robot.move(goal, args.seconds)
    else:
        robot.teleport(goal)
    print(f"pose: {pose.name}")


def save(args: argparse.Namespace) -> None:
    """Save the robot's current pose.

    Raises:
        G1DescriptionError: If there is one of that name, or it cannot be saved.
    """
    file = (args.file or user_file()).expanduser()
    check_name(args.save)
    known = read_file(package_file())
    if file.exists():
        known.update(read_file(file))
    if args.save in known and not args.force:
        raise PoseFileError(
            f"There is a pose '{args.save}' in {known[args.save].place} already; "
            "--force saves yours, which is used instead."
        )
    robot = _connect(args)
    joints = robot.description.movable_joints
    rounded = {
        joint.name: min(max(round(position, DIGITS), joint.lower), joint.upper)
        for joint, position in zip(joints, robot.measured_positions().tolist())
    }
    nonzero = {name: position for name, position in rounded.items() if position}
    save_pose(Pose(args.save, nonzero, args.about), file)
    print(f"pose: {args.save} is saved in {file}")


def _connect(args: argparse.Namespace) -> PosedRobot:
    """Start the node and find the robot."""

    def notify(line):
        say(f"pose: {line}")

    try:
        start_node("pose", anonymous=True, disable_rosout=True)
        return PosedRobot(args.namespace, notify)
    except (OSError, rosgraph.MasterException) as error:
        raise NoAnswerError(f"The master is gone: {error}.") from error


def main() -> None:
    """Run the command, or exit with a message."""
    args = parse(own_arguments())
    act = list_poses if args.list else go if args.save is None else save
    try:
        act(args)
    except G1DescriptionError as error:
        sys.exit(f"pose: {error}")
