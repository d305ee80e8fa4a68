"""The node ``checker``: checks configurations, motions and the current state.

Services: ~check_state (g1_description/CheckState), ~check_trajectory
    (g1_description/CheckTrajectory), ~solve_ik (g1_description/SolveIK)
Subscribes, with a ~rate: robot_state (g1_description/RobotState); without a publisher
    of that, joint_states (sensor_msgs/JointState), /tf, /tf_static (tf2_msgs/TFMessage)
Publishes, with a ~rate: /diagnostics (diagnostic_msgs/DiagnosticArray), ~markers
    (visualization_msgs/MarkerArray)
Parameters: those of parameters.CheckerParameters
"""

from __future__ import annotations

import sys
import threading
from functools import partial
from pathlib import Path

import rospy

from g1_description.checker.live import LiveChecks
from g1_description.checker.markers import LiveMarkers
from g1_description.checker.parameters import (
    CheckerParameters,
    base_frame,
    wait_for_robot,
)
from g1_description.checker.services import CheckServices, IkService
from g1_description.checks.checker import Checker
from g1_description.collisions.find_pairs import collisions_of
from g1_description.collisions.self_collisions import SelfCollisions
from g1_description.errors import G1DescriptionError
from g1_description.robot.description import Description
from g1_description.ros.lifecycle import start_node
from g1_description.ros.log import ThrottledLog
from g1_description.ros.map_frame import MapFrame
from g1_description.ros.parameters import read_parameters
from g1_description.ros.robot_states import RobotStates
from g1_description.ros.rospy_tcp import serve_as_roscpp


def make_collisions(
    robot: Description, parameters: CheckerParameters
) -> SelfCollisions:
    """Prepare the self-collisions of the robot.

    Raises:
        G1DescriptionError: If a file cannot be read.
    """
    file = Path(parameters.collisions) if parameters.collisions else None
    return collisions_of(robot, file, parameters.visual_hulls)


def make_checker(robot: Description, parameters: CheckerParameters) -> Checker:
    """Create the checks of the robot.

    Raises:
        G1DescriptionError: If a file cannot be read.
    """
    collisions = make_collisions(robot, parameters)
    return Checker(robot, parameters.read_thresholds(), collisions=collisions)


def start(robot: Description, parameters: CheckerParameters) -> None:
    """Advertise services and topics.

    Raises:
        G1DescriptionError: If a file cannot be read.
    """
    checker, lock = make_checker(robot, parameters), threading.Lock()
    for note in checker.notes:
        rospy.loginfo("%s", note)
    make_another = partial(make_checker, robot, parameters)
    map_frame = parameters.map_frame
    frame = MapFrame((map_frame, "world"))
    CheckServices(checker, lock, make_another, frame)
    live: LiveChecks | None = None
    if parameters.rate:
        markers = LiveMarkers(checker, parameters)
        root = base_frame(robot, parameters)
        states = RobotStates(map_frame, root, 1.0 / parameters.rate, ThrottledLog())
        live = LiveChecks(checker, lock, states, markers, parameters.rate)
    make_shapes = partial(make_collisions, robot, parameters)
    IkService(robot, make_shapes, lambda: live and live.newest, frame)


def main() -> None:
    """Run the node ``checker``."""
    serve_as_roscpp()
    start_node("checker")
    try:
        parameters = read_parameters(CheckerParameters)
        start(wait_for_robot(parameters), parameters)
    except G1DescriptionError as error:
        rospy.logfatal("%s", error)
        sys.exit(1)
    except rospy.ROSInterruptException:  # shut down while waiting
        return
    rospy.spin()
