"""The node ``interactive``: poses the robot with interactive markers in RViz.

Topics: those of markers.InteractiveMarkers
Parameters: those of InteractiveParameters
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import rospy

from g1_description.collisions.find_pairs import collisions_of
from g1_description.errors import G1DescriptionError
from g1_description.ros.lifecycle import start_node
from g1_description.ros.parameters import check_files, read_parameters
from g1_description.ros.robot_view import RobotView

MISSING = (
    "Interactive markers need the package interactive_markers. Install "
    "ros-noetic-interactive-markers on Ubuntu, python3-interactive-markers on Debian; "
    "everything else works without it."
)


@dataclass(frozen=True)
class InteractiveParameters:
    """Parameters of the node ``interactive``.

    One without a docstring is an argument of launch files, whose ``doc`` describes it.
    """

    collisions: str = ""

    def __post_init__(self) -> None:
        """Check the file."""
        check_files(self, "collisions")


def main() -> None:
    """Run the node ``interactive``."""
    start_node("interactive")
    try:
        from g1_description.interactive.markers import InteractiveMarkers
    except ModuleNotFoundError as error:
        if error.name != "interactive_markers":
            raise
        rospy.logfatal("%s", MISSING)
        sys.exit(1)
    try:
        parameters = read_parameters(InteractiveParameters)
        file = Path(parameters.collisions) if parameters.collisions else None
        namespace = rospy.get_namespace().strip("/")
        robot = RobotView(namespace, lambda text: rospy.loginfo("%s", text))
        shapes = partial(collisions_of, robot.description, file)
        InteractiveMarkers(robot, shapes).run()
    except G1DescriptionError as error:
        rospy.logfatal("%s", error)
        sys.exit(1)
    except rospy.ROSInterruptException:  # shut down while waiting
        return
