"""Objects of a scene that links of a robot in the simulator carry during a motion.

Calls: attach_object (g1_description/AttachObject), detach_object
    (g1_description/DetachObject), set_model_state (gazebo_msgs/SetModelState),
    set_link_state (gazebo_msgs/SetLinkState), below /gazebo
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import rospy
from gazebo_msgs.msg import LinkState, ModelState
from gazebo_msgs.srv import SetLinkState, SetModelState

from g1_description.choices import GAZEBO
from g1_description.motion.motion import Motion
from g1_description.robot.assembly import SCOPE, rigid_frames
from g1_description.robot.description import Description
from g1_description.robot.transform import IDENTITY, compose
from g1_description.ros.conversions import pose_from_array
from g1_description.scenes.carried import (
    applying,
    holds_of,
    motion_links,
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
        shift: np.ndarray = IDENTITY,
    ) -> None:
        """Plan what is carried when; nothing is attached yet.

        Args:
            scene: The scene, whose objects are in the simulator.
            robot: The robot.
            motion: Its whole motion, to which the scene belongs.
            model: Name of its model in the simulator; empty: the one that has the link.
            notify: Called with messages on what cannot be carried.
            base: T_map_base of a motion without poses of the base, shape (7,).
            shift: T_map_motion of the motion as it is played, shape (7,): what is
                carried at any time moves with it.

        Raises:
            UnknownNameError: If the robot lacks a link.
        """
        self._objects = [each for each in scene.values() if each.attachments]
        self._links = motion_links(robot, motion, base)
        self._holds = holds_of(self._objects, robot, self._links)
        self._bodies = {
            link: body
            for tree in robot.trees
            for link, body in rigid_frames(tree).items()
        }
        self._shift, self._model, self._notify = shift, model, notify
        self._carriers = dict.fromkeys((each.name for each in self._objects), "")
        self._time = -np.inf
        self._given_up: set[str] = set()

    def __bool__(self) -> bool:
        return bool(self._objects)

    def show(self, time: float) -> None:
        """Let links carry what they do at a time of the motion, in [s].

        At first, and where time went back, objects are placed where they are then.
        """
        is_new = time < self._time or self._time == -np.inf
        poses = object_poses(self._holds, np.array([time]), self._links)[0]
        self._time = time
        for each, holds, pose in zip(self._objects, self._holds, poses):
            hold, name = holds[applying(holds, np.array([time]))[0]], each.name
            if is_new:
                self._call(name, "detach_object", DetachObject, name, must=False)
                self._carriers[name] = ""
                self._put(name, compose(self._shift, pose))
            if hold.link != self._carriers[name]:
                self._carriers[name] = hold.link
                self._carry(name, hold.link)
                if is_new:
                    body, frame = self._bodies[hold.link]
                    scope = f"{self._model}{SCOPE}" if self._model else ""
                    self._put(name, compose(frame, hold.pose), scope + body)

    def _put(self, name: str, pose: np.ndarray, frame: str = "") -> None:
        """Place an object in the frame of a link; empty: in the map."""
        given = {"pose": pose_from_array(pose), "reference_frame": frame}
        if SCOPE in name:
            link = LinkState(link_name=name, **given)
            self._call(name, "set_link_state", SetLinkState, link, must=False)
        else:
            model = ModelState(model_name=name, **given)
            self._call(name, "set_model_state", SetModelState, model, must=False)

    def _carry(self, name: str, link: str) -> None:
        """Let a link carry an object; empty: none."""
        if link:
            self._call(name, "attach_object", AttachObject, name, self._model, link)
        else:
            self._call(name, "detach_object", DetachObject, name)

    def _call(
        self, name: str, service: str, kind: Any, *arguments: Any, must: bool = True
    ) -> None:
        """Call a service of the simulator; one message for each object that must."""
        if name in self._given_up:
            return
        try:
            answer = rospy.ServiceProxy(f"{GAZEBO}/{service}", kind)(*arguments)
            failure = "" if answer.success else answer.status_message
        except (rospy.ServiceException, OSError) as error:
            failure = str(error)
        if failure and must:
            self._given_up.add(name)
            self._notify(f"{name} is not carried: {failure.rstrip('.')}.")
