"""Keeps the objects of MoveIt's planning scene in Gazebo.

Subscribes: planning_scene (moveit_msgs/PlanningScene), collision_object
    (moveit_msgs/CollisionObject), attached_collision_object
    (moveit_msgs/AttachedCollisionObject), and TF for their frames
Calls: spawn_sdf_model (gazebo_msgs/SpawnModel), delete_model (gazebo_msgs/DeleteModel),
    set_model_state (gazebo_msgs/SetModelState), attach_object
    (g1_description/AttachObject), detach_object (g1_description/DetachObject), below
    /gazebo
"""

from __future__ import annotations

import sys
import threading
from typing import Any

import rospy
from gazebo_msgs.msg import ModelState
from gazebo_msgs.srv import DeleteModel, SetModelState, SpawnModel
from roslib.message import get_message_class

from g1_description.choices import GAZEBO
from g1_description.errors import G1DescriptionError
from g1_description.gazebo.programs.spawn_model import GazeboServices
from g1_description.robot.transform import IDENTITY
from g1_description.ros.conversions import pose_from_array
from g1_description.ros.lifecycle import start_node
from g1_description.ros.map_frame import MapFrame
from g1_description.scenes.moveit import frames_of
from g1_description.scenes.objects import SceneObject
from g1_description.scenes.scene import Scene
from g1_description.scenes.scene_file import sdf_model
from g1_description.srv import AttachObject, DetachObject

KINDS = ("PlanningScene", "CollisionObject", "AttachedCollisionObject")
TOPICS = ("planning_scene", "collision_object", "attached_collision_object")


class PlanningScene:
    """The objects of MoveIt, as models of Gazebo."""

    def __init__(self, gazebo: GazeboServices) -> None:
        self._gazebo, self._map = gazebo, MapFrame()
        self._scene, self._lock = Scene(), threading.Lock()

    def take(self, message: Any) -> None:
        """Change the models as a message says; log what cannot be used."""
        with self._lock:
            before, scene = self._scene, self._scene.copy()
            try:
                frames = {
                    name: self._map.pose_in_map(IDENTITY, name, rospy.Time())
                    for name in frames_of(message, before)
                }
                scene.apply(message, frames)
            except G1DescriptionError as error:
                rospy.logwarn("A message of MoveIt is not used: %s", error)
                return
            self._scene = scene
            for name in before:
                if name not in scene:
                    self._call(name, "delete_model", DeleteModel, name)
            for name, each in scene.items():
                if each is not before.get(name):
                    self._change(before.get(name), each)

    def _change(self, before: SceneObject | None, each: SceneObject) -> None:
        """Spawn a model, or move, attach or detach it."""
        name, pose, text = each.name, pose_from_array(each.pose), _text(each)
        if before is not None and _text(before) != text:
            self._call(name, "delete_model", DeleteModel, name)
            before = None
        held = () if before is None else before.attachments
        is_let_go = bool(held) and not each.attachments  # where it is
        if before is None:
            self._call(name, "spawn_sdf_model", SpawnModel, name, text, "", pose, "")
        elif (before.pose != each.pose).any() and not is_let_go:
            state = ModelState(model_name=name, pose=pose)
            self._call(name, "set_model_state", SetModelState, state)
        if each.attachments and each.attachments != held:
            link = each.attachments[0].link
            self._call(name, "attach_object", AttachObject, name, "", link)
        elif is_let_go:
            self._call(name, "detach_object", DetachObject, name)

    def _call(self, name: str, service: str, kind: Any, *arguments: Any) -> None:
        """Call a service; log a refusal."""
        try:
            self._gazebo.call(service, kind, *arguments)
        except rospy.ServiceException as error:
            rospy.logerr(
                "The object %s of MoveIt: %s refuses: %s", name, service, error
            )


def _text(each: SceneObject) -> str:
    """Write an object as a model, without its place."""
    return sdf_model(each.name, {"link": each}, each.pose)


def main() -> None:
    """Run the node ``planning_scene``."""
    kinds = [get_message_class(f"moveit_msgs/{kind}") for kind in KINDS]
    if None in kinds:
        sys.exit(
            "planning_scene: moveit_msgs, with MoveIt's messages, is not installed."
        )
    try:
        start_node("planning_scene")
        gazebo = GazeboServices(GAZEBO)
        gazebo.wait_for("spawn_sdf_model")
        scene = PlanningScene(gazebo)
        for topic, kind in zip(TOPICS, kinds):
            rospy.Subscriber(topic, kind, scene.take, queue_size=100)
        rospy.spin()
    except rospy.ROSInterruptException:
        return
