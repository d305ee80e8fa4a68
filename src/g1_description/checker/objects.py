"""The objects around a robot as it is now, and the checks among them.

Subscribes, below the simulator's name: scene (std_msgs/String), object_states
    (gazebo_msgs/LinkStates)
"""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np
import rospy
from gazebo_msgs.msg import LinkStates
from std_msgs.msg import String

from g1_description.checks.checker import Checker
from g1_description.errors import G1DescriptionError
from g1_description.ros.conversions import pose_to_array
from g1_description.ros.log import ThrottledLog
from g1_description.scenes.scene import Scene
from g1_description.scenes.scene_file import objects_of_sdf


class PresentObjects:
    """Objects of a file, or those in the simulator once it has sent its own."""

    def __init__(self, file: Scene | None, gazebo: str, log: ThrottledLog) -> None:
        """Begin with the objects of the file.

        Args:
            file: Objects; what may touch and carry them holds in the simulator, too.
            gazebo: Namespace of the simulator.
            log: For messages that cannot be used.
        """
        self._file, self._log, self._lock = file, log, threading.Lock()
        self._scene = file
        self._poses: dict[str, np.ndarray] | None = None
        rospy.Subscriber(f"{gazebo}/scene", String, self._take_scene)
        rospy.Subscriber(f"{gazebo}/object_states", LinkStates, self._take_states)

    def newest(self) -> tuple[Scene | None, np.ndarray | None]:
        """Return the objects, another scene for others, and where they are now.

        Returns:
            The objects, None if there are none; T_map_object in their order, shape
            (n_objects, 7), None if they are where the scene has them.
        """
        with self._lock:
            if self._scene is None or self._poses is None:
                return self._scene, None
            poses = [self._poses[name] for name in self._scene]
            return self._scene, np.array(poses).reshape(-1, 7)

    def _take_scene(self, message: String) -> None:
        """Take all objects, with their present poses."""
        try:
            scene = Scene(objects_of_sdf(message.data))
        except G1DescriptionError as error:
            self._log.warn("scene", f"The simulator's objects are unknown: {error}")
            return
        for name in [*scene]:
            if self._file is not None and name in self._file:
                own = self._file[name]
                free, links = own.may_touch, own.attachments
                scene.replace(replace(scene[name], may_touch=free, attachments=links))
        with self._lock:
            self._scene = scene or None
            self._poses = {name: each.pose for name, each in scene.items()}

    def _take_states(self, message: LinkStates) -> None:
        """Take the poses of objects that have moved."""
        poses = {n: pose_to_array(pose) for n, pose in zip(message.name, message.pose)}
        with self._lock:
            for name in poses.keys() & (self._poses or {}).keys():
                assert self._poses is not None
                self._poses[name] = poses[name]


class CheckerAmongObjects:
    """A checker, which is another one when objects come or go."""

    def __init__(
        self, checker: Checker, objects: PresentObjects, visual_hulls: bool
    ) -> None:
        """Begin.

        Args:
            checker: Checks without objects.
            objects: The objects.
            visual_hulls: Whether what has no collision shapes uses the convex hulls of
                its visuals.

        Raises:
            UnknownNameError: If a link that carries or may touch an object is unknown.
        """
        self._checker, self._objects = checker, objects
        self._visual_hulls = visual_hulls
        self._scene: Scene | None = None
        self.newest()

    def newest(self) -> tuple[Checker, np.ndarray | None]:
        """Return the checker of the present objects, and their poses as it takes them.

        Raises:
            UnknownNameError: As when it begins.
        """
        scene, poses = self._objects.newest()
        if scene is not self._scene:
            self._checker = self._checker.among(scene, self._visual_hulls)
            self._scene = scene
        return self._checker, poses
