"""Parameters of the node ``gazebo``, and the pose of its robot."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from g1_description.choices import ZERO
from g1_description.robot.assembly import Assembly
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.poses import check_pose, find_pose, pose_positions, read_poses
from g1_description.robot.rotation import from_rpy
from g1_description.ros.parameters import NAMESPACE, check_range, read_robot
from g1_description.sim.engine import PhysicsProperties
from g1_description.sim.standing import hanging_height, standing_height

INITIAL = "initial/"
"""Namespace of initial values; dynamic_reconfigure owns the bare names."""


@dataclass(frozen=True)
class SpawnParameters:
    """A robot to spawn, its pose and its configuration.

    One without a docstring is an argument of launch files, whose ``doc`` describes it.
    """

    robot_description: str = ""
    """Name of the parameter with the robot's URDF; empty: no robot is spawned."""

    model_name: str = "g1_robot"
    """Name of the robot."""

    x: float = 0.0
    """Initial position, in [m]."""

    y: float = 0.0
    z: float = 0.0
    """Height, in [m]."""

    on_floor: bool = False
    """Ignore ``~z`` and put the robot on the floor (z = 0)."""

    roll: float = 0.0
    """Initial orientation, in [rad]."""

    pitch: float = 0.0
    yaw: float = 0.0

    initial_pose: str = "zero"

    anchor: str = ""


@dataclass(frozen=True)
class SpawnerParameters(SpawnParameters):
    """Parameters of the node that spawns a robot in the real Gazebo."""

    respawn: bool = False
    """Keep running, and spawn the robot again after an error, and in each Gazebo that
    replaces this one."""


@dataclass(frozen=True)
class GazeboParameters:
    """Parameters of the node ``gazebo``.

    One without a docstring is an argument of launch files, whose ``doc`` describes it.
    """

    spawn: SpawnParameters = field(default_factory=SpawnParameters)
    """The robot to spawn at start."""

    properties: PhysicsProperties = field(
        default_factory=PhysicsProperties, metadata={NAMESPACE: INITIAL}
    )
    """Initial physics properties, which override those of a world file."""

    physics: str = "kinematic"

    engine: str = "bullet"

    fixed_base: bool = False

    motors: str = ""

    world: str = ""
    """World file (SDF) to load at the start; empty: a ground plane and a sun."""

    enable_ros_network: bool = True
    """False: publish ``/clock`` only, without services and states."""

    link_states_rate: float = 0.0
    """Rate of link_states and the other states in simulated time; the last step of
    each ``~step`` is published, too; 0: every step, in [Hz]."""

    pub_clock_frequency: float = 0.0
    """Rate of ``/clock``; 0: every step, in [Hz]."""

    paused: bool = False

    strict_messages: bool = False
    """Use exactly Gazebo's status messages, without additional details."""

    def __post_init__(self) -> None:
        """Check ranges."""
        check_range(self, "link_states_rate", 0.0, 1e6)
        check_range(self, "pub_clock_frequency", 0.0, 1e6)


def place_robot(
    parameters: SpawnParameters, hangs: bool = False, is_dynamic: bool = True
) -> tuple[Assembly, np.ndarray]:
    """Read a robot and compute its initial state.

    Args:
        parameters: The robot, its pose and its configuration.
        hangs: Whether ``on_floor`` means hanging clear of the floor.
        is_dynamic: Whether physics moves it.

    Returns:
        The robot with its initial joint positions, and the pose of its model frame in
        the world, shape (7,).

    Raises:
        G1DescriptionError: If there is no such robot or pose, or they don't match.
    """
    p = parameters
    description = read_robot(p.robot_description)
    assembly = lump_fixed_joints(description, is_dynamic)
    if p.initial_pose != ZERO:
        pose = find_pose(p.initial_pose, read_poses(description))
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
