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
    """Parameter with the URDF of the robot; empty: none is spawned."""

    model_name: str = "g1_robot"
    """Name of the robot."""

    x: float = 0.0
    """Initial position, in [m]."""

    y: float = 0.0
    z: float = 0.0

    on_floor: bool = False
    """Ignore ``~z`` and put the robot on the floor (z = 0)."""

    roll: float = 0.0
    """Initial orientation, in [rad]."""

    pitch: float = 0.0
    yaw: float = 0.0

    initial_pose: str = "zero"
    """Named pose at the start; the simulator takes it after a reset, too."""


@dataclass(frozen=True)
class SpawnerParameters(SpawnParameters):
    """Parameters of the node that spawns a robot in the real Gazebo."""

    respawn: bool = False
    """Keep running, and spawn the robot again in each Gazebo that replaces this
    one."""


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
    """``kinematic``, ``hold`` or ``limp``; see [physics](launch.md#physics)."""

    fixed_base: bool = False
    """Fix the root in ``hold`` and ``limp``; with ``~on_floor``, the robot hangs
    clear of the floor."""

    motors: str = ""
    """File of the [motors](motions.md#tracked-by-motors) in ``hold``; empty:
    ``config/motors.yaml`` for the G1, none for other robots."""

    world: str = ""
    """World file (SDF) to load at the start; empty: a ground plane and a sun."""

    enable_ros_network: bool = True
    """False: publish ``/clock`` only, without services and states."""

    link_states_rate: float = 0.0
    """Rate of link_states, model_states and world_state in simulated time: the
    steps at multiples of its period, and the last one of each ``~step``; 0: every
    step, in [Hz]."""

    pub_clock_frequency: float = 0.0
    """The same for ``/clock``, in [Hz]."""

    paused: bool = False
    """Start with simulated time paused."""

    strict_messages: bool = False
    """Use Gazebo's exact status messages, without additions."""

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
