"""The topics on which the simulator publishes the objects around its robots.

A model that was spawned as URDF with movable joints is a robot. The links of all others
are objects, except for the floor: a static plane at height 0.

Publishes: ~scene (std_msgs/String): a scene in YAML of all objects, and of the links
    that carry them, whenever that changes; ~object_states (gazebo_msgs/LinkStates): the
    objects that have moved; ~world_markers (visualization_msgs/MarkerArray): what has
    changed or moved; while there are subscribers, and whole to each new one
"""

from __future__ import annotations

import math
import struct
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import chain

import numpy as np
from gazebo_msgs.msg import LinkStates
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from g1_description.errors import InvalidValueError
from g1_description.gazebo.shape_markers import ShapeMarkers, deleted
from g1_description.render.patches import object_shapes
from g1_description.robot.assembly import SCOPE
from g1_description.robot.rotation import rotate
from g1_description.ros.log import ThrottledLog
from g1_description.ros.publisher import DirectPublisher
from g1_description.ros.wire import LinkStatesEncoder, ready
from g1_description.scenes.objects import Attachment, SceneObject, model_objects
from g1_description.scenes.scene import Scene
from g1_description.scenes.scene_file import yaml_of
from g1_description.sim.attachments import Carriers, tree_of
from g1_description.sim.model import Model, States
from g1_description.sim.world import World

PERIOD = 0.04
"""Shortest time between two messages of a topic, in [s] of wall time."""

PAUSE_FACTOR = 9.0
"""Shortest time from one message to the next, as a multiple of that spent on the first:
many objects take at most a tenth of the loop."""

REFRESH_PERIOD = 2.0
"""Time after which all markers are sent again, in [s] of wall time: RViz drops those of
namespaces that are switched off."""

MOVED = 1e-6
"""Smallest change of a pose that is published, in [m] or of a quaternion."""

QUEUE_SIZE = 100
"""Messages queued for a slow subscriber: four seconds."""

UP = (0.0, 0.0, 1.0)


class _ObjectTopic(DirectPublisher):
    """A topic that knows of new subscribers."""

    def __init__(self, name: str, kind: type) -> None:
        self._newcomer = threading.Event()
        super().__init__(name, kind, QUEUE_SIZE, on_newcomer=self._newcomer.set)

    @property
    def has_subscribers(self) -> bool:
        """Whether there are subscribers."""
        return self.get_num_connections() > 0

    def takes_new_subscribers(self) -> bool:
        """Return whether subscribers have come since the last call."""
        has_some = self._newcomer.is_set()
        self._newcomer.clear()
        return has_some


class ObjectTopics:
    """Publishes the objects of a world."""

    def __init__(self, world: World, log: ThrottledLog) -> None:
        """Advertise the topics.

        Args:
            world: Source of the objects.
            log: For objects that cannot be shown.
        """
        self._world, self._log = world, log
        self._due = self._refreshed = -math.inf
        self._objects: Objects | None = None
        self._changes = 0
        """How often attachments had changed; that is published at once."""
        self._sent = np.zeros((0, 7))
        self._encoder = LinkStatesEncoder()
        self._scene = _ObjectTopic("~scene", String)
        self._states = _ObjectTopic("~object_states", LinkStates)
        self._markers = _ObjectTopic("~world_markers", MarkerArray)
        self._topics = self._scene, self._states, self._markers

    def publish(self) -> None:
        """Publish what has changed, if it is due; to be called at each step."""
        now, changes = time.monotonic(), self._world.attachments.changes
        has_changed = changes != self._changes
        if now < self._due and not has_changed:
            return
        self._changes = changes
        self._due = now + PERIOD
        if not any(topic.has_subscribers for topic in self._topics):
            self._objects = None
            return
        for topic in self._topics:
            topic.flush()
        before, objects = self._objects, self._objects
        if objects is None or not objects.are_those_of(self._world):
            objects = self._objects = Objects(self._world, self._log)
        self._publish(objects, before, now, has_changed)
        spent = time.monotonic() - now
        self._due = now + max(PERIOD, (1.0 + PAUSE_FACTOR) * spent)

    def _publish(
        self, objects: Objects, before: Objects | None, now: float, has_changed: bool
    ) -> None:
        """Publish objects; ``before`` are those of the last time."""
        poses, twists = objects.states()
        every = np.ones(len(poses), dtype=bool)
        is_new = objects is not before
        moved = every if is_new else np.abs(poses - self._sent).max(axis=1) > MOVED
        self._sent = (
            np.where(moved[:, None], poses, self._sent) if not is_new else poses
        )
        if self._scene.takes_new_subscribers() or (
            (is_new or has_changed) and self._scene.has_subscribers
        ):
            carriers = self._world.attachments.carriers()
            self._scene.publish(String(yaml_of(objects.at(poses, carriers))))
        rows = every if self._states.takes_new_subscribers() else moved
        if rows.any() and self._states.has_subscribers:
            names = objects.names
            if not rows.all():
                names = tuple(name for name, is_sent in zip(names, rows) if is_sent)
            data = self._encoder.encode(names, poses[rows], twists[rows])
            self._states.publish(ready(data))
        is_due = now > self._refreshed + REFRESH_PERIOD
        self._refreshed = now if is_due else self._refreshed
        is_whole = self._markers.takes_new_subscribers() or is_due
        if self._markers.has_subscribers:
            markers = objects.markers.at(poses, every if is_whole else moved)
            if is_new and before:
                gone = dict.fromkeys(before.markers.keys)
                for key in objects.markers.keys:
                    gone.pop(key, None)
                markers = [*deleted(gone), *markers]
            if markers:
                count = struct.pack("<I", len(markers))
                self._markers.publish(ready(count + b"".join(markers)))


class Objects:
    """The objects of a world, which are the same until models come, go or change."""

    def __init__(self, world: World, log: ThrottledLog) -> None:
        """List the objects.

        Args:
            world: The world.
            log: For objects that cannot be shown.
        """
        self._known = world.link_names, [m.assembly for m in world.models.values()]
        robots = [model for model in world.models.values() if _is_robot(model)]
        self._has_robots = len(robots) > 1
        self._models = [
            model
            for model in world.models.values()
            if not _is_robot(model) and not _is_floor(model)
        ]
        scene, rows, wrong = Scene(), [], []
        made = chain.from_iterable(map(model_objects, self._models))
        for row, each in enumerate(made):
            try:
                scene.add(each)
                rows.append(row)
            except InvalidValueError as error:
                wrong.append(str(error))
        if wrong:
            log.warn("objects", f"{len(wrong)} objects are not shown: {wrong[0]}")
        self._rows = np.array(rows, dtype=int)
        self._trees = [
            (model, tree_of(model, link))
            for model in self._models
            for link in model.link_names
        ]
        """Model and tree of each link, as ``Attachments`` has them."""
        self._objects = [*scene.values()]
        self.names = tuple(scene)
        """Their names."""
        self.markers = ShapeMarkers(object_shapes(self._objects))
        """Their markers."""
        for message in self.markers.left_out:
            log.warn(message, message)

    def are_those_of(self, world: World) -> bool:
        """Return whether no model has come, gone or changed."""
        names, assemblies = self._known
        return names is world.link_names and all(
            known is model.assembly
            for known, model in zip(assemblies, world.models.values())
        )

    def states(self) -> States:
        """Collect the present states.

        Returns:
            Poses, shape (n_objects, 7), and twists along the world's axes, shape
            (n_objects, 6).
        """
        poses = [np.zeros((0, 7)), *(model.poses for model in self._models)]
        twists = [np.zeros((0, 6)), *(model.twists for model in self._models)]
        return np.concatenate(poses)[self._rows], np.concatenate(twists)[self._rows]

    def at(self, poses: np.ndarray, carriers: Carriers) -> Iterator[SceneObject]:
        """Yield the objects at poses in the world, shape (n_objects, 7).

        Among several robots, the links that carry them are called ``model::link``.
        """
        for row, each, pose in zip(self._rows, self._objects, poses):
            robot, link = carriers.get(self._trees[row], (None, ""))
            if robot is not None and self._has_robots:
                link = f"{robot.name}{SCOPE}{link}"
            held = (Attachment(link),) if robot is not None else ()
            yield replace(each, pose=pose, attachments=held)


def _is_robot(model: Model) -> bool:
    """Return whether a model is a robot."""
    return bool(model.assembly.description.urdf and model.joint_names)


def _is_floor(model: Model) -> bool:
    """Return whether a model is the floor: RViz and the browser have one."""
    if not model.assembly.static or len(model.link_names) != 1:
        return False
    link, pose = model.links[model.link_names[0]], model.poses[0]
    return bool(link.collisions) and all(
        shape.kind == "plane"
        and np.allclose(
            rotate(pose[3:], rotate(shape.pose[3:], np.array(shape.size))), UP
        )
        and abs(pose[2] + rotate(pose[3:], shape.pose[:3])[2]) < MOVED
        for shape in link.collisions
    )
