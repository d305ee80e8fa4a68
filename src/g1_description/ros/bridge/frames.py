"""The frames above robots, and the edges of TF that do not move."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rospy
import tf2_ros

from g1_description.core.robot.assembly import base_of
from g1_description.core.robot.description import Description
from g1_description.core.transform import IDENTITY
from g1_description.ros.wire.conversions import transform

from .parameters import BridgeParameters, RobotParameters


def base_child(parameters: BridgeParameters, description: Description) -> str | None:
    """Find the frame of a robot that moves in the map.

    Args:
        parameters: Names of the frames above.
        description: The robot, which names its own frames.

    Returns:
        base_link; the root, or what floats in the world, where base_link is a link
        below it, which has a parent already; None where the root itself is the world
        or the map and nothing floats in it.
    """
    p = parameters
    root, _ = base_of(description)
    if root in (p.world_frame, p.map_frame):
        return None
    below = p.base_frame in description.link_names and p.base_frame != root
    return root if below else p.base_frame


def fixed_edges(
    description: Description, prefix: str = ""
) -> list[tuple[str, str, np.ndarray]]:
    """List the fixed joints of a robot.

    Args:
        description: The robot.
        prefix: Prefix of the names of the robot's own frames.

    Returns:
        Parent, child and the child's pose in the parent's frame, shape (7,).
    """
    return [
        (prefix + joint.parent, prefix + joint.child, joint.pose)
        for joint in description.joints
        if joint.kind == "fixed"
    ]


def static_edges(
    parameters: BridgeParameters, description: Description, prefix: str = ""
) -> list[tuple[str, str]]:
    """List the static edges around a robot, all of them identities.

    Args:
        parameters: Names of the frames above.
        description: The robot.
        prefix: Prefix of the names of the robot's own frames.

    Returns:
        Parent and child of world -> map, base_link -> root where base_link is no
        link of the robot, world -> its own world where that has a prefix, and
        imu_in_torso -> body_imu where the robot has one.
    """
    p = parameters
    edges = [(p.world_frame, p.map_frame)]
    root, _ = base_of(description)
    if base_child(p, description) not in (None, root):
        edges.append((prefix + p.base_frame, prefix + root))
    if prefix and description.root in (p.world_frame, p.map_frame):
        edges.append((description.root, prefix + description.root))
    if p.imu_link in description.link_names:
        edges.append((prefix + p.imu_link, prefix + p.imu_frame))
    return edges


class StaticFrames:
    """Sends the edges of all robots that do not move."""

    def __init__(
        self,
        parameters: BridgeParameters,
        robots: Sequence[tuple[RobotParameters, Description]],
    ) -> None:
        """Send the edges around the robots.

        Args:
            parameters: Names of the frames above.
            robots: Names and descriptions of the robots.
        """
        self._broadcaster = tf2_ros.StaticTransformBroadcaster()
        self._static_edges = {
            (parent, child): IDENTITY
            for robot, description in robots
            for parent, child in static_edges(
                parameters, description, robot.frame_prefix
            )
        }
        self._fixed_edges = {
            (parent, child): pose
            for robot, description in robots
            for parent, child, pose in fixed_edges(description, robot.frame_prefix)
        }
        self._send(self._static_edges)

    def send_fixed_joints(self) -> None:
        """Send the robots' fixed joints once, in place of robot_state_publisher.

        It sends them by a timer, which waits for the clock: while that stands still
        nobody else does.
        """
        if self._fixed_edges:
            self._send({**self._static_edges, **self._fixed_edges})
            self._fixed_edges = {}

    def _send(self, edges: dict[tuple[str, str], np.ndarray]) -> None:
        """Send edges in one message, as listeners keep only a node's last one."""
        now = rospy.Time.now()
        self._broadcaster.sendTransform(
            [transform(now, *edge, pose.tolist()) for edge, pose in edges.items()]
        )
