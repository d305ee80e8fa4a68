"""The node that shows the robots of a bridge in a browser.

Parameters: those of parameters.WebParameters
Topics and services: those of live_robot and live_simulator
"""

from __future__ import annotations

import sys
import threading

import rospy

from g1_description.core.errors import G1DescriptionError
from g1_description.ros.bridge.parameters import wait_for_descriptions
from g1_description.ros.node.lifecycle import at_shutdown, start_node
from g1_description.ros.node.master import stay_registered
from g1_description.ros.node.parameters import read_parameters
from g1_description.sim.checks.checker import Checker
from g1_description.web.show import Show, tell_address

from .live_robot import LiveRobot
from .live_simulator import LiveSimulator
from .live_world import LiveWorld
from .parameters import WebParameters


def make_show(parameters: WebParameters) -> Show:
    """Wait for the robots, and open the page.

    Raises:
        G1DescriptionError: If the page cannot be opened, or there is no such robot.
        ROSInterruptException: If the node is shut down.
    """
    changed = threading.Event()
    robots = [
        LiveRobot(robot, description, parameters.map_frame, changed)
        for robot, description in wait_for_descriptions(parameters.each_robot)
    ]
    simulator = LiveSimulator(parameters.gazebo) if parameters.gazebo else None
    world = LiveWorld(robots, simulator, changed, parameters.ghost, parameters.controls)
    thresholds = parameters.read_thresholds()
    return Show(
        world,
        parameters.server,
        lambda robot: Checker.of(robot, thresholds),
        thresholds.floor_height,
    )


def main() -> None:
    """Run the node ``web``."""
    start_node("web")
    try:
        parameters = read_parameters(WebParameters)
        show = make_show(parameters)
    except G1DescriptionError as error:
        rospy.logfatal("%s", error)
        sys.exit(1)
    except rospy.ROSInterruptException:  # before the robots were there
        return
    at_shutdown(show.stop)
    stay_registered()
    tell_address(show, parameters.server, lambda text: rospy.loginfo("%s", text))
    show.run()
