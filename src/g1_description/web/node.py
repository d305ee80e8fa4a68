"""The node that shows the robots of a bridge in a browser.

Parameters: those of WebParameters
Topics and services: those of live_robot, live_scene and live_simulator
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rospy

from g1_description.bridge.parameters import (
    BridgeParameters,
    RobotParameters,
    wait_for_descriptions,
)
from g1_description.checks.checker import Checker
from g1_description.checks.thresholds import Thresholds
from g1_description.checks.thresholds_file import read_thresholds
from g1_description.collisions.find_pairs import collisions_of
from g1_description.errors import G1DescriptionError, MotionError
from g1_description.motion.edit import minimum_jerk_trajectory
from g1_description.motion.files.formats import read_motion
from g1_description.motion.files.source import ReadOptions
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description
from g1_description.ros.lifecycle import at_shutdown, start_node
from g1_description.ros.log import ThrottledLog
from g1_description.ros.parameters import check_files, read_parameters
from g1_description.ros.playing import Session
from g1_description.web.live_robot import LiveRobot
from g1_description.web.live_scene import LiveScene
from g1_description.web.live_simulator import LiveSimulator
from g1_description.web.page import Page, report_address
from g1_description.web.server.address import ServerOptions


@dataclass(frozen=True)
class WebParameters:
    """Parameters of the node ``web``.

    One without a docstring is an argument of launch files, whose ``doc`` describes it.
    """

    host: str = "127.0.0.1"

    port: int = 8080

    token: str = ""
    """The token; empty: a new one at each start. Anyone who can reach the master can
    read it."""

    read_only: bool = False

    controls: bool = True

    gazebo: str = "/gazebo"

    robot_description: str = "robot_description"
    """Parameter that holds the robot's URDF; searched for upward from the
    namespace."""

    model_name: str = "g1_robot"
    """Name of the robot on the page."""

    frame_prefix: str = ""

    robots: tuple[dict, ...] = ()

    map_frame: str = "map"

    collisions: str = ""

    thresholds: str = ""

    def __post_init__(self) -> None:
        """Check files."""
        check_files(self, "thresholds", "collisions")

    @property
    def each_robot(self) -> tuple[RobotParameters, ...]:
        """The robots to show."""
        bridge = BridgeParameters(
            model_name=self.model_name,
            robot_description=self.robot_description,
            frame_prefix=self.frame_prefix,
            robots=self.robots,
        )
        return bridge.each_robot

    @property
    def server(self) -> ServerOptions:
        """Address, access and token of the page."""
        return ServerOptions(
            self.host, self.port, read_only=self.read_only, token=self.token
        )

    def read_thresholds(self) -> Thresholds:
        """Read the thresholds.

        Raises:
            ThresholdError: If a file cannot be read.
        """
        return read_thresholds(Path(self.thresholds) if self.thresholds else None)


class LiveWorld:
    """The running robots and simulator."""

    def __init__(
        self,
        robots: Sequence[LiveRobot],
        simulator: LiveSimulator | None,
        changed: threading.Event,
        can_move: bool,
    ) -> None:
        self.robots, self.simulator, self.changed = robots, simulator, changed
        self.can_move = can_move
        self._log = ThrottledLog()
        self.scenes = [
            LiveScene(one, changed, self._log, robots) for one in (simulator,) if one
        ]
        self._players: dict[LiveRobot, LivePlayer] = {}

    can_arrange, has_commanded = False, True

    def arrange(self, beside: bool) -> None:
        """Do nothing: robots are shown at their positions."""

    def watch(self, is_watched: bool) -> None:
        """Subscribe while the page is open."""
        if self.simulator is not None:
            self.simulator.watch(is_watched)
        for scene in self.scenes:
            scene.watch(is_watched)
        for robot in self.robots:
            if is_watched:
                robot.watch(self._log)
            else:
                robot.ignore()

    def tick(self) -> None:
        """Do nothing: messages set ``changed``."""

    def read(self, path: Path, robot: LiveRobot, rate: float | None) -> Motion:
        """Read a motion from a file of any format."""
        return read_motion(path, robot.description, ReadOptions(rate))

    def open(
        self, robot: LiveRobot, motion: Motion, at: float | None = None
    ) -> LivePlayer:
        """Set the motion of a robot; it does not move yet."""
        self._players[robot] = LivePlayer(robot, motion)
        return self._players[robot]

    def move(
        self, robot: LiveRobot, positions: Mapping[str, float], seconds: float
    ) -> None:
        """Move joints from their current positions, from rest to rest."""
        state = robot.state()
        if robot in self._players:
            self._players[robot].give_way()
        if not seconds:
            robot.command(positions)
            return
        missing = [n for n in positions if state is None or n not in state.names]
        if missing:
            raise MotionError(
                f"Cannot move smoothly: no state of {missing[0]} has been received yet."
            )
        now = state.positions_by_name
        begin = np.array([now[name] for name in positions])
        goal = np.array([*positions.values()])
        robot.motions.play(minimum_jerk_trajectory([*positions], begin, goal, seconds))


class LivePlayer(Session):
    """A motion that a robot's bridge plays."""

    def __init__(self, robot: LiveRobot, motion: Motion) -> None:
        super().__init__(robot, motion, 1.0, rospy.loginfo)

    def give_way(self) -> None:
        """Become paused, as another command moves the robot."""
        self._time, self.is_running = self.time, False

    def play(self, begin: float, speed: float) -> None:
        """Play from a time, in [s], at a speed relative to simulated time."""
        self.speed = speed
        self.start(begin)


def make_page(parameters: WebParameters) -> Page:
    """Wait for the robots, and open the page.

    Raises:
        G1DescriptionError: If the page cannot be opened, or a robot is invalid.
        ROSInterruptException: If the node is shut down.
    """
    changed = threading.Event()
    simulator = LiveSimulator(parameters.gazebo) if parameters.gazebo else None
    robots = [
        LiveRobot(robot, description, parameters.map_frame, changed, simulator)
        for robot, description in wait_for_descriptions(parameters.each_robot)
    ]
    world = LiveWorld(robots, simulator, changed, parameters.controls)
    thresholds = parameters.read_thresholds()
    file = Path(parameters.collisions) if parameters.collisions else None

    def make_checker(robot: Description) -> Checker:
        return Checker(robot, thresholds, collisions=collisions_of(robot, file))

    return Page(world, parameters.server, make_checker)


def main() -> None:
    """Run the node ``web``."""
    start_node("web")
    try:
        parameters = read_parameters(WebParameters)
        page = make_page(parameters)
    except G1DescriptionError as error:
        rospy.logfatal("%s", error)
        sys.exit(1)
    except rospy.ROSInterruptException:  # while waiting for the robots
        return
    at_shutdown(page.stop)
    report_address(page, parameters.server, lambda text: rospy.loginfo("%s", text))
    page.run()
