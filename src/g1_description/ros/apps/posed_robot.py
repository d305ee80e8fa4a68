"""A robot that is moved through the bridge.

Publishes: joint_commands (sensor_msgs/JointState)
Subscribes: joint_states (sensor_msgs/JointState)
All timeouts are wall time: simulated time may stand still.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import rospy
from sensor_msgs.msg import JointState

from g1_description.core.poses.minimum_jerk import minimum_jerk
from g1_description.core.text import listed
from g1_description.ros.node.lifecycle import quiet_when_closing

from .robot_view import STANDS_STILL, NoAnswerError, RobotView

TIMEOUT = 30.0
"""Longest wait for the bridge, or for its effect, in [s]: machines may be busy."""

RESEND_PERIOD = 1.0
"""Time after which a goal is sent again, in [s]."""

COMMAND_PERIOD = 0.01
"""Least time between two commands of a motion, in [s] of the robot's time."""

TOLERANCE = 0.01
"""Largest distance of a joint from its goal, in [rad] or [m]: motors give way."""


class PosedRobot(RobotView):
    """The robot behind joint_states and joint_commands of a namespace."""

    def __init__(self, namespace: str, notify: Callable[[str], None]) -> None:
        """Connect.

        Args:
            namespace: Of the robot's topics, without slashes around; empty: the
                node's.
            notify: Takes messages about what is waited for.

        Raises:
            DescriptionError: If there is no description, or it is not one.
        """
        super().__init__(namespace, notify)
        self._names = [joint.name for joint in self.description.movable_joints]
        self._commands = rospy.Publisher(
            f"{self._prefix}joint_commands", JointState, queue_size=10, tcp_nodelay=True
        )

    def measured_positions(self) -> np.ndarray:
        """Return where the joints are now.

        Returns:
            Positions in [rad] or [m] inside the limits, in the order of the movable
            joints, shape (n_joints,).

        Raises:
            NoAnswerError: If joints are not measured.
        """
        return self._inside(self._next(None))

    def teleport(self, goal: np.ndarray) -> None:
        """Set all joints, and wait until joint_states shows it.

        Args:
            goal: Positions in [rad] or [m], shape (n_joints,).

        Raises:
            NoAnswerError: If nobody listens, or it does not happen.
        """
        self._wait_for_listener()
        self._arrive(goal)

    def move(self, goal: np.ndarray, seconds: float) -> None:
        """Move all joints from where they are, beginning and ending at rest.

        Args:
            goal: Positions in [rad] or [m], shape (n_joints,).
            seconds: How long, in [s] of the robot's time.

        Raises:
            NoAnswerError: If nobody listens, time goes back, or it does not happen.
        """
        self._wait_for_listener()
        first = message = self._next(None)
        start, begin = self._inside(first), first.header.stamp
        share = 0.0
        while share < 1.0:
            message = self._next(message.header.stamp, timeout=None)
            if message.header.stamp < begin:
                raise NoAnswerError("Time went back on the way; the robot was reset.")
            share = (message.header.stamp - begin).to_sec() / seconds
            if share < 1.0:
                self._publish(minimum_jerk(start, goal, share))
        self._arrive(goal)

    def _publish(self, positions: np.ndarray) -> None:
        """Send a command."""
        message = JointState(name=self._names, position=positions.tolist())
        message.header.stamp = rospy.Time.now()
        with quiet_when_closing():
            self._commands.publish(message)

    def _arrive(self, goal: np.ndarray) -> None:
        """Send the goal, once a second, until the joints are there."""
        self.forget_newest()
        sent = -np.inf

        def is_there():
            nonlocal sent
            if time.monotonic() >= sent + RESEND_PERIOD:
                self._publish(goal)
                sent = time.monotonic()
            return self.newest and not self._away(goal)

        if self.wait_until(is_there, TIMEOUT):
            return
        if self.newest is None:
            raise NoAnswerError(f"The command is sent, but {self.silence}")
        reason = f"; {STANDS_STILL}" if self.stands_still else ""
        raise NoAnswerError(
            f"After {TIMEOUT:g} s {self.topic} still has "
            f"{listed(self._away(goal))}{reason}."
        )

    def _away(self, goal: np.ndarray) -> list[str]:
        """List the joints that are not at the goal, and where they are."""
        shown = dict(zip(self.newest.name, self.newest.position))
        return [
            f"{name} at {shown[name]:g} instead of {position:g}"
            if name in shown
            else f"no {name}"
            for name, position in zip(self._names, goal)
            if not abs(shown.get(name, np.inf) - position) <= TOLERANCE
        ]

    def _inside(self, message: JointState) -> np.ndarray:
        """Read a message's positions, clamped to the limits."""
        shown = dict(zip(message.name, message.position))
        missing = [name for name in self._names if name not in shown]
        if missing:
            raise NoAnswerError(f"{self.topic} has no position of {listed(missing)}.")
        joints = self.description.movable_joints
        return np.array(
            [min(max(shown[j.name], j.lower), j.upper) for j in joints], dtype=float
        )

    def _wait_for_listener(self) -> None:
        """Wait until the bridge hears commands."""
        if not self.wait_until(self._commands.get_num_connections, TIMEOUT):
            raise NoAnswerError(
                f"Nobody listens to {self._commands.resolved_name}; is the bridge "
                "running?"
            )

    def _next(self, after, timeout: float | None = TIMEOUT) -> JointState:
        """Wait for joint states.

        Args:
            after: Stamp of a message; the next is later by at least
                ``COMMAND_PERIOD``, or earlier. None: any message will do.
            timeout: Longest wait in [s]; None: no limit.
        """

        def is_next():
            if self.newest is None or after is None:
                return self.newest is not None
            step = (self.newest.header.stamp - after).to_sec()
            return step >= COMMAND_PERIOD or step < 0.0

        if not self.wait_until(is_next, timeout):
            raise NoAnswerError(f"The robot's positions are unknown: {self.silence}")
        return self.newest
