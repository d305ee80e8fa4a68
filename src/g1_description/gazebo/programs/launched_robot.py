"""The command with which a launch file loads the robot.

roslaunch runs it before any node. So it also checks the other arguments, and that none
of the file's nodes is running. Files without a robot run it for these checks alone.
"""

from __future__ import annotations

import argparse
import os
import posixpath
import socket
import sys
from dataclasses import replace
from http.client import HTTPException
from pathlib import Path
from xml.parsers.expat import ExpatError
from xmlrpc.client import Error, ServerProxy

from g1_description.choices import DEFAULT, ZERO
from g1_description.command_line import OneSentenceParser
from g1_description.errors import (
    G1DescriptionError,
    InvalidValueError,
    UnknownNameError,
)
from g1_description.robot.description import Description
from g1_description.robot.launch_arguments import (
    FEET,
    LOWEST_FOOT,
    check_arguments,
    check_for_empty,
    check_trails,
    given_to_own_file,
    own_file,
    words_of_parent,
)
from g1_description.robot.load import read_absolute
from g1_description.robot.poses import check_pose, find_pose, read_poses
from g1_description.robot.profile import find_profile
from g1_description.robot.urdf import as_version_1_0
from g1_description.scenes.scene import Scene
from g1_description.text import listed, similar_first

SWITCHED = (("web", "web"), ("checker", "checks"), ("interactive", "interactive"))
"""Nodes that an argument of a launch file enables, and the arguments."""

QUESTIONS = frozenset(
    ("--nodes", "--files", "--args", "--ros-args", "--dump-params", "--find-node")
)
"""Options with which roslaunch starts no nodes."""

TIMEOUT = 2.0
"""Longest wait in [s] for an answer of the master, or of a node."""


def launched_robot(model: str | None, given: dict[str, str], nodes: list[str]) -> str:
    """Read the robot, and check the other launch arguments, with the scene.

    Args:
        model: The model, as for ``read_model``; empty: that of the profile ``robot``;
            None: no model.
        given: Other arguments of the launch file, by name.
        nodes: Nodes of the launch file, which must not be running.

    Returns:
        URDF 1.0 with absolute mesh URIs; empty without a model.

    Raises:
        G1DescriptionError: If the robot, the scene or a value is invalid, or one of the
            nodes is running.
    """
    words = words_of_parent()
    usual = given.get("robot") or DEFAULT
    check_for_empty({**given, "robot": usual, "model": model or usual}, words)
    given = {**given_to_own_file(words), **given}
    check_arguments(given)
    if given.get("scene"):
        Scene.read(given["scene"])
    text = "" if model is None else _checked_text(model.strip() or usual, given)
    on = ("true", "1")  # as roslaunch writes it
    switched = [n for n, switch in SWITCHED if given.get(switch, "").lower() in on]
    for node in (*nodes, *switched):  # after the arguments, which are wrong anyway
        _check_for_node(node, words)
    return text


def _checked_text(model: str, given: dict[str, str]) -> str:
    """Read the robot, and check the arguments that depend on it; return its URDF.

    Raises:
        G1DescriptionError: If the robot or a value is invalid.
    """
    found = read_absolute(model)
    robot = found.description
    if given.get("robot"):
        robot = replace(robot, given_profile=find_profile(given["robot"]))
    robot = replace(robot, given_profile=robot.profile)  # a wrong one ends the launch
    pose = given.get("initial_pose", ZERO)
    if pose != ZERO:
        check_pose(find_pose(pose, read_poses(robot)), robot)
    check_trails("trails", given.get("trails", "").split(), [robot])
    anchor = given.get("anchor", "")
    if anchor not in ("", LOWEST_FOOT):
        check_trails("anchor", [anchor], [robot])
    if anchor == LOWEST_FOOT and not any(role in robot.profile.links for role in FEET):
        raise UnknownNameError(
            f"anchor:={anchor} needs a robot whose profile has feet, unlike "
            f"{robot.name}; name a link instead."
        )
    if given.get("base") and given.get("root"):
        _check_root(given["root"], robot)
    for message in robot.unread:
        print(f"{robot.name}: {message}", file=sys.stderr)
    return as_version_1_0(found.text)


def _check_for_node(name: str, words: list[str]) -> None:
    """Check that a node is not running: roslaunch would replace it."""
    is_launched = any(Path(word).name == "roslaunch" for word in words[:2])
    if not is_launched or QUESTIONS.intersection(words):
        return
    if not name.startswith("/") and own_file(words) is None:
        return
    name = posixpath.join("/", os.environ.get("ROS_NAMESPACE", ""), name)
    options = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    options.add_argument("-p", "--port")
    port = options.parse_known_args(words)[0].port
    uri = f"http://localhost:{port}" if port else os.environ.get("ROS_MASTER_URI", "")
    caller = "/launched_robot"
    timeout = socket.getdefaulttimeout()
    socket.setdefaulttimeout(TIMEOUT)
    try:
        code, _, node = ServerProxy(uri).lookupNode(caller, name)
        if code != 1:
            return
        ServerProxy(node).getPid(caller)
    except (OSError, ValueError, Error, HTTPException, ExpatError):
        return  # no master, or a node that died
    finally:
        socket.setdefaulttimeout(timeout)
    raise InvalidValueError(
        f"A node {name} is already running at {uri}. Stop it, or use another master: "
        "roslaunch -p 11411 ..."
    )


def _check_root(frame: str, description: Description) -> None:
    """Check that a frame, with or without a prefix, is one of the robot's links."""
    links, name = description.link_names, frame.rpartition("/")[2]
    if name not in links:
        near = listed(similar_first(name, links))
        raise UnknownNameError(
            f"root must be a link of the robot (got '{frame}'); links are {near}."
        )


def _argument(text: str) -> tuple[str, str]:
    """Read NAME=VALUE."""
    name, equals, value = text.partition("=")
    if not equals:
        raise argparse.ArgumentTypeError(f"'{text}' is not NAME=VALUE")
    return name, value


def main() -> None:
    """Print the robot, or the error."""
    parser = OneSentenceParser(
        description="Print a robot with absolute mesh URIs, for the parameter "
        "robot_description. The file is not changed."
    )
    parser.add_argument(
        "model",
        nargs="?",
        help="a profile, or a URDF or xacro file, or package://PACKAGE/FILE; its "
        "meshes may be relative; for xacro with arguments in the same word: 'FILE "
        "NAME=VALUE'; empty: the default robot",
    )
    parser.add_argument(
        "--check",
        nargs="*",
        type=_argument,
        default=[],
        metavar="NAME=VALUE",
        help="other arguments of a launch file to check",
    )
    parser.add_argument(
        "--alone",
        nargs="*",
        default=[],
        metavar="NODE",
        help="nodes of a launch file that must not be running",
    )
    args = parser.parse_args()
    try:
        text = launched_robot(args.model, dict(args.check), args.alone)
    except G1DescriptionError as error:
        sys.exit(str(error))
    sys.stdout.buffer.write(text.encode("utf-8") + b"\n")
