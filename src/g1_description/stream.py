"""A stream of configurations to a running robot, at a rate of simulated time.

Published: motion (g1_description/RobotTrajectory)
"""

from __future__ import annotations

from typing import Any

import rosgraph
import rospy

from g1_description.api import Robot
from g1_description.errors import InvalidValueError
from g1_description.msg import RobotTrajectory
from g1_description.robot.arrays import JointValues
from g1_description.ros.lifecycle import no_master
from g1_description.ros.parameters import (
    DESCRIPTION,
    read_robot,
    wait_for_parameter,
)
from g1_description.ros.waiting import NoAnswerError, wait_until

TIMEOUT = 10.0
"""Longest wait for the robot and its clock, in [s]: they may be starting."""

POLL = 0.001
"""Time between two looks at the clock, in [s]."""

QUEUE_SIZE = 10
"""Configurations that a slow connection may hold back; the bridge keeps as many."""


class Stream:
    """Shows one configuration after another, base and joints together.

    The program becomes a node, unless it is one. In ``hold`` physics motors follow the
    joints, and the base is left to physics.
    """

    def __init__(
        self,
        rate: float = 50.0,
        robot: Robot | None = None,
        namespace: str = "",
        timeout: float = TIMEOUT,
    ) -> None:
        """Wait until the robot takes motions and its time runs.

        Args:
            rate: Configurations per second of simulated time, in [Hz].
            robot: The robot; None: that of the parameter robot_description in the
                namespace or above it, with the profile of the launch.
            namespace: Namespace of its topics; empty: the node's.
            timeout: Longest wait, in [s].

        Raises:
            InvalidValueError: If the rate is not positive.
            NoAnswerError: If there is no such robot, or its time stands still.
            DescriptionError: If the robot's description cannot be read.
        """
        if not 0.0 < rate < float("inf"):
            raise InvalidValueError(f"rate must be greater than 0 Hz (got {rate:g}).")
        if not rosgraph.is_master_online():
            raise NoAnswerError(no_master())
        if not rospy.core.is_initialized():
            rospy.init_node("stream", anonymous=True)
        namespace = namespace.strip("/")
        self.robot = robot or _described(namespace, timeout)
        """The robot, which makes the messages."""
        topic = f"/{namespace}/motion" if namespace else "motion"
        self._publisher = rospy.Publisher(
            topic, RobotTrajectory, queue_size=QUEUE_SIZE, tcp_nodelay=True
        )
        self._timeout = timeout
        if not wait_until(self._publisher.get_num_connections, timeout):
            raise NoAnswerError(
                f"Nothing subscribes to {self._publisher.resolved_name} within "
                f"{timeout:g} s; is display.launch running?"
            )
        begin = rospy.Time.now()  # 0 before the first message on /clock
        if not wait_until(lambda: rospy.Time.now() > begin, timeout):
            raise _standing_still(begin)
        self._period = rospy.Duration.from_sec(1.0 / rate)
        self._next = rospy.Time.now()

    def __enter__(self) -> Stream:
        """Return this stream, for a with statement."""
        return self

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        """Close the stream; after an error, without a wait."""
        if error is None:
            self.close()
        else:
            self._publisher.unregister()

    def send(self, positions: JointValues | None = None, base: Any = None) -> float:
        """Wait for the next period, and show a configuration.

        Args:
            positions: Positions of all joints as an array, or of some as a
                dictionary, in [rad] or [m]; other joints stay.
            base: Pose of the base link in the map, shape (7,); None: it stays.

        Returns:
            The simulated time at which it was sent, in [s].

        Raises:
            G1DescriptionError: If positions or base are invalid, or time stands still;
                nothing is sent then.
            ROSInterruptException: If the node is shut down.
        """
        message = self.robot.to_message(positions, base)
        now = self._wait_for_period()
        for part in (message.joint_trajectory, message.multi_dof_joint_trajectory):
            part.header.stamp = now
        self._publisher.publish(message)
        return now.to_sec()

    def close(self) -> None:
        """Let the last configuration last a period, and disconnect.

        Raises:
            NoAnswerError: If time stands still.
        """
        try:
            if not rospy.is_shutdown():
                self._wait_for_period()
        finally:
            self._publisher.unregister()

    def _wait_for_period(self) -> rospy.Time:
        """Wait for the next period, and return the time; begin again after a jump.

        Raises:
            NoAnswerError: If time stands still.
        """
        begin = rospy.Time.now()

        def is_due() -> bool:
            return not begin <= rospy.Time.now() < self._next

        while not wait_until(is_due, self._timeout, None, POLL):
            if rospy.Time.now() == begin:
                raise _standing_still(begin)
            begin = rospy.Time.now()
        now = rospy.Time.now()
        is_late = not self._next - self._period < now < self._next + self._period
        self._next = (now if is_late else self._next) + self._period
        return now


def _standing_still(now: rospy.Time) -> NoAnswerError:
    """Return the error of a clock that does not advance."""
    why = "does a simulator publish /clock?"
    if now:
        why = "is the simulator running and unpaused?"
    return NoAnswerError(f"Simulated time stands still at {now.to_sec():g} s; {why}")


def _described(namespace: str, timeout: float) -> Robot:
    """Read the robot of a namespace.

    Raises:
        NoAnswerError: If there is none.
    """
    found = wait_for_parameter(DESCRIPTION, namespace, lambda: None, timeout)
    if found is None:
        begin = f"/{namespace}" if namespace else rospy.get_namespace()
        raise NoAnswerError(
            f"There is no parameter {DESCRIPTION} in {begin} or above it within "
            f"{timeout:g} s; is display.launch running?"
        )
    return Robot(read_robot(found))
