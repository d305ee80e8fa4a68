"""Parameters of the node ``checker``: names, defaults, ranges."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import rospy

from g1_description.checks.thresholds import Thresholds
from g1_description.checks.thresholds_file import read_thresholds
from g1_description.robot.assembly import WORLD, base_of
from g1_description.robot.description import Description
from g1_description.ros.parameters import (
    check_files,
    check_prefix,
    check_range,
    read_robot,
    wait_for_parameter,
)
from g1_description.scenes.scene import Scene


@dataclass(frozen=True)
class CheckerParameters:
    """Parameters of the node ``checker``.

    One without a docstring is an argument of launch files, whose ``doc`` describes it.
    """

    robot_description: str = "robot_description"
    """Name of the parameter with the URDF; searched for upward from the
    namespace."""

    frame_prefix: str = ""

    map_frame: str = "map"
    """Frame of the floor, which is at z = 0."""

    gazebo: str = "/gazebo"
    """Namespace of the simulator, whose objects are around the robot."""

    scene: str = ""

    thresholds: str = ""

    collisions: str = ""

    visual_hulls: bool = True
    """Use the convex hulls of visual shapes for links without collision shapes."""

    rate: float = 30.0
    """Maximum check rate in wall time; 0: services only, in [Hz]."""

    limit_margin: float = 0.05
    """Distance to a limit below which a joint is marked in RViz, but at most a tenth
    of its range, in [rad, m]."""

    def __post_init__(self) -> None:
        """Check ranges."""
        check_range(self, "rate", 0.0, 1000.0)
        check_range(self, "limit_margin", 0.0, 10.0)
        check_prefix("~frame_prefix", self.frame_prefix)
        check_files(self, "scene", "thresholds", "collisions")

    def read_scene(self) -> Scene | None:
        """Read the scene; None without one.

        Raises:
            G1DescriptionError: If the file cannot be read.
        """
        return Scene.read(self.scene) if self.scene else None

    def read_thresholds(self) -> Thresholds:
        """Read the thresholds.

        Raises:
            ThresholdError: If the file cannot be read.
        """
        return read_thresholds(Path(self.thresholds) if self.thresholds else None)


def base_frame(robot: Description, parameters: CheckerParameters) -> str:
    """Return the frame of the robot's base; the map if it is fixed to the world."""
    base = base_of(robot)[0]
    return parameters.map_frame if base == WORLD else parameters.frame_prefix + base


def wait_for_robot(parameters: CheckerParameters) -> Description:
    """Wait until the robot's description is on the parameter server.

    Raises:
        DescriptionError: If the parameter is not a robot.
        ROSInterruptException: If the node is shut down.
    """
    name = parameters.robot_description

    def log() -> None:
        space = rospy.get_namespace()
        rospy.loginfo("Waiting for the parameter %s, from %s upward.", name, space)

    found = wait_for_parameter(name, rospy.get_namespace().strip("/"), log)
    return read_robot(found)
