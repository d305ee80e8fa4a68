"""What RViz shows of a robot beside the robot itself."""

from __future__ import annotations

from g1_description.core.bridge.estimator import Observation
from g1_description.core.robot.assembly import base_of
from g1_description.core.robot.description import Description
from g1_description.ros.bridge.parameters import (
    BridgeParameters,
    RobotParameters,
    topic_of,
)
from g1_description.ros.node.lifecycle import quiet_when_closing

from .ghost import Ghost
from .player import MotionPlayer
from .trails import Trails


class Extras:
    """The paths of links, and where the robot is wanted; both off by default."""

    def __init__(
        self,
        robot: RobotParameters,
        parameters: BridgeParameters,
        description: Description,
        player: MotionPlayer,
    ) -> None:
        """Advertise what is wanted.

        Args:
            robot: The robot's names.
            parameters: What is wanted.
            description: The robot.
            player: What knows where the robot is wanted.
        """
        p = parameters
        self._player = player
        self._trails = self._ghost = None
        if p.trails.split():
            topic = topic_of(robot, "trails")
            self._trails = Trails(topic, p.trails.split(), description, p.map_frame)
        if p.ghost:
            root, _ = base_of(description)
            topic = topic_of(robot, "commanded_joint_states")
            self._ghost = Ghost(topic, robot.frame_prefix + root, p.map_frame)
        player.keeps_commands = p.ghost
        self.are_wanted = bool(self._trails or self._ghost)
        """Whether there is any."""

    def show(self, time_ns: int, seen: Observation) -> None:
        """Show what belongs to a state of the robot, at its time in [ns]."""
        with quiet_when_closing():
            if self._trails:
                self._trails.add(time_ns, seen)
            if self._ghost:
                self._ghost.show(time_ns, seen, self._player)

    def reset(self) -> None:
        """Begin again, as time did."""
        if self._trails:
            self._trails.reset()
        if self._ghost:
            self._ghost.reset()
