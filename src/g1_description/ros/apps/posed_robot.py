"""A robot as a client of the bridge sees it: where it is, and how to move it.

Publishes: joint_commands (sensor_msgs/JointState)
Subscribes: joint_states (sensor_msgs/JointState)
All waits go by wall time: simulated time may stand still.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np
import rospy
from sensor_msgs.msg import JointState

from g1_description.core.bridge.commands import listed
from g1_description.core.errors import DescriptionError, G1DescriptionError
from g1_description.core.poses.motion import minimum_jerk
from g1_description.core.urdf.reader import parse_urdf
from g1_description.ros.bridge.descriptions import find_parameter
from g1_description.ros.node.newest import NEWEST
from g1_description.ros.node.shutdown import quiet_when_closing

PATIENCE = 30.0
"""Longest wait for the bridge, or for what it shows, in [s]: machines may be busy."""

AGAIN = 1.0
"""Time after which a goal is sent again, in [s]."""

QUIET = 2.0
"""Time without joint states, or without newer stamps, after which that is told, in
[s]."""

PERIOD = 0.01
"""Least time between two commands on the way, in [s] of the robot's time."""

TOLERANCE = 0.01
"""How far a joint may be from where it was put, in [rad] or [m]: motors give way."""

STANDS_STILL = "simulated time stands still"


class NoAnswerError(G1DescriptionError):
    """The bridge does not do in time what it was waited for."""


class PosedRobot:
    """The robot behind joint_states and joint_commands of a namespace."""

    def __init__(self, namespace: str, tell: Callable[[str], None]) -> None:
        """Connect.

        Args:
            namespace: Where its topics are; empty: the node's.
            tell: Takes sentences about what is waited for.

        Raises:
            DescriptionError: If its description is not on the parameter server.
        """
        parameter = find_parameter("robot_description", namespace)
        if parameter is None:
            raise DescriptionError(
                f"There is no parameter robot_description from /{namespace} upward; "
                "is the robot launched?"
            )
        self.description = parse_urdf(str(rospy.get_param(parameter)))
        self._names = [joint.name for joint in self.description.movable_joints]
        self._tell = tell
        self._changed = threading.Condition()
        self._newest: JointState | None = None
        self._heard = 0.0
        """When the last message came, on the monotonic clock."""
        self._ran = 0.0
        """When the last message with another stamp than the one before came."""
        self._stamp = rospy.Time()
        prefix = f"/{namespace}/" if namespace else ""
        self._commands = rospy.Publisher(
            f"{prefix}joint_commands", JointState, queue_size=10, tcp_nodelay=True
        )
        self._states = rospy.Subscriber(
            f"{prefix}joint_states",
            JointState,
            self._came,
            tcp_nodelay=True,
            **NEWEST,
        )

    def _came(self, message: JointState) -> None:
        """Keep the newest message."""
        with self._changed:
            self._newest, self._heard = message, time.monotonic()
            if message.header.stamp != self._stamp:
                self._stamp, self._ran = message.header.stamp, self._heard
            self._changed.notify()

    def positions(self) -> np.ndarray:
        """Give where the joints are now.

        Returns:
            Positions in [rad] or [m] inside the limits, in the order of the movable
            joints, shape (n_joints,).

        Raises:
            NoAnswerError: If joints are not measured.
        """
        return self._inside(self._next(None))

    def jump(self, goal: np.ndarray) -> None:
        """Put all joints somewhere, and wait until it shows.

        Args:
            goal: Positions in [rad] or [m], shape (n_joints,).

        Raises:
            NoAnswerError: If nobody listens, or it does not show.
        """
        self._wait_for_listener()
        self._arrive(goal)

    def glide(self, goal: np.ndarray, seconds: float) -> None:
        """Move all joints from where they are, beginning and ending at rest.

        Args:
            goal: Positions in [rad] or [m], shape (n_joints,).
            seconds: How long, in [s] of the robot's time.

        Raises:
            NoAnswerError: If nobody listens, time goes back, or it does not show.
        """
        self._wait_for_listener()
        first = message = self._next(None)
        start, begin = self._inside(first), first.header.stamp
        share = 0.0
        while share < 1.0:
            message = self._next(message.header.stamp, patience=None)
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
        with self._changed:
            self._newest = None
        sent = -np.inf

        def is_there():
            nonlocal sent
            if time.monotonic() >= sent + AGAIN:
                self._publish(goal)
                sent = time.monotonic()
            return self._newest and not self._away(goal)

        if self._wait(is_there, PATIENCE):
            return
        topic = self._states.resolved_name
        if self._newest is None:
            raise NoAnswerError(f"The command is sent, but {self._silence}")
        stands = time.monotonic() - self._ran > QUIET
        raise NoAnswerError(
            f"After {PATIENCE:g} s {topic} still has {listed(self._away(goal))}"
            f"{f'; {STANDS_STILL}' if stands else ''}."
        )

    def _away(self, goal: np.ndarray) -> list[str]:
        """Tell which joints are not where they were put."""
        told = dict(zip(self._newest.name, self._newest.position))
        return [
            f"{name} at {told[name]:g} instead of {position:g}"
            if name in told
            else f"no {name}"
            for name, position in zip(self._names, goal)
            if not abs(told.get(name, np.inf) - position) <= TOLERANCE
        ]

    def _inside(self, message: JointState) -> np.ndarray:
        """Read a message's positions, clamped to the limits."""
        told = dict(zip(message.name, message.position))
        missing = [name for name in self._names if name not in told]
        if missing:
            raise NoAnswerError(
                f"{self._states.resolved_name} has nothing of {listed(missing)}."
            )
        joints = self.description.movable_joints
        return np.array(
            [min(max(told[j.name], j.lower), j.upper) for j in joints], dtype=float
        )

    def _wait_for_listener(self) -> None:
        """Wait until the bridge hears commands."""
        if not self._wait(self._commands.get_num_connections, PATIENCE):
            raise NoAnswerError(
                f"Nobody listens to {self._commands.resolved_name}; is the bridge "
                "running?"
            )

    def _next(self, after, patience: float | None = PATIENCE) -> JointState:
        """Wait for joint states.

        Args:
            after: Stamp of a message; the next is later by at least ``PERIOD``, or
                earlier. None: any message will do.
            patience: Longest wait in [s]; None: for ever.
        """

        def is_next():
            if self._newest is None or after is None:
                return self._newest is not None
            step = (self._newest.header.stamp - after).to_sec()
            return step >= PERIOD or step < 0.0

        if not self._wait(is_next, patience):
            raise NoAnswerError(f"Where the robot is nobody tells: {self._silence}")
        return self._newest

    def _wait(self, condition: Callable, seconds: float | None):
        """Wait for a condition on the newest message; give what it gave last.

        Raises:
            ROSInterruptException: If the node is shut down.
        """
        begin, told = time.monotonic(), ""
        end = begin + (np.inf if seconds is None else seconds)
        with self._changed:
            while not condition() and time.monotonic() < end:
                if rospy.is_shutdown():
                    raise rospy.ROSInterruptException("interrupted")
                obstacle = self._obstacle(begin)
                if obstacle not in ("", told):
                    self._tell(f"waiting: {obstacle}")
                    told = obstacle
                self._changed.wait(0.05)
            return condition()

    def _obstacle(self, begin: float) -> str:
        """Tell what it is that does not go on; empty: all does, for what is known.

        Args:
            begin: When the wait began, on the monotonic clock.
        """
        late = time.monotonic() - QUIET
        if max(begin, self._heard) < late:
            return self._silence
        if max(begin, self._ran) < late:
            return f"{STANDS_STILL} at {self._stamp.to_sec():g} s."
        return ""

    @property
    def _silence(self) -> str:
        """Say that there are no joint states, and what may be the reason."""
        topic = self._states.resolved_name
        if self._heard:
            last = self._stamp.to_sec()
            return f"nothing comes on {topic} after {last:g} s; is time paused?"
        return f"nothing comes on {topic}; does a simulator run, and does time?"
