"""Parameters of the node that checks configurations: names, defaults, ranges."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import rospy

from g1_description.checks.thresholds import Thresholds
from g1_description.checks.thresholds_file import read_thresholds
from g1_description.errors import InvalidValueError
from g1_description.robot.assembly import WORLD, base_of
from g1_description.robot.description import Description
from g1_description.robot.urdf import parse_urdf
from g1_description.ros.parameters import check_range, wait_for_parameter


@dataclass(frozen=True)
class CheckerParameters:
    """Parameters of the node ``checker``."""

    robot_description: str = "robot_description"
    """Parameter that holds the robot's URDF; searched for upward from the namespace."""

    frame_prefix: str = ""
    """What stands before the names of the robot's frames."""

    map_frame: str = "map"
    """Frame whose floor the robot stands on."""

    thresholds: str = ""
    """File of thresholds; empty: config/checks.yaml."""

    pairs: str = ""
    """File of the pairs of links that may touch by design; empty: that of the G1, and
    for a robot with other links pairs that are found at the start."""

    visual_hulls: bool = True
    """Whether links without collision shapes have the hulls of their visual ones."""

    rate: float = 30.0
    """Most checks of the robot per second, in [Hz] of wall time; 0: never, there are
    only services."""

    limit_margin: float = 0.05
    """A joint this near to a limit is marked, in [rad] or [m]; of a joint with a small
    range a tenth of the range."""

    def __post_init__(self) -> None:
        """Check ranges."""
        check_range(self, "rate", 0.0, 1000.0)
        check_range(self, "limit_margin", 0.0, 10.0)
        prefix = self.frame_prefix
        if prefix and (prefix.startswith("/") or not prefix.endswith("/")):
            raise InvalidValueError(
                f"~frame_prefix is '{prefix}', it must end with a slash, not begin "
                "with one."
            )
        for name in ("thresholds", "pairs"):
            file = getattr(self, name)
            if file and not Path(file).is_absolute():
                raise InvalidValueError(
                    f"~{name} is '{file}', which is not an absolute path."
                )

    def read_thresholds(self) -> Thresholds:
        """Read the thresholds.

        Raises:
            ThresholdError: If a file cannot be read.
        """
        return read_thresholds(Path(self.thresholds) if self.thresholds else None)


def base_frame(robot: Description, parameters: CheckerParameters) -> str:
    """Name the frame of the robot's base; one that is the world is the map."""
    base = base_of(robot)[0]
    return parameters.map_frame if base == WORLD else parameters.frame_prefix + base


def wait_for_robot(parameters: CheckerParameters) -> Description:
    """Wait until the robot's description is on the parameter server.

    Raises:
        DescriptionError: If the parameter holds no robot.
        ROSInterruptException: If the node is shut down.
    """
    name = parameters.robot_description

    def log() -> None:
        space = rospy.get_namespace()
        rospy.loginfo("Waiting for the parameter %s, from %s upward.", name, space)

    found = wait_for_parameter(name, rospy.get_namespace().strip("/"), log)
    return parse_urdf(str(rospy.get_param(found)))
