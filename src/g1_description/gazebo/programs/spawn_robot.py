"""Spawns the robot of the launch files in Gazebo, on its feet and in a named pose.

Gazebo sets joints only after a model was spawned, so physics is paused meanwhile:
otherwise the robot would start to fall with its joints at zero.

Calls: spawn_urdf_model (gazebo_msgs/SpawnModel), set_model_configuration
    (gazebo_msgs/SetModelConfiguration), get_joint_properties
    (gazebo_msgs/GetJointProperties), get_physics_properties
    (gazebo_msgs/GetPhysicsProperties), pause_physics and unpause_physics
    (std_srvs/Empty), delete_model (gazebo_msgs/DeleteModel), set_anchor
    (g1_description/SetAnchor), below /gazebo
Parameters: those of parameters.SpawnerParameters
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from contextlib import suppress

import rosgraph
import rospy
from gazebo_msgs.srv import (
    DeleteModel,
    GetJointProperties,
    GetPhysicsProperties,
    SetModelConfiguration,
    SpawnModel,
)
from std_srvs.srv import Empty

from g1_description.choices import GAZEBO
from g1_description.errors import G1DescriptionError
from g1_description.gazebo.parameters import (
    SpawnerParameters,
    SpawnParameters,
    place_robot,
)
from g1_description.gazebo.programs.spawn_model import LOAD_TIME, GazeboServices
from g1_description.robot.assembly import SCOPE
from g1_description.ros.conversions import pose_from_array
from g1_description.ros.lifecycle import start_node
from g1_description.ros.parameters import read_parameters
from g1_description.ros.waiting import wait_until
from g1_description.srv import SetAnchor

SERVICES = (
    "spawn_urdf_model",
    "get_physics_properties",
    "pause_physics",
    "set_model_configuration",
    "get_joint_properties",
    "unpause_physics",
)
"""Gazebo advertises one after the other; nothing is called before all are there."""

SET_TIMEOUT = 10.0
"""Longest wait for joints to be where they were set, in [s]."""

TOLERANCE = 1e-3
"""Distance of a joint from where it was set, in [rad] or [m]."""

WATCH_PERIOD = 1.0
"""Time between two checks for a new Gazebo in [s]."""

RETRY_PERIOD = 5.0
"""Time from an error to the next attempt in the same Gazebo, in [s]."""


def spawn(parameters: SpawnParameters, gazebo: GazeboServices) -> None:
    """Spawn the robot.

    Raises:
        G1DescriptionError: If there is no such robot or pose.
        ROSInterruptException: If the node was shut down meanwhile.
        ServiceException: If Gazebo refuses.
    """
    p = parameters
    assembly, pose = place_robot(p)
    model = p.model_name, rospy.get_param(p.robot_description), rospy.get_namespace()
    at = pose_from_array(pose), ""
    gazebo.wait_for(*SERVICES)
    begin = assembly.positions
    if not begin:
        _log(gazebo.call("spawn_urdf_model", SpawnModel, *model, *at))
        _set_anchor(p, gazebo)
        return
    # Gazebo has no joints of links that were lumped or have no mass.
    known = {joint.name for joint in assembly.description.movable_joints}
    begin = {name: value for name, value in begin.items() if name in known}
    physics = gazebo.call("get_physics_properties", GetPhysicsProperties)
    gazebo.call("pause_physics", Empty)
    try:
        _log(gazebo.call("spawn_urdf_model", SpawnModel, *model, *at))
        _set_joints(p.model_name, begin, gazebo)
    finally:
        if not physics.pause:
            gazebo.call("unpause_physics", Empty)
    _set_anchor(p, gazebo)


def _set_joints(
    model: str, positions: Mapping[str, float], gazebo: GazeboServices
) -> None:
    """Set joints of a new model until they read so; delete it if they never do.

    Gazebo answers with success while it loads a model, and loses the positions.

    Raises:
        ServiceException: If Gazebo refuses, or a joint is elsewhere after
            ``SET_TIMEOUT``.
    """
    request = model, "", [*positions], [*positions.values()]
    off = ""

    def read(joint: str) -> float:
        try:
            name = f"{model}{SCOPE}{joint}"
            answer = gazebo.call("get_joint_properties", GetJointProperties, name)
        except rospy.ServiceException:  # not loaded yet
            return math.nan
        return answer.position[0]

    def are_set() -> bool:
        nonlocal off
        each = positions.items()
        off = next((j for j, at in each if not abs(read(j) - at) < TOLERANCE), "")
        if off:
            _log(
                gazebo.call("set_model_configuration", SetModelConfiguration, *request)
            )
        return not off

    rospy.rostime.wallsleep(LOAD_TIME)
    try:
        if wait_until(are_set, SET_TIMEOUT, period=LOAD_TIME):
            return
        raise rospy.ServiceException(
            f"Gazebo has not set {off} of {model} to {positions[off]:g} within "
            f"{SET_TIMEOUT:g} s; the robot is deleted again"
        )
    except rospy.ServiceException:  # its straight legs may be in the floor
        with suppress(rospy.ServiceException):
            gazebo.call("delete_model", DeleteModel, model)
        raise


def _set_anchor(parameters: SpawnParameters, gazebo: GazeboServices) -> None:
    """Set the anchor, or log why there is none."""
    if not parameters.anchor:
        return
    try:
        gazebo.call("set_anchor", SetAnchor, parameters.model_name, parameters.anchor)
    except rospy.ServiceException as error:
        rospy.logwarn(
            "The anchor of %s is ignored, which needs the simulator of this package: "
            "%s",
            parameters.model_name,
            error,
        )


def spawn_in_each(parameters: SpawnParameters, gazebo: GazeboServices) -> None:
    """Spawn the robot now, and again in each Gazebo that replaces this one.

    Returns when the node is shut down.

    Raises:
        G1DescriptionError: If there is no such robot or pose.
        ROSInterruptException: If the node was shut down before the robot was spawned.
    """
    while True:
        gazebo.wait_for("spawn_urdf_model")
        known = address_of_gazebo()  # before spawning: Gazebo may be replaced meanwhile
        wait = None
        try:
            spawn(parameters, gazebo)
        except rospy.ServiceException as error:
            reason = str(error).rstrip(".")
            if "already exist" in reason:  # no attempt can change that
                rospy.logerr("%s.", reason)
            else:
                rospy.logerr("%s. Trying again in %g s.", reason, RETRY_PERIOD)
                wait = RETRY_PERIOD
        try:
            is_another = wait_for_another(known, wait)
        except rospy.ROSInterruptException:
            return
        if is_another:
            rospy.loginfo("Gazebo was restarted; the robot is spawned again.")


def wait_for_another(known: str | None, timeout: float | None) -> bool:
    """Wait until Gazebo's node has another address; return whether it has."""
    return wait_until(
        lambda: address_of_gazebo() not in (None, known), timeout, period=WATCH_PERIOD
    )


def address_of_gazebo() -> str | None:
    """Look up the address of Gazebo's node, unique to a process."""
    try:
        return rosgraph.Master(rospy.get_name()).lookupNode(GAZEBO)
    except (OSError, rosgraph.MasterException):
        return None


def _log(response) -> None:
    """Log the status message of a response."""
    rospy.loginfo("%s", response.status_message)


def main() -> None:
    """Run the node ``spawn_urdf``."""
    try:
        start_node("spawn_urdf")
        parameters = read_parameters(SpawnerParameters)
        act = spawn_in_each if parameters.respawn else spawn
        act(parameters, GazeboServices(GAZEBO))
    except rospy.ROSInterruptException:
        sys.exit("spawn_robot: interrupted before the robot was spawned.")
    except (G1DescriptionError, rospy.ServiceException) as error:
        rospy.logerr("%s", error)
        sys.exit(1)
    except ConnectionError as error:
        sys.exit(f"spawn_robot: The ROS master does not answer: {error}.")
