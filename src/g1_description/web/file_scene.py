"""The objects around a robot of a file: a scene that is seen and changed on a page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import wraps
from threading import RLock
from typing import Any, Callable, Optional, Protocol, Tuple, TypeVar, cast

import numpy as np

from g1_description.motion.motion import Motion, configuration
from g1_description.robot.description import Description
from g1_description.robot.state import RobotState
from g1_description.robot.transform import compose, inverse
from g1_description.scenes.carried import (
    Hold,
    LinkPoses,
    RobotLinks,
    carrying_links,
    holds_of,
    named_link,
    object_poses,
)
from g1_description.scenes.objects import Attachment, SceneObject, attached
from g1_description.scenes.scene import Scene
from g1_description.web.scene.objects import Looks, SeenObject


class PlacedRobot(Protocol):
    """A robot whose state is known."""

    description: Description
    offset: np.ndarray
    """Offset of its displayed position, in [m]."""

    def state(self) -> RobotState:
        """Return its state, with that offset."""


Time = Callable[[], Tuple[Optional[Motion], float]]

Method = TypeVar("Method", bound=Callable[..., object])


def _locked(method: Method) -> Method:
    """Let one thread at a time use a method."""

    @wraps(method)
    def alone(self: FileScene, *given: Any) -> object:
        with self._lock:
            return method(self, *given)

    return cast(Method, alone)


class FileScene:
    """The objects of a scene around one robot, which carries some of them.

    Several robots may be in copies of the same scene. Without a motion, what a link
    carries is where people have put it in the frame of the link.
    """

    is_live = False

    def __init__(self, scene: Scene, robot: PlacedRobot, time: Time) -> None:
        """Begin.

        Args:
            scene: The objects, which people change.
            robot: The robot.
            time: Returns its motion, if there is one, and the time in it, in [s].

        Raises:
            UnknownNameError: If an object is attached to a link that is not there.
        """
        self._scene, self._robot, self._time = scene, robot, time
        self._lock = RLock()
        self._check(scene)
        self._links = RobotLinks(robot.description)
        self._looks = Looks()
        self._known: tuple[SceneObject, ...] = ()
        self._seen: dict[str, SeenObject] = {}
        self._motion: Motion | None = None
        self._holds: dict[str, list[Hold]] = {}
        self._poses: dict[str, np.ndarray] = {}
        self._carried: list[str] = []

    @property
    def offset(self) -> np.ndarray:
        """Shift of the scene in the map, in [m], shape (3,)."""
        return self._robot.offset

    @property
    def links(self) -> tuple[str, ...]:
        """Links that can carry objects."""
        return carrying_links(self._robot.description)

    @_locked
    def shown(self) -> tuple[Mapping[str, SeenObject], Mapping[str, np.ndarray]]:
        """Return all objects by name, and T_map_object of each, shape (7,), as of now.

        An object that was changed is another one, and the pose of one that has moved
        another array. The offset is not in it.
        """
        self._renew()
        if self._carried:
            holds = [self._holds[name] for name in self._carried]
            now = np.array([self._time()[1]])
            found = object_poses(holds, now, self._present()[1])[0]
            for name, pose in zip(self._carried, found):
                if not np.array_equal(pose, self._poses[name]):
                    self._poses[name] = pose
        return self._seen, self._poses.copy()

    def _present(self) -> tuple[np.ndarray, LinkPoses]:
        """Return T_map_base without the offset, and the links as they are, any time."""
        state = self._robot.state()
        assert state.base_pose is not None
        base = state.base_pose.copy()
        base[:3] -= self.offset
        return base, self._links.along(configuration(state.positions_by_name, base))

    def _renew(self) -> None:
        """Find out what holds objects that are new, or all in a new motion."""
        objects = tuple(self._scene.values())
        motion, _ = self._time()
        if objects == self._known and motion is self._motion:
            return
        new = {*objects} if motion is not self._motion else {*objects} - {*self._known}
        base, links = self._present()
        if motion is not None:
            links = self._links.along(motion, base)
        found = [each for each in objects if each in new]
        holds = holds_of(found, self._robot.description, links)
        for each, some in zip(found, holds):
            self._holds[each.name], self._poses[each.name] = some, each.pose
        for name in [name for name in self._holds if name not in self._scene]:
            del self._holds[name], self._poses[name]
        self._carried = [each.name for each in objects if each.attachments]
        self._known, self._motion = objects, motion
        self._seen = self._looks.of(objects)

    # --- changes by people ---

    @_locked
    def add(self, added: SceneObject) -> None:
        """Add an object; raises an InvalidValueError if its name is taken."""
        self._scene.add(added)

    @_locked
    def remove(self, name: str) -> None:
        """Remove an object."""
        self._scene.remove(name)

    @_locked
    def change(self, name: str, changed: SceneObject) -> None:
        """Replace an object, whose name may be a new one, where it is now.

        Raises:
            InvalidValueError: If the name is taken.
        """
        before = self._at(name, self._pose(name))
        changed = replace(
            changed,
            pose=before.pose,
            attachments=before.attachments,
            may_touch=before.may_touch,
        )
        if changed.name != name:
            self._scene.add(changed)
            self._scene.remove(name)
        else:
            self._scene.replace(changed)

    @_locked
    def move(self, name: str, pose: np.ndarray) -> None:
        """Place an object: T_map_object without the offset, shape (7,), as of now."""
        self._scene.replace(self._at(name, pose))

    def _pose(self, name: str) -> np.ndarray:
        """Return T_map_object of one object, shape (7,), as of now."""
        return self.shown()[1][self._scene[name].name]

    def _at(self, name: str, pose: np.ndarray) -> SceneObject:
        """Return an object that is somewhere now; shape (7,)."""
        before, now = self._scene[name], self._pose(name)
        if self._motion is not None:  # it moves as before, from another beginning
            pose = compose(compose(before.pose, inverse(now)), pose)
        return replace(before, pose=pose)

    @_locked
    def attach(self, name: str, link: str) -> None:
        """Let a link carry an object from now on; empty: none.

        With a motion, it is attached from the present time, and what is later is
        removed.
        """
        before = self._at(name, self._pose(name))
        motion, now = self._time()
        now = -np.inf if motion is None or now <= motion.begin else now
        earlier = [one for one in before.attachments if one.begin < now]
        kept = tuple(Attachment(o.link, o.begin, min(o.end, now)) for o in earlier)
        changed = replace(before, attachments=kept)
        self._scene.replace(attached(changed, link, now, np.inf) if link else changed)

    @_locked
    def carrier(self, name: str) -> str:
        """Return what carries an object now, as the scene calls it; empty: nothing."""
        some, now = self._scene[name].attachments, self._time()[1]
        return next((o.link for o in some if o.begin <= now < o.end), "")

    @_locked
    def scene(self) -> Scene:
        """Return the scene, as it is to be saved."""
        if self._time()[0] is not None:
            return self._scene.copy()
        _, poses = self.shown()
        return Scene([replace(o, pose=poses[o.name]) for o in self._scene.values()])

    @_locked
    def load(self, scene: Scene) -> None:
        """Replace all objects.

        Raises:
            UnknownNameError: If one is attached to a link that is not there.
        """
        self._check(scene)
        for name in [*self._scene]:
            self._scene.remove(name)
        for each in scene.values():
            self._scene.add(each)

    def _check(self, scene: Scene) -> None:
        """Check that all links are there that carry objects."""
        for each in scene.values():
            for one in each.attachments:
                named_link(self._robot.description, one.link, each.name)
