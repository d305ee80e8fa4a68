"""What comes on topics and from services, asked as a node among the others.

Subscribes: /clock (rosgraph_msgs/Clock), /diagnostics
    (diagnostic_msgs/DiagnosticArray), /tf and /tf_static (tf2_msgs/TFMessage),
    <gazebo>/link_states (gazebo_msgs/LinkStates), joint_states
    (sensor_msgs/JointState)
Calls: <gazebo>/get_physics_properties (gazebo_msgs/GetPhysicsProperties),
    <gazebo>/get_world_properties (gazebo_msgs/GetWorldProperties)
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import rospy
from diagnostic_msgs.msg import DiagnosticArray
from gazebo_msgs.msg import LinkStates
from gazebo_msgs.srv import GetPhysicsProperties, GetWorldProperties
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

from g1_description.cli.doctor.machine import within
from g1_description.ros.lifecycle import start_node
from g1_description.ros.waiting import wait_until

WAIT = 4.0
"""Longest wait for a message or an answer, in [s] of wall time: machines may be
busy."""

TF_WAIT = 1.5
"""Longest wait in [s] for those who could send to TF, but need not."""

QUEUE_SIZE = 100
"""Messages of a topic and a publisher that may arrive at once."""


class Heard:
    """The messages of a topic, and who sent them."""

    def __init__(self, topic: str, kind: Any) -> None:
        """Subscribe.

        Args:
            topic: Its full name.
            kind: The class of its messages.
        """
        self.messages: list[tuple[str, Any]] = []
        """Sender and message."""
        self._subscriber = rospy.Subscriber(
            topic, kind, self._on_message, queue_size=QUEUE_SIZE
        )

    def _on_message(self, message: Any) -> None:
        """Keep a message and its sender."""
        header = message._connection_header or {}
        self.messages.append((header.get("callerid", ""), message))

    @property
    def senders(self) -> set[str]:
        """The nodes that sent something."""
        return {sender for sender, _ in list(self.messages)}

    def wait(self, senders: Iterable[str]) -> bool:
        """Wait until all of some nodes have sent something; tell whether they have.

        Raises:
            ROSInterruptException: If the node is shut down.
        """
        wanted = {*senders}
        return bool(wait_until(lambda: wanted <= self.senders, WAIT))

    def close(self) -> None:
        """Unsubscribe."""
        self._subscriber.unregister()


class Traffic:
    """Listens, for a while, and asks the simulator."""

    def __init__(self) -> None:
        """Start the node, where the program is none yet."""
        if not rospy.core.is_initialized():
            start_node("doctor", anonymous=True, disable_rosout=True)
        self._diagnostics = Heard("/diagnostics", DiagnosticArray)

    def close(self) -> None:
        """End what listens all the time."""
        self._diagnostics.close()

    def has_time(self) -> bool:
        """Whether a time comes on /clock."""
        return self._first("/clock", Clock) is not None

    def joint_states(self, topic: str) -> list[str] | None:
        """Wait for joint states; return the names of their joints, None without."""
        message = self._first(topic, JointState)
        return None if message is None else list(message.name)

    def link_states(self, topic: str) -> tuple[list[str], np.ndarray] | None:
        """Wait for link states.

        Returns:
            Scoped names, and poses in the world, shape (n, 7); None without.
        """
        message = self._first(topic, LinkStates)
        if message is None:
            return None
        rows = [
            [*_numbers(pose.position, "xyz"), *_numbers(pose.orientation, "xyzw")]
            for pose in message.pose
        ]
        return list(message.name), np.array(rows).reshape(-1, 7)

    def _first(self, topic: str, kind: Any) -> Any:
        """Wait for any message of a topic; None if none comes."""
        heard = Heard(topic, kind)
        try:
            wait_until(lambda: heard.messages, WAIT)
            return heard.messages[0][1] if heard.messages else None
        finally:
            heard.close()

    def is_paused(self, gazebo: str) -> bool:
        """Ask a simulator whether it is paused.

        Raises:
            OSError, rospy.ServiceException, rospy.ROSException: If it does not answer.
        """
        kind = GetPhysicsProperties
        return bool(self._call(f"{gazebo}/get_physics_properties", kind).pause)

    def models(self, gazebo: str) -> list[str]:
        """Ask a simulator for the names of its models.

        Raises:
            OSError, rospy.ServiceException, rospy.ROSException: If it does not answer.
        """
        answer = self._call(f"{gazebo}/get_world_properties", GetWorldProperties)
        return list(answer.model_names)

    @staticmethod
    def _call(name: str, kind: Any) -> Any:
        """Call a service that may hang."""
        return within(WAIT, rospy.ServiceProxy(name, kind))

    def tf(
        self,
        publishers: dict[str, list[str]],
        is_whole: Callable[[dict[str, set[tuple[str, str]]]], bool],
    ) -> dict[str, set[tuple[str, str]]]:
        """Listen to TF until all that publish it were heard, and it is whole.

        Args:
            publishers: Who publishes, by topic.
            is_whole: Whether all that is expected is there.

        Returns:
            Who sends each edge: pairs of node and parent, by the child's frame.
        """
        topics = ("/tf", "/tf_static")
        heard = [Heard(topic, TFMessage) for topic in topics]
        wanted = [{*publishers.get(topic, ())} for topic in topics]

        end = time.monotonic() + TF_WAIT

        def is_enough() -> bool:
            came = all(w <= h.senders for w, h in zip(wanted, heard))
            return (came or time.monotonic() > end) and is_whole(_edges(heard))

        wait_until(is_enough, WAIT, period=0.1)
        for one in heard:
            one.close()
        return _edges(heard)

    def diagnostics(self, node: str) -> dict[str, tuple[int, str]]:
        """Wait for a node's words on itself: level and text by the status' name."""
        self._diagnostics.messages.clear()
        self._diagnostics.wait([node])
        found = {}
        for sender, message in list(self._diagnostics.messages):
            if sender == node:
                found = {s.name: (s.level, s.message) for s in message.status}
        return found


def _numbers(message: Any, names: str) -> list[float]:
    """Read fields of a message."""
    return [getattr(message, name) for name in names]


def _edges(heard: Iterable[Heard]) -> dict[str, set[tuple[str, str]]]:
    """Collect the edges of TF: pairs of sender and parent, by the child's frame."""
    found: dict[str, set[tuple[str, str]]] = {}
    for one in heard:
        for sender, message in list(one.messages):
            for edge in message.transforms:
                child, parent = edge.child_frame_id, edge.header.frame_id
                pair = (sender, parent.lstrip("/"))
                found.setdefault(child.lstrip("/"), set()).add(pair)
    return found
