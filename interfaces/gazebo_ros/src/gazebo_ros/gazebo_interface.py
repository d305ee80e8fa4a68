"""Gazebo's services as functions; names and arguments are those of gazebo_ros."""

from __future__ import annotations

import rospy
from gazebo_msgs.srv import SetModelConfiguration, SpawnModel
from geometry_msgs.msg import Pose

from g1_description.gazebo.programs.spawn_model import GazeboServices


def spawn_sdf_model_client(
    model_name: str,
    model_xml: str,
    robot_namespace: str,
    initial_pose: Pose,
    reference_frame: str,
    gazebo_namespace: str,
) -> bool:
    """Spawn a model described in SDF; wait for the simulator if it is not there.

    Args:
        model_name: Name of the model in the world.
        model_xml: SDF as XML text.
        robot_namespace: ROS namespace of the model's plugins.
        initial_pose: Pose of the model in the reference frame.
        reference_frame: A model or link; ``""`` and ``world`` are the world.
        gazebo_namespace: Namespace of the services, such as ``/gazebo``.

    Returns:
        Whether the model was spawned; the log tells why not.

    Raises:
        ROSInterruptException: If the node was shut down while waiting.
    """
    request = model_name, model_xml, robot_namespace, initial_pose, reference_frame
    return _call(gazebo_namespace, "spawn_sdf_model", SpawnModel, *request)


def spawn_urdf_model_client(
    model_name: str,
    model_xml: str,
    robot_namespace: str,
    initial_pose: Pose,
    reference_frame: str,
    gazebo_namespace: str,
) -> bool:
    """Spawn a model described in URDF, as `spawn_sdf_model_client` does with SDF."""
    request = model_name, model_xml, robot_namespace, initial_pose, reference_frame
    return _call(gazebo_namespace, "spawn_urdf_model", SpawnModel, *request)


def set_model_configuration_client(
    model_name: str,
    model_param_name: str,
    joint_names: list[str],
    joint_positions: list[float],
    gazebo_namespace: str,
) -> bool:
    """Set joint positions of a model; wait for the simulator if it is not there.

    Args:
        model_name: Name of the model in the world.
        model_param_name: Parameter with its URDF, which the simulator ignores.
        joint_names: Names of the joints to set.
        joint_positions: Position of each, in [rad] or [m].
        gazebo_namespace: Namespace of the services, such as ``/gazebo``.

    Returns:
        Whether the positions were set; the log tells why not.

    Raises:
        ROSInterruptException: If the node was shut down while waiting.
    """
    request = model_name, model_param_name, joint_names, joint_positions
    name = "set_model_configuration"
    return _call(gazebo_namespace, name, SetModelConfiguration, *request)


def _call(namespace: str, name: str, kind: type, *request) -> bool:
    """Call a service and log its answer; return whether it did what was requested."""
    try:
        response = GazeboServices(namespace).wait_and_call(name, kind, *request)
    except rospy.ServiceException as error:
        rospy.logerr("%s/%s: %s", namespace, name, error)
        return False
    rospy.loginfo("%s/%s: %s", namespace, name, response.status_message)
    return True
