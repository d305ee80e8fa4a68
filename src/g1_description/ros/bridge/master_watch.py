"""The bridge and the master: stay registered, and find who else publishes."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Sequence

import rosgraph
import rospy

from g1_description.ros.node.master import restore_connections
from g1_description.ros.node.slave_api import SLAVE_API_ERRORS
from g1_description.ros.node.throttled_log import ThrottledLog

from .robot import BridgedRobot

PERIOD = 0.5
"""Time between two calls of the master in [s] of wall time."""


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
        self._stopped = threading.Event()

    def start(self) -> None:
        """Begin, until the node is shut down."""
        rospy.on_shutdown(self._stopped.set)
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        """Register where the master does not know this node; look for others."""
        while not self._stopped.wait(PERIOD):
            # Without a master, or with one that is starting, the next time will do.
            with contextlib.suppress(*SLAVE_API_ERRORS, rosgraph.MasterException):
                state = rosgraph.Master(rospy.get_name()).getSystemState()
                if rospy.core.is_shutdown_requested():
                    return
                if restore_connections(state):
                    rospy.loginfo("The master did not know this node; it does now.")
                self._find_other_publishers(dict(state[0]))

    def _find_other_publishers(self, publishers: dict[str, list[str]]) -> None:
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
