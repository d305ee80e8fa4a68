"""Parameters of the bridge's node: names, defaults, ranges."""

from __future__ import annotations

import posixpath
import re
from collections.abc import Sequence
from dataclasses import dataclass, fields

import rospy

from g1_description.core.errors import InvalidValueError
from g1_description.core.robot.description import Description
from g1_description.core.urdf.reader import parse_urdf
from g1_description.ros.motion.action.controllers import Controller, read_controllers
from g1_description.ros.node.parameters import check_range, wait_for_parameter

_KINDS = {"controllers": (list, tuple)}


@dataclass(frozen=True)
class BridgeParameters:
    """Parameters of the bridge."""

    gazebo: str = "/gazebo"
    """Namespace of the simulator's topics and services."""

    model_name: str = "g1_robot"
    """Name of the robot in the simulated world."""

    robot_description: str = "robot_description"
    """Parameter that holds the robot's URDF; searched for upward from the namespace."""

    frame_prefix: str = ""
    """What stands before the names of the robot's frames."""

    robots: tuple[dict, ...] = ()
    """Several robots in place of the one above: a list of dictionaries as
    ``RobotParameters``."""

    controllers: tuple[dict, ...] = ()
    """What each action follow_joint_trajectory moves: a list of dictionaries as
    ``Controller``; empty: one action moves all joints."""

    position_threshold: float = 0.005
    """map -> base_link is sent when the robot moved this far, in [m]."""

    rotation_threshold: float = 0.01
    """map -> base_link is sent when the robot turned this far, in [rad]."""

    max_interval: float = 0.05
    """map -> base_link is sent when the last one is this old, in [s]."""

    min_interval: float = 0.0
    """map -> base_link is never sent sooner than this after the last, in [s]."""

    max_rate: float = 0.0
    """States per second of simulated time that are taken from a simulator without
    ``world_state``, such as Gazebo, in [Hz]; 0: all."""

    world_frame: str = "world"
    map_frame: str = "map"
    base_frame: str = "base_link"
    """Frames above the robot; base_link is the robot's root link."""

    trails: str = ""
    """Links whose paths are published on ``trails``, separated by spaces."""

    ghost: bool = False
    """Whether the commanded configuration is published as a second robot, on
    ``commanded_joint_states`` and TF."""

    imu_link: str = "imu_in_torso"
    imu_frame: str = "body_imu"
    """A second name for the frame of the IMU, where the robot has this link."""

    def __post_init__(self) -> None:
        """Check ranges."""
        for name in ("position_threshold", "rotation_threshold"):
            check_range(self, name, 0.0, 1e3)
        for name in ("max_interval", "min_interval"):
            check_range(self, name, 0.0, 3600.0)
        check_range(self, "max_rate", 0.0, 1e6)
        _check_prefix("~frame_prefix", self.frame_prefix)
        for key in ("name", "namespace", "frame_prefix"):
            values = [getattr(robot, key) for robot in self.each_robot]
            twice = sorted({value for value in values if values.count(value) > 1})
            if twice:
                raise InvalidValueError(f"~robots has the {key} '{twice[0]}' twice.")

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
    """Where its joint_states and joint_commands are; by default its name."""

    description: str = "robot_description"
    """Parameter that holds its URDF; searched for upward from the namespace."""

    frame_prefix: str = ""
    """What stands before the names of its frames; by default the namespace and a
    slash."""

    controllers: tuple[dict, ...] = ()
    """What each of its actions moves; by default ``~controllers``."""


def _robot(number: int, entry, controllers: tuple[dict, ...]) -> RobotParameters:
    """Read one entry of ``~robots``."""
    known = [field.name for field in fields(RobotParameters)]
    name = entry.get("name") if isinstance(entry, dict) else None
    if not isinstance(name, str) or not name:
        raise InvalidValueError(
            f"~robots[{number}] is {entry!r}, it must be a dictionary with a name."
        )
    for key, value in entry.items():
        if key not in known or not isinstance(value, _KINDS.get(key, str)):
            raise InvalidValueError(
                f"~robots[{number}] has {key}: {value!r}; it may have strings for "
                f"{', '.join(known[:-1])}, and a list for {known[-1]}."
            )
    default = re.sub(r"\W", "_", name, flags=re.ASCII)
    namespace = entry.get("namespace", default).strip("/")
    if namespace and not re.fullmatch(r"[A-Za-z][\w/]*", namespace, re.ASCII):
        raise InvalidValueError(
            f"~robots[{number}] has the namespace '{namespace}', which is no ROS name."
        )
    prefix = entry.get("frame_prefix", namespace and f"{namespace}/")
    _check_prefix(f"frame_prefix of ~robots[{number}]", prefix)
    return RobotParameters(
        name,
        namespace,
        entry.get("description", RobotParameters.description),
        prefix,
        tuple(entry.get("controllers", controllers)),
    )


def _check_prefix(what: str, prefix: str) -> None:
    """Check that robot_state_publisher's tf_prefix can be the same."""
    if prefix and (prefix.startswith("/") or not prefix.endswith("/")):
        raise InvalidValueError(
            f"The {what} is '{prefix}', it must end with a slash, not begin with one."
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
        DescriptionError: If a parameter holds no robot.
        ROSInterruptException: If the node is shut down.
    """
    found = []
    parsed: dict[str, Description] = {}
    for robot in robots:
        text = _wait_for_description(robot)
        if text not in parsed:
            parsed[text] = parse_urdf(text)
        found.append((robot, parsed[text]))
    return found


def _wait_for_description(robot: RobotParameters) -> str:
    """Wait for the description of one robot; return its text."""

    def log():
        where = f"{robot.description}, from /{robot.namespace} upward"
        rospy.loginfo("Waiting for %s on the parameter %s.", robot.name, where)

    parameter = wait_for_parameter(robot.description, robot.namespace, log)
    return str(rospy.get_param(parameter))


def controllers_of(
    robot: RobotParameters, description: Description
) -> tuple[Controller, ...]:
    """Read a robot's controllers.

    Raises:
        InvalidValueError: If the parameter holds anything else.
    """
    joints = [joint.name for joint in description.movable_joints]
    return read_controllers(robot.controllers, joints, f"controllers of {robot.name}")


def topic_of(robot: RobotParameters, name: str) -> str:
    """Return the name of a robot's topic."""
    return posixpath.join(robot.namespace and f"/{robot.namespace}", name)
