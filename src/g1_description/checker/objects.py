"""The objects around a robot as it is now, and the checks among them.

Subscribes: as ros.present_objects
"""

from __future__ import annotations

import threading
from functools import partial

import numpy as np

from g1_description.checks.checker import Checker
from g1_description.robot.description import Description
from g1_description.ros.log import ThrottledLog
from g1_description.ros.present_objects import PresentObjects
from g1_description.scenes.carried import scene_around
from g1_description.scenes.scene import Scene


class CheckedObjects:
    """Objects of a file, or those in the simulator once it has sent its own."""

    def __init__(
        self,
        robot: Description,
        model: str,
        file: Scene | None,
        gazebo: str,
        log: ThrottledLog,
    ) -> None:
        """Begin with the objects of the file.

        Args:
            robot: The robot among them.
            model: Its name in the simulator; empty: it is not known.
            file: Objects as long as no simulator has sent any.
            gazebo: Namespace of the simulator.
            log: For messages that cannot be used.
        """
        self._present = PresentObjects(gazebo, partial(log.warn, "scene"))
        self._own = partial(scene_around, robot=robot, model=model)
        self._scene, self._lock = file, threading.Lock()
        self._sent: Scene | None = None

    def newest(self) -> tuple[Scene | None, np.ndarray | None]:
        """Return the objects, another scene for others, and where they are now.

        Returns:
            The objects, None if there are none; T_map_object in their order, shape
            (n_objects, 7), None if they are where the scene has them.
        """
        with self._lock:
            sent, poses = self._present.newest()
            if sent is not self._sent and sent is not None:
                self._sent = sent
                self._scene = self._own(sent.values()) or None
            if self._scene is None or sent is None:
                return self._scene, None
            found = [poses[name] for name in self._scene]
            return self._scene, np.array(found).reshape(-1, 7)


class CheckerAmongObjects:
    """A checker, which is another one when objects come or go."""

    def __init__(
        self, checker: Checker, objects: CheckedObjects, visual_hulls: bool
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
