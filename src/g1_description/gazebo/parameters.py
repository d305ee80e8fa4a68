"""Parameters of the simulator's node, and where its robot is spawned."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import rospy

from g1_description.errors import DescriptionError
from g1_description.robot.assembly import Assembly
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.poses import (
    ZERO,
    check_pose,
    find_pose,
    pose_positions,
    read_poses,
)
from g1_description.robot.rotation import from_rpy
from g1_description.robot.urdf import parse_urdf
from g1_description.ros.parameters import NAMESPACE, check_range
from g1_description.sim.engine import PhysicsProperties
from g1_description.sim.standing import hanging_height, standing_height

INITIAL = "initial/"
"""Namespace of initial values; dynamic_reconfigure owns the bare names."""


@dataclass(frozen=True)
class SpawnParameters:
    """A robot to spawn, where, and in which pose."""

    robot_description: str = ""
    """Parameter that holds the URDF of a robot to spawn at start; empty: none."""

    model_name: str = "g1_robot"
    """Name of that robot in the world."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    """Where that robot is spawned in [m]."""

    on_floor: bool = False
    """Whether it is put so high, instead of z, that it stands on the floor (z = 0)."""

    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0
    """How that robot is turned about the fixed axes in [rad]."""

    initial_pose: str = "zero"
    """Name of the pose that it begins in; zero: all joints at 0."""


@dataclass(frozen=True)
class SpawnerParameters(SpawnParameters):
    """Parameters of the node that spawns a robot in the real Gazebo."""

    respawn: bool = False
    """Whether to stay, and spawn the robot in each new Gazebo."""


@dataclass(frozen=True)
class GazeboParameters:
    """Parameters of the stand-in."""

    spawn: SpawnParameters = field(default_factory=SpawnParameters)
    """The robot to spawn at start."""

    properties: PhysicsProperties = field(
        default_factory=PhysicsProperties, metadata={NAMESPACE: INITIAL}
    )
    """The physics' initial numbers, in Gazebo's words. They win over a world file."""

    physics: str = "kinematic"
    """kinematic: what is set stays set; hold: motors hold the joints; limp: no
    motors."""

    fixed_base: bool = False
    """Whether that robot's root link does not move in hold and limp. With on_floor it
    hangs there so high that no joint can bring the robot to the floor."""

    motors: str = ""
    """File of the motors that drive joints in hold, of any robot; empty: the package's,
    for the G1 alone."""

    world: str = ""
    """World file (SDF) to load at start; empty: a ground plane and a sun."""

    enable_ros_network: bool = True
    """Whether there are services, link_states and model_states; /clock always is."""

    link_states_rate: float = 0.0
    """Least rate of link_states and model_states per simulated second in [Hz]; each
    n-th step is published, 0: every step."""

    pub_clock_frequency: float = 0.0
    """Least rate of /clock per simulated second in [Hz]; each n-th step is published,
    0: every step."""

    paused: bool = False
    """Whether time stands still at first."""

    strict_messages: bool = False
    """Whether status messages are Gazebo's bare words, without what we add."""

    def __post_init__(self) -> None:
        """Check ranges."""
        check_range(self, "link_states_rate", 0.0, 1e6)
        check_range(self, "pub_clock_frequency", 0.0, 1e6)


def place_robot(
    parameters: SpawnParameters, hangs: bool = False, is_dynamic: bool = True
) -> tuple[Assembly, np.ndarray]:
    """Read a robot and find where it begins.

    Args:
        parameters: Which robot, where and in which pose.
        hangs: Whether it is put clear of the floor where it would be put on it.
        is_dynamic: Whether things move by themselves where it is put.

    Returns:
        The robot, its joints where the pose has them, and the pose of its model
        frame in the world, shape (7,).

    Raises:
        G1DescriptionError: If there is no such robot or pose, or they don't match.
    """
    p = parameters
    urdf = rospy.get_param(p.robot_description, None)
    if not isinstance(urdf, str):
        raise DescriptionError(
            f"There is no robot on the parameter {p.robot_description}."
        )
    description = parse_urdf(urdf)
    assembly = lump_fixed_joints(description, is_dynamic)
    if p.initial_pose != ZERO:
        pose = find_pose(p.initial_pose, read_poses())
        check_pose(pose, description)
        names = (joint.name for joint in description.movable_joints)
        begin = pose_positions(pose, description).tolist()
        assembly = replace(assembly, positions=dict(zip(names, begin)))
    elif not is_dynamic:
        assembly = assembly.inside_limits()
    rotation = from_rpy(np.array([p.roll, p.pitch, p.yaw]))
    height = hanging_height if hangs else standing_height
    z = height(assembly, rotation) if p.on_floor else p.z
    return assembly, np.concatenate([[p.x, p.y, z], rotation])
