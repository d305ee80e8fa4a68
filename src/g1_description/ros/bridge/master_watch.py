"""The bridge and the master: stay registered, and find who else publishes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import rospy

from g1_description.ros.node.master import stay_registered
from g1_description.ros.node.throttled_log import ThrottledLog

from .robot import BridgedRobot

PERIOD = 1.0
"""Time between two looks in [s] of wall time."""


class MasterWatch:
    """Asks the master for the state of the graph, in a thread of its own.

    The master may take long to answer, or be gone.
    """

    def __init__(self, robots: Sequence[BridgedRobot], log: ThrottledLog) -> None:
        """Prepare.

        Args:
            robots: Robots whose status gets the other publishers.
            log: Where to log new ones.
        """
        self._robots, self._log = robots, log

    def start(self) -> None:
        """Begin, until the node is shut down."""
        stay_registered(self._find_other_publishers, PERIOD)

    def _find_other_publishers(self, publishers: Mapping[str, list[str]]) -> None:
        """Find other nodes that publish the robots' joint states; log new ones."""
        own = rospy.get_name()
        clocks = publishers.get("/clock", ())
        for robot in self._robots:
            found = publishers.get(robot.topic, ())
            others = tuple(node for node in found if node != own)
            new = [node for node in others if node not in robot.status.other_publishers]
            robot.status.other_publishers = others
            for node in new:
                what = f"/clock and {robot.topic}" if node in clocks else robot.topic
                self._log.warn(
                    f"publisher {node} {robot.topic}",
                    f"{node} also publishes {what}: readers get both. To look at a "
                    "bag, end this launch and use "
                    "roslaunch g1_description view.launch.",
                )
