"""A robot as any other node sees it: its description and its joint states."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Mapping

import rospy
from sensor_msgs.msg import JointState

from g1_description.errors import DescriptionError
from g1_description.robot.description import Description
from g1_description.robot.urdf import parse_urdf
from g1_description.ros.parameters import wait_for_parameter
from g1_description.ros.waiting import NEWEST, wait_until

DESCRIPTION = "robot_description"

DESCRIPTION_TIMEOUT = 10.0
"""Longest wait for a description, in [s]: it may be launched at the same time."""

QUIET = 2.0
"""Time without joint states, or without newer stamps, after which a wait reports it,
in [s]."""

STANDS_STILL = "simulated time stands still"


class RobotView:
    """Follows one robot.

    Subscribes: joint_states (sensor_msgs/JointState).
    Reads: robot_description, searched for upward from the robot's namespace.
    """

    def __init__(self, namespace: str, notify: Callable[[str], None]) -> None:
        """Read the description and subscribe.

        Args:
            namespace: Of the robot's topics, without slashes around; empty: the
                node's.
            notify: Takes messages about what is waited for.

        Raises:
            DescriptionError: If there is no description, or it is not one.
            ROSInterruptException: If the node is shut down.
        """
        self.description = wait_for_description(namespace, notify)
        self.positions: dict[str, float] = {}
        """Last finite positions in [rad] or [m] of the movable joints heard of."""
        self.newest: JointState | None = None
        """The last message; None: there is none yet."""
        self._joints = {joint.name for joint in self.description.movable_joints}
        self._notify = notify
        self._changed = threading.Condition()
        self._heard = self._advanced = 0.0
        """When the last message, and the last with a new stamp, came: monotonic."""
        self._stamp = rospy.Time()
        self._prefix = f"/{namespace}/" if namespace else ""
        self._subscriber = rospy.Subscriber(
            f"{self._prefix}joint_states", JointState, self._on_joint_states, **NEWEST
        )
        self.topic = self._subscriber.resolved_name

    def _on_joint_states(self, message: JointState) -> None:
        """Keep a message; positions in a new dictionary, for other threads."""
        finite = {
            name: position
            for name, position in zip(message.name, message.position)
            if name in self._joints and math.isfinite(position)
        }
        with self._changed:
            self.positions = {**self.positions, **finite}
            self.newest, self._heard = message, time.monotonic()
            if message.header.stamp != self._stamp:
                self._stamp, self._advanced = message.header.stamp, self._heard
            self._changed.notify()

    @property
    def missing(self) -> list[str]:
        """Names of the movable joints without a known position."""
        joints = self.description.movable_joints
        return [joint.name for joint in joints if joint.name not in self.positions]

    def away(self, goal: Mapping[str, float], tolerance: float) -> list[str]:
        """List the joints that were last not at a goal, and where they were.

        Args:
            goal: Positions in [rad] or [m] by joint name.
            tolerance: Largest distance that does not count, in [rad] or [m].
        """
        newest = self.newest
        shown = dict(zip(newest.name, newest.position)) if newest else {}
        return [
            f"{name} at {shown[name]:g} instead of {position:g}"
            if name in shown
            else f"no {name}"
            for name, position in goal.items()
            if not abs(shown.get(name, math.inf) - position) <= tolerance
        ]

    def forget_newest(self) -> None:
        """Count only joint states that come from now on."""
        with self._changed:
            self.newest = None

    def wait_until(self, condition: Callable, timeout: float | None):
        """Wait until a condition on the joint states holds; report what delays it.

        Returns:
            What the condition returned last.

        Raises:
            ROSInterruptException: If the node is shut down.
        """
        begin, reported = time.monotonic(), ""

        def holds():
            nonlocal reported
            result = condition()
            obstacle = "" if result else self.obstacle(begin)
            if obstacle not in ("", reported):
                self._notify(f"waiting: {obstacle}")
                reported = obstacle
            return result

        return wait_until(holds, timeout, self._changed)

    def obstacle(self, begin: float = 0.0) -> str:
        """Return what keeps a wait from ending; empty if nothing is known to.

        Args:
            begin: When the wait began, on the monotonic clock.
        """
        if max(begin, self._heard) < time.monotonic() - QUIET:
            return self.silence
        if max(begin, self._advanced) < time.monotonic() - QUIET:
            return f"{STANDS_STILL} at {self._stamp.to_sec():g} s."
        return ""

    @property
    def stands_still(self) -> bool:
        """Whether stamps have not changed for a while."""
        return time.monotonic() - self._advanced > QUIET

    @property
    def silence(self) -> str:
        """A message that there are no joint states, and why that may be."""
        if self._heard:
            last = self._stamp.to_sec()
            return f"nothing comes on {self.topic} after {last:g} s; is time paused?"
        return f"nothing comes on {self.topic}; does a simulator run, and does time?"

    def close(self) -> None:
        """Unsubscribe."""
        self._subscriber.unregister()


def wait_for_description(namespace: str, notify: Callable[[str], None]) -> Description:
    """Wait until a robot is on the parameter server, and parse it.

    Args:
        namespace: Of the robot's topics, without slashes around.
        notify: Takes messages about what is waited for.

    Raises:
        DescriptionError: If there is no description, or it is not one.
        ROSInterruptException: If the node is shut down.
    """
    place = f"parameter {DESCRIPTION} in /{namespace} or above it"
    parameter = wait_for_parameter(
        DESCRIPTION,
        namespace,
        lambda: notify(f"waiting for the {place}."),
        DESCRIPTION_TIMEOUT,
    )
    if not parameter:
        raise DescriptionError(f"There is no {place}; is the robot launched?")
    return parse_urdf(str(rospy.get_param(parameter)))
