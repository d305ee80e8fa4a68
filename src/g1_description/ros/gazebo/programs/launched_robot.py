"""The command that a launch file loads the robot with.

roslaunch runs it while it reads the file, before any node: so it checks the other
arguments too, and that no node is there yet whose name one of the file has. Files that
have no robot run it for these checks alone.
"""

from __future__ import annotations

import argparse
import os
import socket
import sys
from pathlib import Path
from xmlrpc.client import Error, ServerProxy

import rosgraph.names

from g1_description.core.cli import OneSentenceParser
from g1_description.core.errors import (
    G1DescriptionError,
    InvalidValueError,
    UnknownNameError,
)
from g1_description.core.files.absolute_urdf import read_absolute
from g1_description.core.files.launch_arguments import (
    check_arguments,
    check_for_empty,
    given_to_own_file,
    is_own_file,
    words_of_parent,
)
from g1_description.core.poses.pose import ZERO, check_pose, find_pose
from g1_description.core.poses.store import read_poses
from g1_description.core.robot.description import Description, check_trails
from g1_description.core.text import listed, similar_first

TIMEOUT = 2.0
"""Longest wait in [s] for an answer of the master, or of a node."""


def launched_robot(model: str | None, given: dict[str, str], nodes: list[str]) -> str:
    """Read the robot, and check the other launch arguments.

    Args:
        model: The model, as for ``read_model``; None: there is none.
        given: Other arguments of the launch file, by name.
        nodes: Nodes of the launch file that must not run yet.

    Returns:
        URDF text with absolute mesh URIs; empty without a model.

    Raises:
        G1DescriptionError: If there is no such robot, a value is wrong, or one of the
            nodes runs.
    """
    if model is not None and not model.strip():
        raise InvalidValueError("model is empty; a URDF or xacro file is wanted.")
    words = words_of_parent()
    check_for_empty({"model": model or "", **given}, words)
    given = {**given_to_own_file(words), **given}
    check_arguments(given)
    if "host" in given:
        _check_host(given["host"])
    for node in nodes:
        _check_for_node(node, words)
    if model is None:
        return ""
    robot = read_absolute(model)
    _check_pose(given.get("initial_pose", ZERO), robot.description)
    check_trails(given.get("trails", "").split(), [robot.description])
    root = given.get("root")
    if given.get("base") and root not in robot.description.link_names:
        raise UnknownNameError(
            f"root is '{root}', but the links are "
            f"{listed(similar_first(str(root), robot.description.link_names))}."
        )
    return robot.text


def _check_host(host: str) -> None:
    """Check that the browser view can listen there."""
    try:
        address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(address[0], socket.SOCK_STREAM) as listener:
            listener.bind(address[4])
    except OSError as error:
        raise InvalidValueError(
            f"host is '{host}', where this machine cannot listen: {error}."
        ) from error


def _check_for_node(name: str, words: list[str]) -> None:
    """Check that a node does not run yet: the master would end it, and others with it.

    Args:
        name: Its name. What is no full name may be in any namespace where the launch
            file is not of this package, and is not looked for.
        words: Command line of what reads the file. rostest has a master of its own, and
            so has roslaunch with the option -p.
    """
    if not any(Path(word).name == "roslaunch" for word in words[:2]):
        return
    if not name.startswith("/") and not is_own_file(words):
        return
    name = rosgraph.names.resolve_name(name, rosgraph.names.get_ros_namespace())
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
    except (OSError, ValueError, Error):  # no master, or a node that died
        return
    finally:
        socket.setdefaulttimeout(timeout)
    raise InvalidValueError(
        f"A node {name} runs at {uri} already. End it, or take a master of your own: "
        "roslaunch -p 11411."
    )


def _check_pose(name: str, description: Description) -> None:
    """Check that there is a pose that suits the robot."""
    if name != ZERO:
        check_pose(find_pose(name, read_poses()), description)


def _argument(text: str) -> tuple[str, str]:
    """Read NAME=VALUE."""
    name, equals, value = text.partition("=")
    if not equals:
        raise argparse.ArgumentTypeError(f"'{text}' is not NAME=VALUE")
    return name, value


def main() -> None:
    """Print the robot, or say what is wrong."""
    parser = OneSentenceParser(
        description="Print a robot with absolute mesh URIs, for the parameter "
        "robot_description. The file stays as it is."
    )
    parser.add_argument(
        "model",
        nargs="?",
        help="URDF or xacro file, or package://PACKAGE/FILE; its meshes may be "
        "relative; for xacro with arguments in the same word: 'FILE NAME=VALUE'",
    )
    parser.add_argument(
        "--check",
        nargs="*",
        type=_argument,
        default=[],
        metavar="NAME=VALUE",
        help="other arguments of a launch file, to be checked",
    )
    parser.add_argument(
        "--alone",
        nargs="*",
        default=[],
        metavar="NODE",
        help="nodes of a launch file that must not run yet",
    )
    args = parser.parse_args()
    try:
        text = launched_robot(args.model, dict(args.check), args.alone)
    except G1DescriptionError as error:
        sys.exit(str(error))
    sys.stdout.buffer.write(text.encode("utf-8") + b"\n")
