"""The robots of a bridge, and the simulator behind it, as a page shows them."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import rospy

from g1_description.core.errors import MotionError
from g1_description.core.motion.motion import Motion
from g1_description.core.poses.minimum_jerk import minimum_jerk_trajectory
from g1_description.ros.apps.motions.session import Session
from g1_description.ros.motion.files.read import read_motion_file
from g1_description.ros.node.throttled_log import ThrottledLog

from .live_robot import LiveRobot
from .live_simulator import LiveSimulator


class LiveWorld:
    """All that a page shows of what runs."""

    def __init__(
        self,
        robots: Sequence[LiveRobot],
        simulator: LiveSimulator | None,
        changed: threading.Event,
        with_ghost: bool,
        can_move: bool,
    ) -> None:
        """Begin without listening.

        Args:
            robots: All robots.
            simulator: The simulator; None: there is none.
            changed: What robots set when they have moved.
            with_ghost: Whether it is published where robots are wanted.
            can_move: Whether anybody takes commands.
        """
        self.robots, self.simulator, self.changed = robots, simulator, changed
        self.can_move = can_move
        self.has_wanted = with_ghost
        self._log = ThrottledLog()
        self._players: dict[LiveRobot, LivePlayer] = {}

    can_arrange = False

    def arrange(self, beside: bool) -> None:
        """Do nothing: robots are where they are."""

    def watch(self, is_watched: bool) -> None:
        """Begin to listen, or stop: nobody looks."""
        if self.simulator is not None:
            self.simulator.watch(is_watched)
        for robot in self.robots:
            if is_watched:
                robot.watch(self._log, self.has_wanted)
            else:
                robot.ignore()

    def tick(self) -> None:
        """Do nothing: what moves says so."""

    def read(self, path: Path, robot: LiveRobot, rate: float | None) -> Motion:
        """Read a motion from a file of any format."""
        return read_motion_file(path, robot.description, rate)

    def open(self, robot: LiveRobot, motion: Motion) -> LivePlayer:
        """Let a robot have a motion; it does not move yet."""
        self._players[robot] = LivePlayer(robot, motion)
        return self._players[robot]

    def move(
        self, robot: LiveRobot, positions: Mapping[str, float], seconds: float
    ) -> None:
        """Move joints from where they are, beginning and ending at rest."""
        state = robot.state()
        if robot in self._players:
            self._players[robot].give_way()
        if not seconds:
            robot.command(positions)
            return
        missing = [n for n in positions if state is None or n not in state.positions]
        if missing:
            raise MotionError(f"Nothing is known of {missing[0]} yet: no smooth way.")
        begin = np.array([state.positions[name] for name in positions])
        goal = np.array([*positions.values()])
        robot.motions.play(minimum_jerk_trajectory([*positions], begin, goal, seconds))


class LivePlayer(Session):
    """A motion that a robot's bridge plays."""

    def __init__(self, robot: LiveRobot, motion: Motion) -> None:
        """Prepare; the robot does nothing yet."""
        super().__init__(robot, motion.trajectory, 1.0, rospy.loginfo)

    def give_way(self) -> None:
        """Count as paused: something else moves the robot."""
        self._time, self.is_running = self.time, False

    def play(self, begin: float, speed: float) -> None:
        """Play from a time on, in [s], at so many seconds of it in a second."""
        self.speed = speed
        self.start(begin)
