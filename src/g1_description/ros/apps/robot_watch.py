"""What a robot does now, from its joint states and from TF."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import Callable

import numpy as np
import rospy
from sensor_msgs.msg import JointState

from g1_description.core.errors import DescriptionError, G1DescriptionError
from g1_description.core.robot.assembly import base_of
from g1_description.core.robot.description import Description
from g1_description.core.transform import compose, inverse
from g1_description.core.urdf.reader import parse_urdf
from g1_description.ros.bridge.descriptions import find_parameter
from g1_description.ros.node.newest import NEWEST

from .transforms import Transforms

DESCRIPTION, JOINT_STATES, MAP = "robot_description", "joint_states", "map"

PATIENCE = 10.0
"""Longest wait for a description and for joint states, in [s] of wall time."""

TF_PATIENCE = 2.0
"""Longest wait for a transform once the joints are known, in [s] of wall time."""

POLL = 0.02
"""Time between two looks, in [s]."""


class NotThereError(G1DescriptionError):
    """Something did not come in time."""


@dataclass(frozen=True)
class Moment:
    """How a robot is at some time."""

    positions: dict[str, float]
    """Positions of its joints in [rad] or [m] by name; unknown ones are left out."""

    T_map_root: np.ndarray | None
    """Pose of its root link in the map, shape (7,); None where it is unknown."""

    def with_joints(self, positions: dict[str, float]) -> Moment:
        """Give the same with other positions of some joints."""
        return replace(self, positions={**self.positions, **positions})


def wait_until(condition: Callable[[], bool], patience: float) -> bool:
    """Wait for a condition; tell whether it came true.

    Raises:
        KeyboardInterrupt: If the node was shut down meanwhile.
    """
    end = time.monotonic() + patience
    while not condition():
        if rospy.is_shutdown():
            raise KeyboardInterrupt
        if time.monotonic() > end:
            return False
        time.sleep(POLL)
    return True


class RobotWatch:
    """Follows one robot.

    Subscribes: joint_states (sensor_msgs/JointState).
    Reads: robot_description, searched for upward from the robot's namespace.
    """

    def __init__(self, namespace: str, transforms: Transforms) -> None:
        """Begin to listen.

        Args:
            namespace: Of the robot's topics, without slashes around; its frames are
                called after it as the bridge does it.
            transforms: What TF tells.

        Raises:
            DescriptionError: If its description does not come, or is no robot.
        """
        self._topic = rospy.resolve_name(f"/{namespace}/{JOINT_STATES}")
        self._transforms = transforms
        self.description = _wait_for_description(namespace)
        prefix = f"{namespace}/" if namespace else ""
        base, self._T_root_base = base_of(self.description)
        self.frame = prefix + base
        """Name in TF of the link that tells where it is."""
        self._joints = {joint.name for joint in self.description.movable_joints}
        self._positions: dict[str, float] = {}
        self._subscriber = rospy.Subscriber(
            self._topic, JointState, self._hear, **NEWEST
        )

    def _hear(self, message: JointState) -> None:
        """Take the positions that are numbers; a new dictionary, for other threads."""
        heard = {
            name: position
            for name, position in zip(message.name, message.position)
            if name in self._joints and math.isfinite(position)
        }
        self._positions = {**self._positions, **heard}

    def wait(self) -> None:
        """Wait for all joints, or at least some, and for the place of the root.

        Raises:
            NotThereError: If nothing is known of any joint.
            KeyboardInterrupt: If the node was shut down meanwhile.
        """
        wait_until(lambda: not self.missing, PATIENCE)
        if self._joints and not self._positions:
            raise NotThereError(
                f"No joint states of '{self.description.name}' came on {self._topic} "
                f"within {PATIENCE:g} s: does the bridge run, and is time not paused?"
            )
        wait_until(lambda: self._root_pose() is not None, TF_PATIENCE)

    @property
    def missing(self) -> list[str]:
        """Names of the joints that nothing is known of."""
        known = self._positions
        joints = self.description.movable_joints
        return [joint.name for joint in joints if joint.name not in known]

    def now(self) -> Moment:
        """Tell how the robot is."""
        return Moment(self._positions, self._root_pose())

    def _root_pose(self) -> np.ndarray | None:
        """Tell where the root link is in the map, shape (7,)."""
        pose = self._transforms.pose(MAP, self.frame)
        return None if pose is None else compose(pose, inverse(self._T_root_base))

    def close(self) -> None:
        """Listen no more."""
        self._subscriber.unregister()


def _wait_for_description(namespace: str) -> Description:
    """Wait for a robot on the parameter server."""
    if not wait_until(lambda: bool(find_parameter(DESCRIPTION, namespace)), PATIENCE):
        raise DescriptionError(
            f"There is no parameter {DESCRIPTION} in /{namespace} or above it "
            f"after {PATIENCE:g} s."
        )
    return parse_urdf(str(rospy.get_param(find_parameter(DESCRIPTION, namespace))))
