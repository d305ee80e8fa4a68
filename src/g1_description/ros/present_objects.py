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
from g1_description.ros.waiting import wait_until
from g1_description.scenes.carried import scene_around
from g1_description.scenes.objects import SceneObject
from g1_description.scenes.scene import Scene
from g1_description.scenes.scene_file import objects_of_yaml

TIMEOUT = 5.0
"""Longest wait for the first objects, in [s]."""


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
            now is attached to them at all times; see ``scene_around``.
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
        return scene_around(now, robot, model)

    def wait(self) -> None:
        """Wait for the first objects of a simulator that publishes some."""
        topics = [name for name, _ in rospy.get_published_topics()]
        if self._subscribers[0].resolved_name in topics:
            wait_until(lambda: self.newest()[0] is not None, TIMEOUT)

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


class RecordedObjects:
    """The objects of a simulator as a recording begins, and what carries them when."""

    def __init__(
        self, gazebo: str, robot: Description, model: str, notify: Callable[[str], None]
    ) -> None:
        """Subscribe.

        Args:
            gazebo: Namespace of the simulator.
            robot: The robot that is recorded.
            model: Its name in the simulator; empty: it is not known.
            notify: Called with messages on objects that cannot be read.
        """
        self._of = robot, model
        self._seen: Scene | None = None
        self._objects: dict[str, SceneObject] = {}
        self._links: dict[str, list[tuple[float, str]]] = {}
        """Times at which other links carry objects, and these; empty: none."""
        self._present = PresentObjects(gazebo, notify, self._look)

    def begin(self) -> None:
        """Take the objects as they are when the recording begins."""
        self._present.wait()
        scene = self._present.placed(*self._of) or Scene()
        self._links = {name: [(-np.inf, _carrier(scene, name))] for name in scene}
        self._objects = dict(scene)
        self._look()

    def _look(self) -> None:
        """Find what is carried by other links than before."""
        now, scene = rospy.get_time(), self._present.newest()[0]
        if scene is self._seen or scene is None:
            return
        self._seen = scene
        own = scene_around(scene.values(), *self._of)
        for name, some in self._links.items():
            link = _carrier(own, name)
            if link != some[-1][1] and now >= some[-1][0]:  # a reset ends recordings
                some.append((now, link))

    def scene(self, begin: float, end: float) -> Scene:
        """Return the scene of a recording between times in [s], and unsubscribe."""
        self._present.close()
        scene = Scene([*self._objects.values()])
        for name, some in self._links.items():
            scene.detach(name)
            ends = [time for time, _ in some[1:]]
            for (start, link), stop in zip(some, [*ends, np.inf]):
                start, stop = max(start, begin), min(stop, end)
                if link and start < stop:
                    first = round(start - begin, 4) if start > begin else -np.inf
                    last = round(stop - begin, 4) if stop < end else np.inf
                    scene.attach(name, link, first, last)
        return scene


def _carrier(scene: Scene, name: str) -> str:
    """Return the link that carries an object; empty: none."""
    held = scene[name].attachments if name in scene else ()
    return held[0].link if held else ""
