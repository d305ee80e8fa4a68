"""The node ``base`` of view.launch: places a robot that nothing else places.

Broadcasts: static FRAME -> base_link -> the robot's root, as the bridge does
Parameters: those of BaseParameters, and robot_description
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
import rospy
import tf2_ros

from g1_description.bridge.parameters import BridgeParameters, base_child
from g1_description.errors import G1DescriptionError
from g1_description.robot.description import Description
from g1_description.robot.rotation import from_rpy
from g1_description.robot.transform import IDENTITY
from g1_description.ros.conversions import transform
from g1_description.ros.lifecycle import start_node
from g1_description.ros.parameters import find_parameter, read_parameters, read_robot

DESCRIPTION = "robot_description"


@dataclass(frozen=True)
class BaseParameters:
    """Parameters of the node that places a robot."""

    base: str = ""
    """Pose as X Y Z YAW PITCH ROLL in [m] and [rad], or with a quaternion x y z w."""

    frame: str = "map"
    """Frame of the pose."""

    root: str = ""
    """Frame that is placed; empty: base_link, above the robot's root link."""


def static_base(
    parameters: BaseParameters, robot: Description
) -> list[tuple[str, str, np.ndarray]]:
    """List the static transforms: parent, child and pose, shape (7,)."""
    numbers = np.array([float(word) for word in parameters.base.split()])
    turn = numbers[3:] if len(numbers) == 7 else from_rpy(numbers[:2:-1])
    pose = np.concatenate([numbers[:3], turn])
    if parameters.root:
        return [(parameters.frame, parameters.root, pose)]
    base = base_child(BridgeParameters(), robot) or robot.root
    found = [(parameters.frame, base, pose)]
    return found if base == robot.root else [*found, (base, robot.root, IDENTITY)]


def main() -> None:
    """Run the node ``base``."""
    start_node("base")
    try:
        parameters = read_parameters(BaseParameters)
        robot = read_robot(find_parameter(DESCRIPTION) or DESCRIPTION)
    except G1DescriptionError as error:
        rospy.logfatal("%s", error)
        sys.exit(1)
    now = rospy.Time()
    broadcaster = tf2_ros.StaticTransformBroadcaster()
    broadcaster.sendTransform(
        [
            transform(now, parent, child, pose.tolist())
            for parent, child, pose in static_base(parameters, robot)
        ]
    )
    rospy.spin()
