"""Where a robot begins, and in which pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import rospy

from g1_description.errors import DescriptionError
from g1_description.gazebo.parameters import SpawnParameters
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
from g1_description.sim.standing import hanging_height, standing_height


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
