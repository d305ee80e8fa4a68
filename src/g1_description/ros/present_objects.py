"""The objects in a simulator, as they are now.

Subscribes, below the simulator's name: scene (std_msgs/String), object_states
    (gazebo_msgs/LinkStates)
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import replace
from typing import Callable

import numpy as np
import rospy
from gazebo_msgs.msg import LinkStates
from std_msgs.msg import String

from g1_description.errors import G1DescriptionError
from g1_description.robot.description import Description
from g1_description.ros.conversions import pose_to_array
from g1_description.scenes.carried import of_robot
from g1_description.scenes.scene import Scene
from g1_description.scenes.scene_file import objects_of_yaml


class PresentObjects:
    """The objects of a simulator."""

    def __init__(
        self,
        gazebo: str,
        refuse: Callable[[str], object],
        came: Callable[[], object] = lambda: None,
    ) -> None:
        """Begin without objects, and subscribe.

        Args:
            gazebo: Namespace of the simulator.
            refuse: Called with a sentence on objects that cannot be read.
            came: Called by rospy's threads when objects come, go or move.
        """
        self._refuse, self._came = refuse, came
        self._lock = threading.Lock()
        self._scene: Scene | None = None
        self._poses: dict[str, np.ndarray] = {}
        self._moved: dict[str, np.ndarray] = {}
        """Poses that came since the last scene."""
        name = "/" + gazebo.strip("/")
        self._subscribers = (
            rospy.Subscriber(f"{name}/scene", String, self._take_scene),
            rospy.Subscriber(f"{name}/object_states", LinkStates, self._take_states),
        )

    def newest(self) -> tuple[Scene | None, Mapping[str, np.ndarray]]:
        """Return the objects, and where they are.

        Returns:
            The scene, another one for other objects or attachments, None before the
            first; and T_map_object, shape (7,), by name. What links of any robot carry
            now is attached to them at all times; see ``carried.of_robot``.
        """
        with self._lock:
            return self._scene, self._poses

    def placed(self, robot: Description, model: str = "") -> Scene | None:
        """Return the objects where they are around a robot, which carries some of them.

        Args:
            robot: The robot.
            model: Its name in the simulator; empty: it is not known.

        Returns:
            A scene; None before the first.
        """
        scene, poses = self.newest()
        if scene is None:
            return None
        now = [replace(each, pose=poses[n]) for n, each in scene.items()]
        return Scene([*of_robot(now, robot, model)])

    def close(self) -> None:
        """Unsubscribe."""
        for subscriber in self._subscribers:
            subscriber.unregister()

    def _take_scene(self, message: String) -> None:
        """Take all objects, with their present poses."""
        with self._lock:
            self._moved = {}
        try:
            scene = Scene(objects_of_yaml(message.data))
        except G1DescriptionError as error:
            self._refuse(f"The objects of the simulator cannot be read: {error}")
            return
        with self._lock:
            self._scene = scene
            old = {name: each.pose for name, each in scene.items()}
            # What moved while this was read is newer.
            self._poses = {
                name: self._moved.get(name, pose) for name, pose in old.items()
            }
        self._came()

    def _take_states(self, message: LinkStates) -> None:
        """Take the poses of objects that have moved."""
        poses = {n: pose_to_array(pose) for n, pose in zip(message.name, message.pose)}
        with self._lock:
            self._moved.update(poses)
            known = {name: pose for name, pose in poses.items() if name in self._poses}
            self._poses = {**self._poses, **known}
        self._came()
