"""The objects in the simulator, as shown and changed by a page.

Subscribes, while the page is open: as ros.present_objects
Calls: those of LiveSimulator, and spawn_sdf_model (gazebo_msgs/SpawnModel),
    delete_model (gazebo_msgs/DeleteModel), set_model_state
    (gazebo_msgs/SetModelState), attach_object (g1_description/AttachObject),
    detach_object (g1_description/DetachObject)
"""

from __future__ import annotations

import threading
from dataclasses import replace
from functools import partial
from typing import Dict, Mapping, Sequence, Tuple

import numpy as np
from gazebo_msgs.msg import ModelState
from gazebo_msgs.srv import DeleteModel, SetModelState, SpawnModel

from g1_description.errors import InvalidValueError
from g1_description.robot.assembly import SCOPE
from g1_description.ros.conversions import pose_from_array
from g1_description.ros.log import ThrottledLog
from g1_description.ros.present_objects import PresentObjects
from g1_description.scenes.carried import carrying_links
from g1_description.scenes.objects import SceneObject
from g1_description.scenes.scene import Scene
from g1_description.scenes.scene_file import sdf_model
from g1_description.srv import AttachObject, DetachObject
from g1_description.web.live_simulator import LiveSimulator
from g1_description.web.robot import ShownRobot
from g1_description.web.scene.objects import Looks, SeenObject

_Shown = Tuple[Dict[str, SeenObject], Mapping[str, np.ndarray]]


class LiveScene:
    """The objects of a simulator. Its topics are read by rospy's threads."""

    is_live = True
    offset = np.zeros(3)

    def __init__(
        self,
        simulator: LiveSimulator,
        changed: threading.Event,
        log: ThrottledLog,
        robots: Sequence[ShownRobot] = (),
    ) -> None:
        """Begin without objects.

        Args:
            simulator: The simulator.
            changed: Set when objects come, change, move or go.
            log: For messages that cannot be used.
            robots: Those that can carry objects.
        """
        self._carriers = {
            f"{robot.name}{SCOPE}{link}" if len(robots) > 1 else link: (robot, link)
            for robot in robots
            for link in carrying_links(robot.description)
        }
        self.links = tuple(self._carriers)
        self._simulator, self._changed, self._log = simulator, changed, log
        self._lock = threading.Lock()
        self._looks = Looks()
        self._present: PresentObjects | None = None
        self._scene: Scene | None = None
        self._shown: _Shown = {}, {}

    def watch(self, is_watched: bool) -> None:
        """Subscribe while the page is open."""
        if self._present is not None:
            self._present.close()
        refuse = partial(self._log.warn, "scene")
        name = self._simulator.name
        self._present = PresentObjects(name, refuse, self._take) if is_watched else None

    def _take(self) -> None:
        """Find what is seen of objects that are new; called by rospy's threads."""
        present = self._present
        if present is None:
            return
        with self._lock:
            scene, poses = present.newest()
            objects = self._shown[0]
            if scene is not self._scene and scene is not None:
                self._scene, objects = scene, self._looks.of([*scene.values()])
            self._shown = objects, poses
        self._changed.set()

    def shown(self) -> _Shown:
        """Return all objects by name, and T_map_object of each, shape (7,)."""
        return self._shown

    # --- changes by people: these block, and raise G1DescriptionError if refused ---

    def add(self, added: SceneObject) -> None:
        """Spawn an object as a model."""
        self._simulator.call(
            "spawn_sdf_model",
            SpawnModel,
            model_name=added.name,
            model_xml=sdf_model(added.name, {"link": added}, added.pose),
            initial_pose=pose_from_array(added.pose),
        )

    def remove(self, name: str) -> None:
        """Delete the model that an object is, or of which it is a link."""
        model = name.split(SCOPE)[0]
        self._simulator.call("delete_model", DeleteModel, model_name=model)

    def change(self, name: str, changed: SceneObject) -> None:
        """Replace an object, whose name may be a new one, where it is now."""
        now = self._own(name)
        if changed.name != name and changed.name in self.shown()[0]:
            raise InvalidValueError(f"There are two objects called {changed.name}.")
        carrier = self.carrier(name)
        self.remove(name)
        self.add(replace(changed, pose=now.pose))
        if carrier:
            self.attach(changed.name, carrier)

    def move(self, name: str, pose: np.ndarray) -> None:
        """Place an object, at rest: T_map_object, shape (7,)."""
        self._own(name)
        state = ModelState(model_name=name, pose=pose_from_array(pose))
        self._simulator.call("set_model_state", SetModelState, model_state=state)

    def _own(self, name: str) -> SceneObject:
        """Return an object that is a model of its own, where it is now."""
        objects, poses = self.shown()
        if name not in objects:
            raise InvalidValueError(f"{name} is no longer in the simulator.")
        if SCOPE in name:
            raise InvalidValueError(
                f"{name} is a link of a model with several links, which can only be "
                "deleted here."
            )
        return replace(objects[name].object, pose=poses[name])

    def attach(self, name: str, link: str) -> None:
        """Let a link carry an object; empty: none."""
        if not link:
            self._simulator.call("detach_object", DetachObject, object_name=name)
            return
        robot, own = self._carriers.get(link, (None, link))
        self._simulator.call(
            "attach_object",
            AttachObject,
            object_name=name,
            model_name="" if robot is None else robot.name,
            link_name=own,
        )

    def carrier(self, name: str) -> str:
        """Return what carries an object; empty: nothing."""
        shown = self.shown()[0].get(name)
        if shown is None or not shown.object.attachments:
            return ""
        given = shown.object.attachments[0].link
        owner, _, link = given.rpartition(SCOPE)
        known = (
            label
            for label, (robot, own) in self._carriers.items()
            if own == link and owner in ("", robot.name)
        )
        return next(known, given)

    def scene(self) -> Scene:
        """Return the objects where they are, and what carries them."""
        objects, poses = self.shown()
        return Scene([replace(o.object, pose=poses[n]) for n, o in objects.items()])

    def load(self, scene: Scene) -> None:
        """Replace all objects."""
        for model in {name.split(SCOPE)[0] for name in self.shown()[0]}:
            self.remove(model)
        for each in scene.values():
            self.add(each)
