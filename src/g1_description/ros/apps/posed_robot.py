"""A robot that is moved through the bridge.

Publishes: joint_commands (sensor_msgs/JointState)
Calls: play_motion (g1_description/PlayMotion)
Subscribes: joint_states (sensor_msgs/JointState)
All timeouts are wall time: simulated time may stand still.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import rospy
from sensor_msgs.msg import JointState

from g1_description.core.poses.minimum_jerk import minimum_jerk_trajectory
from g1_description.core.text import listed
from g1_description.ros.node.lifecycle import quiet_when_closing
from g1_description.ros.node.waiting import NoAnswerError
from g1_description.ros.wire.conversions import stamp_from_ns
from g1_description.srv import PlayMotion

from .motion_client import MotionClient
from .robot_view import STANDS_STILL, RobotView

TIMEOUT = 30.0
"""Longest wait for the bridge, or for its effect, in [s]: machines may be busy."""

QUEUE_SIZE = 10
"""Commands kept for a slow bridge."""

RESEND_PERIOD = 1.0
"""Time after which a goal is sent again, in [s]."""

TOLERANCE = 0.01
"""Largest distance of a joint from its goal, in [rad] or [m]: motors give way."""


class PosedRobot(RobotView):
    """The robot behind joint_states and the topics of commands of a namespace."""

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
            f"{self._prefix}joint_commands",
            JointState,
            queue_size=QUEUE_SIZE,
            tcp_nodelay=True,
        )
        service = rospy.ServiceProxy(f"{self._prefix}play_motion", PlayMotion)
        self._motions = MotionClient(service)
        # While the node can still call: afterwards the robot would go on.
        rospy.core.add_preshutdown_hook(lambda _: self._leave())

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
            NoAnswerError: If that is refused, time goes back, or it does not happen.
        """
        begin = self._next(None)
        way = minimum_jerk_trajectory(self._names, self._inside(begin), goal, seconds)
        start_ns, note = self._motions.play(way)
        if note:
            self._notify(f"{note}.")
        end = stamp_from_ns(start_ns) + rospy.Duration.from_sec(seconds)
        self._wait_for_time(begin.header.stamp, end)
        self._wait_for_goal(goal)

    def _wait_for_time(self, now: rospy.Time, end: rospy.Time) -> None:
        """Wait until the end of a motion; it need not be stopped afterwards."""
        while now < end:
            before, now = now, self._next(now, timeout=None).header.stamp
            if now < before:
                self._motions.may_move = False
                raise NoAnswerError("Time went back on the way; the robot was reset.")
        self._motions.may_move = False

    def _leave(self) -> None:
        """Stop the robot where it is, if it is on its way."""
        try:
            self._motions.leave()
        except NoAnswerError as error:
            self._notify(f"the robot may go on: {error}")

    def _publish(self, positions: np.ndarray) -> None:
        """Send a command."""
        message = JointState(name=self._names, position=positions.tolist())
        message.header.stamp = rospy.Time.now()
        with quiet_when_closing():
            self._commands.publish(message)

    def _arrive(self, goal: np.ndarray) -> None:
        """Send the goal, once a second, until the joints are there."""
        sent = -np.inf

        def send_again():
            nonlocal sent
            if time.monotonic() >= sent + RESEND_PERIOD:
                self._publish(goal)
                sent = time.monotonic()

        self._wait_for_goal(goal, send_again)

    def _wait_for_goal(
        self, goal: np.ndarray, meanwhile: Callable[[], None] = lambda: None
    ) -> None:
        """Wait until the joints are at the goal.

        Args:
            goal: Positions in [rad] or [m], shape (n_joints,).
            meanwhile: Called again and again.

        Raises:
            NoAnswerError: If they do not get there.
        """
        self.forget_newest()

        def is_there():
            meanwhile()
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
        return self.away(dict(zip(self._names, goal)), TOLERANCE)

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
            name = self._commands.resolved_name
            raise NoAnswerError(f"Nobody listens to {name}; is the bridge running?")

    def _next(self, after, timeout: float | None = TIMEOUT) -> JointState:
        """Wait for joint states.

        Args:
            after: Stamp of a message; the next has another. None: any message will do.
            timeout: Longest wait in [s]; None: no limit.
        """

        def is_next():
            return self.newest and self.newest.header.stamp != after

        if not self.wait_until(is_next, timeout):
            raise NoAnswerError(f"The robot's positions are unknown: {self.silence}")
        return self.newest
