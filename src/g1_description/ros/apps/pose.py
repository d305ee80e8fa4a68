"""A command that puts a robot into a named pose, lists poses or saves one."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import rosgraph

from g1_description.core.cli import OneSentenceParser, number
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

from .posed_robot import PosedRobot
from .robot_view import NoAnswerError

DIGITS = 6
"""Decimals of the positions that are saved."""


def parser() -> OneSentenceParser:
    """Make a parser of the command's arguments."""
    made = OneSentenceParser(
        prog="pose", description="Put a robot into a named pose, list poses, save one."
    )
    what = made.add_mutually_exclusive_group(required=True)
    what.add_argument("name", nargs="?", metavar="NAME", help="pose to go to")
    what.add_argument("--list", action="store_true", help="tell which poses there are")
    what.add_argument("--save", metavar="NAME", help="keep the present pose")
    made.add_argument(
        "--seconds", type=number, default=0.0, help="move smoothly for so long [s]"
    )
    made.add_argument(
        "--namespace", type=_namespace, default="", help="of the robot's topics"
    )
    made.add_argument(
        "--file", type=Path, help=f"poses besides the package's; else {user_file()}"
    )
    made.add_argument("--force", action="store_true", help="replace a saved pose")
    made.add_argument("--about", default="", help="a line of text for a saved pose")
    return made


def _namespace(text: str) -> str:
    """Read a namespace."""
    name = text.strip("/")
    if name and not rosgraph.names.is_legal_name(name):
        raise argparse.ArgumentTypeError(f"'{text}' is no ROS name")
    return name


def parse(arguments: list[str]) -> argparse.Namespace:
    """Read a command line; end the program when it is wrong."""
    reader = parser()
    asked = reader.parse_args(arguments)
    if asked.seconds < 0.0:
        reader.error("argument --seconds: time does not go back")
    if (asked.force or asked.about) and asked.save is None:
        reader.error("--force and --about go with --save")
    if asked.save == ZERO:
        reader.error(f"argument --save: every robot has {ZERO}, choose another name")
    return asked


def list_poses(asked: argparse.Namespace) -> None:
    """Print a line for each pose."""
    poses = read_poses(asked.file)
    width = max(map(len, poses), default=0)
    for pose in poses.values():
        print(f"{pose.name:{width}}  {pose.about or pose.place}")


def go(asked: argparse.Namespace) -> None:
    """Put the robot into a pose.

    Raises:
        G1DescriptionError: If there is no such pose, or it does not get there.
    """
    pose = find_pose(asked.name, read_poses(asked.file))
    robot = _connect(asked)
    check_pose(pose, robot.description)
    goal = pose_positions(pose, robot.description)
    if asked.seconds:
        robot.move(goal, asked.seconds)
    else:
        robot.teleport(goal)
    print(f"pose: {pose.name}")


def save(asked: argparse.Namespace) -> None:
    """Keep the robot's present pose.

    Raises:
        G1DescriptionError: If there is one of that name, or it cannot be kept.
    """
    file = (asked.file or user_file()).expanduser()
    check_name(asked.save)
    known = read_file(package_file())
    if file.exists():
        known.update(read_file(file))
    if asked.save in known and not asked.force:
        raise PoseFileError(
            f"There is a pose '{asked.save}' in {known[asked.save].place} already; "
            "with --force the one you save wins."
        )
    robot = _connect(asked)
    joints = robot.description.movable_joints
    rounded = {
        joint.name: min(max(round(position, DIGITS), joint.lower), joint.upper)
        for joint, position in zip(joints, robot.measured_positions().tolist())
    }
    told = {name: position for name, position in rounded.items() if position}
    save_pose(Pose(asked.save, told, asked.about), file)
    print(f"pose: {asked.save} is saved in {file}")


def _connect(asked: argparse.Namespace) -> PosedRobot:
    """Start the node and find the robot."""

    def tell(line):
        print(f"pose: {line}", flush=True)

    try:
        start_node("pose", anonymous=True, disable_rosout=True)
        return PosedRobot(asked.namespace, tell)
    except (OSError, rosgraph.MasterException) as error:
        raise NoAnswerError(f"The master is gone: {error}.") from error


def main() -> None:
    """Do what is asked, or say why not."""
    asked = parse(own_arguments())
    act = list_poses if asked.list else go if asked.save is None else save
    try:
        act(asked)
    except G1DescriptionError as error:
        sys.exit(f"pose: {error}")
