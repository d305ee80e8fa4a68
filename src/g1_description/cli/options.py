"""Options that several commands share."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from g1_description.choices import DEFAULT
from g1_description.command_line import MAX_FPS, argument, option, positive, say, within
from g1_description.text import similar_first

if TYPE_CHECKING:
    from g1_description.scenes.scene import Scene

NAME = re.compile(r"[A-Za-z]\w*(/\w+)*", re.ASCII)
"""A ROS name without leading and trailing slashes. rosgraph's pattern cannot be
imported, as doctor must run without ROS."""

MODEL = "a profile, or a URDF or xacro file, as for model:= of the launch files"


def name(text: str) -> str:
    """Read a namespace without its slashes."""
    found = text.strip("/")
    if found and not NAME.fullmatch(found):
        raise argparse.ArgumentTypeError(f"'{text}' is not a valid ROS name")
    return found


def namespace() -> Any:
    """Declare the namespace of a running robot."""
    return option("namespace of the robot's topics", "", name)


def model() -> Any:
    """Declare the robot of motions in files."""
    return option(f"the robot: {MODEL}", DEFAULT, str, see="[robots](robots.md)")


def collisions() -> Any:
    """Declare the file of allowed collisions."""
    return option(
        "file of allowed collisions, as written by collision_pairs",
        None,
        Path,
        metavar="YAML",
        shown="that of the robot's profile, or what is found",
        see="[allowed pairs](self_collision.md#allowed-pairs)",
    )


def scene() -> Any:
    """Declare the file of the objects around the robot."""
    return option(
        "objects around the robot: YAML, or an SDF model or world",
        None,
        Path,
        metavar="FILE",
        shown="NAME.scene.yaml next to a single motion NAME.*, if it is there",
        see="[scenes](scenes.md)",
    )


def scene_of(given: Path | None, motions: Sequence[Path]) -> Scene | None:
    """Read the scene of ``scene``, and warn of ignored parts; None if there is none.

    Raises:
        SceneError: If it cannot be read.
    """
    # Only where it is needed: doctor must run without what reads files.
    from g1_description.motion.paths import split
    from g1_description.scenes.scene import Scene
    from g1_description.scenes.scene_file import scene_next_to

    if given is None and len(motions) == 1:
        given = scene_next_to(split(motions[0])[0])
    if given is None:
        return None
    scene = Scene.read(given)
    for note in scene.notes:
        say(f"{given}: {note}.", sys.stderr)
    return scene


def motion_file(text: str) -> Path:
    """Read the name of a motion; those of this package need no folder."""
    # Only where it is given: doctor must run without what finds files.
    from g1_description.errors import G1DescriptionError
    from g1_description.motion.paths import motion_path

    try:
        path = motion_path(text)
        if path.name == text and path.is_absolute():
            say(f"{text} is not in this folder; using {path}.", sys.stderr)
        return path
    except G1DescriptionError as error:
        raise argparse.ArgumentTypeError(str(error).rstrip(".")) from error


def motions() -> Any:
    """Declare the motions that a command takes."""
    return argument(
        "a motion, FILE#NAME for one of several in a file, or a folder with motions "
        "below it",
        motion_file,
        nargs="+",
        metavar="FILE",
    )


def jobs() -> Any:
    """Declare the number of processes."""
    return option("number of worker processes", 1, within(1, 256, int), metavar="N")


def anchor() -> Any:
    """Declare the link that stays at its place while joints move."""
    return option(
        "link that stays at its place meanwhile, or lowest_foot; the base follows; in "
        "kinematic only",
        None,
        str,
        metavar="LINK",
        see="[anchors](poses.md#an-anchor)",
    )


def fps() -> Any:
    """Declare the sampling rate of files without times."""
    about = "samples per second of files without times"
    shown = "that in the file's name, or the usual one of its format"
    return option(about, None, positive(MAX_FPS), shown=shown)


def order() -> Any:
    """Declare the order of quaternions in files."""
    return option(
        "order of the base's quaternions in the file",
        None,
        str,
        choices=("xyzw", "wxyz"),
        shown="that of the format, or by the feet of the standing robot",
        see="[what a file does not say](motion_formats.md#what-a-file-does-not-say)",
    )


def input_joint_order() -> Any:
    """Declare the order of joints in files that do not name them."""
    return option(
        "order of the joints in files that do not name them: mujoco, that of the "
        "robot's file, or isaaclab, breadth first",
        None,
        str,
        choices=("mujoco", "isaaclab"),
        shown="that of the format",
        see="[what a file does not say](motion_formats.md#what-a-file-does-not-say)",
    )


def file_format() -> Any:
    """Declare the format of files."""
    return option(
        "format of the file",
        None,
        _format,
        metavar="NAME",
        shown="by its content",
        see="[formats](motion_formats.md#which-format-is-it)",
    )


def _format(text: str) -> str:
    """Read the name of a format."""
    # Only where it is given: doctor must run without what reads files.
    from g1_description.motion.files.formats import FORMATS

    if text in FORMATS:
        return text
    known = ", ".join(similar_first(text, FORMATS))
    raise argparse.ArgumentTypeError(f"unknown format '{text}'; formats: {known}")


def topic() -> Any:
    """Declare the topic of a bag."""
    return option(
        "topic of the joints in a rosbag or MCAP file",
        None,
        str,
        shown="joint_states, or what the bag has",
        see="[rosbags](motions.md#rosbags)",
    )


def selection() -> Any:
    """Declare the choice of motions of a folder."""
    return option(
        "take only the motions that this file keeps",
        None,
        Path,
        metavar="YAML",
        see="[selections](many_motions.md#a-selection)",
    )


def thresholds() -> Any:
    """Declare the file of thresholds."""
    return option(
        "file of thresholds",
        None,
        Path,
        metavar="YAML",
        shown="config/checks.yaml",
        see="[thresholds](checks.md#your-own-thresholds)",
    )
