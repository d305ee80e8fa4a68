"""Spawns the objects of a scene in Gazebo, as any other program could.

Calls: get_world_properties (gazebo_msgs/GetWorldProperties), spawn_sdf_model
    (gazebo_msgs/SpawnModel), below /gazebo
Parameters: those of SceneParameters
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import rospy
from gazebo_msgs.srv import GetWorldProperties, SpawnModel

from g1_description.choices import GAZEBO
from g1_description.errors import G1DescriptionError
from g1_description.gazebo.programs.spawn_model import GazeboServices
from g1_description.gazebo.programs.spawn_robot import (
    address_of_gazebo,
    wait_for_another,
)
from g1_description.robot.assembly import SCOPE
from g1_description.ros.conversions import pose_from_array
from g1_description.ros.lifecycle import start_node
from g1_description.ros.parameters import read_parameters
from g1_description.scenes.objects import SceneObject
from g1_description.scenes.scene import Scene
from g1_description.scenes.scene_file import sdf_model

FLOOR = "ground_plane"
"""Name of the floor in worlds of Gazebo."""


@dataclass(frozen=True)
class SceneParameters:
    """Parameters of the node that spawns a scene.

    One without a docstring is an argument of launch files, whose ``doc`` describes it.
    """

    scene: str = ""

    respawn: bool = False
    """Keep running, and spawn the objects again in each Gazebo that replaces this one.
    """


def models_of(scene: Scene) -> Iterator[tuple[str, np.ndarray, str]]:
    """List the models of a scene: ``model::link`` is a link of a model.

    Returns:
        The name of each, its pose in the map, shape (7,), and its SDF.
    """
    models: dict[str, dict[str, SceneObject]] = {}
    for name, each in scene.items():
        model, _, link = name.partition(SCOPE)
        models.setdefault(model, {})[link or "link"] = each
    for name, links in models.items():
        pose = next(iter(links.values())).pose
        yield name, pose, sdf_model(name, links, pose)


def spawn(scene: Scene, gazebo: GazeboServices) -> None:
    """Spawn the models of a scene; log those that are refused.

    Raises:
        ROSInterruptException: If the node was shut down meanwhile.
    """
    spawned = 0
    there = gazebo.call("get_world_properties", GetWorldProperties).model_names
    for name, pose, text in models_of(scene):
        if name == FLOOR and name in there:  # worlds have one, as Gazebo's own
            continue
        try:
            gazebo.call(
                "spawn_sdf_model", SpawnModel, name, text, "", pose_from_array(pose), ""
            )
            spawned += 1
        except rospy.ServiceException as error:
            rospy.logerr("%s of the scene is not spawned: %s", name, error)
    rospy.loginfo("%d models of the scene are spawned.", spawned)


def main() -> None:
    """Run the node ``spawn_scene``."""
    try:
        start_node("spawn_scene")
        parameters = read_parameters(SceneParameters)
        scene, gazebo = Scene.read(parameters.scene), GazeboServices(GAZEBO)
        for note in scene.notes:
            rospy.logwarn("%s: %s.", parameters.scene, note)
        while True:
            gazebo.wait_for("spawn_sdf_model")
            known = address_of_gazebo()
            spawn(scene, gazebo)
            if not parameters.respawn or not wait_for_another(known, None):
                return
    except rospy.ROSInterruptException:
        return
    except (G1DescriptionError, rospy.ServiceException) as error:
        rospy.logerr("%s", error)
        sys.exit(1)
    except ConnectionError as error:
        sys.exit(f"spawn_scene: The ROS master does not answer: {error}.")
