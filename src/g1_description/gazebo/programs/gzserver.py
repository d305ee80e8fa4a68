"""gzserver's command line, with which launch files for Gazebo start the simulator."""

from __future__ import annotations

import argparse
import logging
import os
from pathlib import Path
from xml.etree import ElementTree

import rospy

from g1_description.choices import ENGINES
from g1_description.command_line import Ignored, OneSentenceParser, own_arguments
from g1_description.files.model_files import (
    RESOURCE_PATH,
    resource_folders,
    share_folder,
)
from g1_description.gazebo.programs import gzclient

PHYSICS = {
    **dict.fromkeys(("ode", "bullet", "dart", "simbody", "mujoco"), "limp"),
    **{name: name for name in ("kinematic", "hold", "limp")},
}
"""Physics by engine: with all of Gazebo's engines, and MuJoCo, robots have no
motors."""

EMPTY_WORLD = "worlds/empty.world"
"""Name of Gazebo's default world, which needs no file here."""

IGNORED_FLAGS = (
    ("--lockstep",),
    ("-r", "--record"),
    ("--record_resources",),
    ("--minimal_comms",),
    ("--headless",),  # passed by our empty_world.launch
)
IGNORED_OPTIONS = (
    ("-p", "--play"),
    ("--record_encoding",),
    ("--record_path",),
    ("--record_period",),
    ("--record_filter",),
    ("--seed",),
    ("--initial_sim_time",),
    ("--iters",),
    ("-s", "--server-plugin"),
    ("-g", "--gui-plugin"),
    ("--gui-client-plugin",),
    ("-o", "--profile"),
)


def parser() -> OneSentenceParser:
    """Make a parser of gzserver's arguments."""
    made = OneSentenceParser(
        prog="gzserver",
        description="Run the simulator in place of Gazebo. Options of gzserver without "
        "help are ignored, with a log message.",
    )
    manifest = ElementTree.parse(share_folder() / "package.xml")
    version = f"g1_description {manifest.findtext('version')}, a stand-in for Gazebo 11"
    made.set_defaults(ignored=[])
    made.add_argument("world", nargs="*", help="world file (SDF)")
    made.add_argument("-v", "--version", action="version", version=version)
    made.add_argument("-u", "--pause", action="store_true", help="start paused")
    made.add_argument("--verbose", action="store_true", help="accepted")
    made.add_argument(
        "-e",
        "--physics",
        choices=PHYSICS,
        default="ode",
        help="all engines of Gazebo mean limp: robots without motors; mujoco: limp "
        "with --engine mujoco",
    )
    made.add_argument(
        "--engine", choices=ENGINES, help="physics engine of the stand-in (bullet)"
    )
    for names in IGNORED_FLAGS:
        made.add_argument(*names, dest="ignored", action=Ignored, nargs=0)
    for names in IGNORED_OPTIONS:
        made.add_argument(*names, dest="ignored", action=Ignored, metavar="VALUE")
    return made


def find_world(name: str) -> str:
    """Find a world file: from the working directory, then the resource path.

    Args:
        name: Path, or name below a folder of GAZEBO_RESOURCE_PATH or one that a
            package exports.

    Returns:
        Absolute path; empty for the empty world.

    Raises:
        argparse.ArgumentTypeError: If there is no such file.
    """
    if not name:
        return ""
    # Other packages have such a file, too; Gazebo's own folder has precedence.
    folders = () if name == EMPTY_WORLD else resource_folders()
    for folder in ["", *folders]:
        path = Path(folder, name)
        if path.is_file():
            return str(path.resolve())
    if name == EMPTY_WORLD:
        return ""
    raise argparse.ArgumentTypeError(
        f"no world file {name} in {Path.cwd()}, "
        f"below {RESOURCE_PATH} ({os.environ.get(RESOURCE_PATH) or 'empty'}) "
        "or in the folders that packages export"
    )


def parse(arguments: list[str]) -> tuple[dict, list[str]]:
    """Read a command line; exit on an error.

    Args:
        arguments: Arguments of gzserver, without ROS remappings.

    Returns:
        Values of parameters, and the ignored arguments.
    """
    reader = parser()
    args = reader.parse_intermixed_args(arguments)
    world, *others = args.world or [""]
    given = {"physics": PHYSICS[args.physics]}
    engine = args.engine or ("mujoco" if args.physics == "mujoco" else "")
    if engine:
        given["engine"] = engine
    try:
        given["world"] = find_world(world)
    except argparse.ArgumentTypeError as error:
        reader.error(str(error))
    if args.pause:
        given["paused"] = True
    return given, args.ignored + others


def main(client: bool = False, debug: bool = False) -> None:
    """Run the node ``gazebo`` with gzserver's arguments.

    Args:
        client: Whether to open a window, too, if there is a screen.
        debug: Whether to log debug messages too.
    """
    given, ignored = parse(own_arguments())
    # Imported late: PyBullet is slow to load, and --help does not need it.
    from g1_description.gazebo.node import main as run

    def on_start():
        if debug:
            logging.getLogger("rosout").setLevel(logging.DEBUG)
        if ignored:
            rospy.loginfo("Ignored gzserver options: %s.", ", ".join(ignored))
        if client:
            gzclient.open_beside()

    run(given, on_start)
