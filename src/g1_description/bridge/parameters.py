"""Parameters of the bridge's node: names, defaults, ranges."""

from __future__ import annotations

import posixpath
import re
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import partial

import numpy as np
import rospy
import tf2_ros

from g1_description.bridge.controllers import Controller, read_controllers
from g1_description.errors import InvalidValueError
from g1_description.robot.assembly import base_frame, base_of
from g1_description.robot.description import Description
from g1_description.robot.transform import IDENTITY
from g1_description.ros.conversions import transform
from g1_description.ros.parameters import (
    check_prefix,
    check_range,
    read_robot,
    wait_for_parameter,
)

_KINDS = {"controllers": (list, tuple)}


@dataclass(frozen=True)
class BridgeParameters:
    """Parameters of link_states_bridge.

    One without a docstring is an argument of launch files, whose ``doc`` describes it.
    """

    gazebo: str = "/gazebo"
    """Namespace of the simulator."""

    model_name: str = "g1_robot"
    """Name of the robot in the simulated world."""

    robot_description: str = "robot_description"
    """Name of the parameter with the URDF; searched for upward from the
    namespace."""

    frame_prefix: str = ""

    robots: tuple[dict, ...] = ()
    """Several robots instead of one; see [below](#several-robots)."""

    controllers: tuple[dict, ...] = ()
    """Joints of each ``follow_joint_trajectory``; see
    [motions](motions.md#controllers)."""

    position_threshold: float = 0.005
    """Publish ``map -> base_link`` after it moved this far, in [m]."""

    rotation_threshold: float = 0.01
    """Or after it turned this far, in [rad]."""

    max_interval: float = 0.05
    """Or after this time; the launch files set 0.02 with ``web:=true``, in [s]."""

    min_interval: float = 0.0
    """Minimum time between two transforms ``map -> base_link``, in [s]."""

    max_rate: float = 0.0
    """Maximum rate, in simulated time, of states from a simulator without
    simulator_state, such as Gazebo; 0: no limit, in [Hz]."""

    world_frame: str = "world"
    """Root of the TF tree."""

    map_frame: str = "map"
    """Child of ``~world_frame``, at the same pose."""

    base_frame: str = "base_link"
    """Frame of the robot's base."""

    trails: str = ""

    ghost: bool = False

    history: float = 600.0

    imu_link: str = ""
    """Link with a second frame, for the IMU; empty: the link ``imu`` of the robot's
    [profile](robots.md)."""

    imu_frame: str = "body_imu"
    """Name of the second frame."""

    def __post_init__(self) -> None:
        """Check ranges."""
        for name in ("position_threshold", "rotation_threshold"):
            check_range(self, name, 0.0, 1e3)
        for name in ("max_interval", "min_interval"):
            check_range(self, name, 0.0, 3600.0)
        check_range(self, "max_rate", 0.0, 1e6)
        check_range(self, "history", 0.0, 1e6)
        check_prefix("The ~frame_prefix", self.frame_prefix)
        for key in ("name", "namespace", "frame_prefix"):
            values = [getattr(robot, key) for robot in self.each_robot]
            twice = sorted({value for value in values if values.count(value) > 1})
            if twice:
                raise InvalidValueError(
                    f"~robots must not repeat a {key} (got '{twice[0]}' twice)."
                )

    @property
    def each_robot(self) -> tuple[RobotParameters, ...]:
        """The robots to bridge: those of ``robots``, else the one."""
        if self.robots:
            return tuple(
                _robot(number, entry, self.controllers)
                for number, entry in enumerate(self.robots)
            )
        one = RobotParameters(
            self.model_name,
            "",
            self.robot_description,
            self.frame_prefix,
            self.controllers,
        )
        return (one,)


@dataclass(frozen=True)
class RobotParameters:
    """One robot of several that a bridge serves."""

    name: str
    """Name of its model in the simulated world."""

    namespace: str
    """Namespace of its topics; by default its name."""

    description: str = "robot_description"
    """Name of the parameter with its URDF; searched for upward from the namespace."""

    frame_prefix: str = ""
    """Prefix of the names of its frames; by default the namespace and a slash."""

    controllers: tuple[dict, ...] = ()
    """Joints of each of its actions; by default ``~controllers``."""


def _robot(number: int, entry, controllers: tuple[dict, ...]) -> RobotParameters:
    """Read one entry of ``~robots``."""
    known = [field.name for field in fields(RobotParameters)]
    name = entry.get("name") if isinstance(entry, dict) else None
    if not isinstance(name, str) or not name:
        raise InvalidValueError(
            f"~robots[{number}] must be a dictionary with a name (got {entry!r})."
        )
    for key, value in entry.items():
        if key not in known or not isinstance(value, _KINDS.get(key, str)):
            raise InvalidValueError(
                f"~robots[{number}] may have strings for {', '.join(known[:-1])} and a "
                f"list for {known[-1]} (got {key}: {value!r})."
            )
    default = re.sub(r"\W", "_", name, flags=re.ASCII)
    namespace = entry.get("namespace", default).strip("/")
    if namespace and not re.fullmatch(r"[A-Za-z][\w/]*", namespace, re.ASCII):
        raise InvalidValueError(
            f"namespace of ~robots[{number}] must be a ROS name (got '{namespace}')."
        )
    prefix = entry.get("frame_prefix", namespace and f"{namespace}/")
    check_prefix(f"The frame_prefix of ~robots[{number}]", prefix)
    return RobotParameters(
        name,
        namespace,
        entry.get("description", RobotParameters.description),
        prefix,
        tuple(entry.get("controllers", controllers)),
    )


def wait_for_descriptions(
    robots: Sequence[RobotParameters],
) -> list[tuple[RobotParameters, Description]]:
    """Wait until the descriptions of all robots are on the parameter server.

    Args:
        robots: The robots to wait for.

    Returns:
        The robots with their descriptions; equal texts share one description.

    Raises:
        DescriptionError: If a parameter is not a robot.
        ROSInterruptException: If the node is shut down.
    """
    found = []
    parsed: dict[str, Description] = {}
    for robot in robots:
        where = f"{robot.description}, from /{robot.namespace} upward"
        text = f"Waiting for {robot.name} on the parameter {where}."
        parameter = wait_for_parameter(
            robot.description, robot.namespace, partial(rospy.loginfo, "%s", text)
        )
        urdf = str(rospy.get_param(parameter))
        if urdf not in parsed:
            parsed[urdf] = read_robot(parameter)
        found.append((robot, parsed[urdf]))
    return found


def controllers_of(
    robot: RobotParameters, description: Description
) -> tuple[Controller, ...]:
    """Read a robot's controllers.

    Raises:
        InvalidValueError: If an entry is invalid.
    """
    joints = [joint.name for joint in description.movable_joints]
    return read_controllers(robot.controllers, joints, f"controllers of {robot.name}")


def topic_of(robot: RobotParameters, name: str) -> str:
    """Return the name of a robot's topic."""
    return posixpath.join(robot.namespace and f"/{robot.namespace}", name)


def base_child(parameters: BridgeParameters, description: Description) -> str | None:
    """Return the robot's frame that the map is the parent of, or None."""
    p = parameters
    return base_frame(description, p.base_frame, (p.world_frame, p.map_frame))


def static_edges(
    parameters: BridgeParameters, description: Description, prefix: str = ""
) -> list[tuple[str, str]]:
    """List the static transforms around a robot, all of them identities.

    Returns:
        Parent and child of world -> map, base_link -> root if base_link is not a link
        of the robot, world -> its own world if that has a prefix, and the link of the
        IMU -> body_imu if the robot has one.
    """
    p = parameters
    edges = [(p.world_frame, p.map_frame)]
    root, _ = base_of(description)
    if base_child(p, description) not in (None, root):
        edges.append((prefix + p.base_frame, prefix + root))
    if prefix and description.root in (p.world_frame, p.map_frame):
        edges.append((description.root, prefix + description.root))
    imu = p.imu_link or description.profile.links.get("imu", "")
    if imu in description.link_names:
        edges.append((prefix + imu, prefix + p.imu_frame))
    return edges


class StaticFrames:
    """Broadcasts the static transforms of all robots."""

    def __init__(
        self,
        parameters: BridgeParameters,
        robots: Sequence[tuple[RobotParameters, Description]],
    ) -> None:
        self._broadcaster = tf2_ros.StaticTransformBroadcaster()
        self._static_edges = {
            (parent, child): IDENTITY
            for robot, description in robots
            for parent, child in static_edges(
                parameters, description, robot.frame_prefix
            )
        }
        self._fixed_edges = {
            (robot.frame_prefix + joint.parent, robot.frame_prefix + joint.child): (
                joint.pose
            )
            for robot, description in robots
            for joint in description.joints
            if joint.kind == "fixed"
        }
        self._send(self._static_edges)

    def send_fixed_joints(self) -> None:
        """Send the robots' fixed joints, once.

        robot_state_publisher sends them from a timer, which waits while the clock
        stands still.
        """
        if self._fixed_edges:
            self._send({**self._static_edges, **self._fixed_edges})
            self._fixed_edges = {}

    def _send(self, edges: dict[tuple[str, str], np.ndarray]) -> None:
        """Send transforms in one message: a latched topic has only the last one."""
        now = rospy.Time.now()
        self._broadcaster.sendTransform(
            [transform(now, *edge, pose.tolist()) for edge, pose in edges.items()]
        )
