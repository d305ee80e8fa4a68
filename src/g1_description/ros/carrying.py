"""Objects of a scene that links of a robot in the simulator carry during a motion.

Calls: attach_object (g1_description/AttachObject), detach_object
    (g1_description/DetachObject), set_model_state (gazebo_msgs/SetModelState), below
    /gazebo
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import rospy
from gazebo_msgs.msg import ModelState
from gazebo_msgs.srv import SetModelState

from g1_description.choices import GAZEBO
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description
from g1_description.robot.transform import IDENTITY
from g1_description.ros.conversions import pose_from_array
from g1_description.scenes.carried import (
    holds_of,
    motion_links,
    named_link,
    object_poses,
)
from g1_description.scenes.scene import Scene
from g1_description.srv import AttachObject, DetachObject


class Carrying:
    """Attaches objects to links, and lets them go, at their times."""

    def __init__(
        self,
        scene: Scene,
        robot: Description,
        motion: Motion,
        model: str,
        notify: Callable[[str], None],
        base: np.ndarray = IDENTITY,
    ) -> None:
        """Plan what is carried when; nothing is attached yet.

        Args:
            scene: The scene, whose objects are in the simulator.
            robot: The robot.
            motion: Its motion.
            model: Name of its model in the simulator; empty: the one that has the link.
            notify: Called with messages on what cannot be carried.
            base: T_map_base of a motion without poses of the base, shape (7,).

        Raises:
            UnknownNameError: If the robot lacks a link.
        """
        self._objects = [each for each in scene.values() if each.attachments]
        self._links = motion_links(robot, motion, base)
        self._holds = holds_of(self._objects, robot, self._links)
        self._names = {
            one.link: named_link(robot, one.link, each.name)
            for each in self._objects
            for one in each.attachments
        }
        self._model, self._notify = model, notify
        self._carriers = dict.fromkeys((each.name for each in self._objects), "")
        self._time = -np.inf
        self._given_up: set[str] = set()

    def __bool__(self) -> bool:
        return bool(self._objects)

    def show(self, time: float) -> None:
        """Let links carry what they do at a time of the motion, in [s].

        Where time went back, objects are placed where they are then.
        """
        if time < self._time:
            self._place(time)
        self._time = time
        for each in self._objects:
            links = [a.link for a in each.attachments if a.begin <= time < a.end]
            link = self._names[links[0]] if links else ""
            if link != self._carriers[each.name]:
                self._carriers[each.name] = link
                self._carry(each.name, link)

    def _place(self, time: float) -> None:
        """Let all objects go, and place them where they are at a time."""
        poses = object_poses(self._holds, np.array([time]), self._links)[0]
        for each, pose in zip(self._objects, poses):
            if self._carriers[each.name]:
                self._carry(each.name, "")
            self._carriers[each.name] = ""
            state = ModelState(model_name=each.name, pose=pose_from_array(pose))
            self._call(each.name, "set_model_state", SetModelState, state)

    def _carry(self, name: str, link: str) -> None:
        """Let a link carry an object; empty: none."""
        if link:
            self._call(name, "attach_object", AttachObject, name, self._model, link)
        else:
            self._call(name, "detach_object", DetachObject, name)

    def _call(self, name: str, service: str, kind: Any, *arguments: Any) -> None:
        """Call a service of the simulator; one message for each object."""
        if name in self._given_up:
            return
        try:
            answer = rospy.ServiceProxy(f"{GAZEBO}/{service}", kind)(*arguments)
            failure = "" if answer.success else answer.status_message
        except (rospy.ServiceException, OSError) as error:
            failure = str(error)
        if failure:
            self._given_up.add(name)
            self._notify(f"{name} is not carried: {failure.rstrip('.')}.")
