"""Gazebo's window: opens RViz if there is a screen."""

from __future__ import annotations

import os
import subprocess
import sys

import rospy

from g1_description.command_line import Ignored, OneSentenceParser, own_arguments
from g1_description.files.model_files import share_folder
from g1_description.ros.lifecycle import at_shutdown, start_node

NODE = "gazebo_gui"


def parser() -> OneSentenceParser:
    """Make a parser of gzclient's arguments, which are all ignored."""
    made = OneSentenceParser(
        prog="gzclient", description="Open RViz if there is a screen."
    )
    made.set_defaults(ignored=[])
    made.add_argument("--verbose", action="store_true", help="accepted")
    for names in (("-g", "--gui-plugin"), ("--gui-client-plugin",)):
        made.add_argument(*names, dest="ignored", action=Ignored, metavar="VALUE")
    return made


def rviz() -> list[str]:
    """Return the command that opens RViz with the robot."""
    return ["rviz", "-d", str(share_folder() / "rviz" / "g1.rviz")]


def has_screen() -> bool:
    """Return whether there is a screen to open a window on."""
    return bool(os.environ.get("DISPLAY"))


def open_beside() -> None:
    """Open the window next to this node, and close it with the node."""
    if not has_screen():
        rospy.loginfo("No screen (DISPLAY is not set): RViz is not started.")
        return
    window = subprocess.Popen([*rviz(), f"__name:={NODE}"])
    at_shutdown(window.terminate)


def main() -> None:
    """Become RViz; without a screen, wait for the shutdown."""
    ignored = parser().parse_args(own_arguments()).ignored
    if has_screen():
        remappings = [word for word in sys.argv[1:] if ":=" in word]
        try:
            os.execvp("rviz", [*rviz(), f"__name:={NODE}", *remappings])
        except OSError as error:
            sys.exit(f"gzclient: cannot start rviz: {error.strerror}.")
    start_node(NODE)
    note = f" Ignored options: {', '.join(ignored)}." if ignored else ""
    rospy.loginfo("No screen (DISPLAY is not set): RViz is not started.%s", note)
    rospy.spin()
