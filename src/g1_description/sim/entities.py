"""Models, links, collisions, joints and lights by name, found the way Gazebo does.

Gazebo walks its tree from the root, each thing before what it holds, and takes
the first whose name or scoped name, ``model::link``, is the one asked for. What
is found may then be of the wrong kind: a model hides a later link of its name.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from g1_description.core.errors import UnknownNameError
from g1_description.core.robot.assembly import SCOPE
from g1_description.core.robot.description import Joint, Link
from g1_description.core.rotation import conjugate, rotate
from g1_description.core.sdf.world import Light
from g1_description.core.transform import IDENTITY, compose, inverse

from .model import Model

_Thing = TypeVar("_Thing")

MODELS = ("model", "nested model")
"""Kinds of things that are models."""

WORLD_FRAMES = ("", "world", "map", "/map")
"""Names of the world's own frame, where nothing has one of them."""

FRAMES = ("model", "link", "collision", "light")
"""Kinds of things that have a pose."""


@dataclass(frozen=True)
class Entity:
    """A thing in the world."""

    kind: str
    """model, nested model, link, collision, joint or light."""

    scoped: str
    """Its name with those of what holds it: model::link::collision."""

    name: str
    """Its own name."""

    model: Model | None = None
    """The model that it is or belongs to, the outermost one."""

    row: int = 0
    """Which of the model's links or movable joints it is."""

    T_link_self: np.ndarray = field(default_factory=lambda: np.array(IDENTITY))
    """Pose of a collision in its link, of a light in the world, shape (7,)."""

    @property
    def link(self) -> Link:
        """The link that it is."""
        assert self.model is not None
        links = self.model.assembly.description.links
        return next(link for link in links if link.name == self.name)

    @property
    def joint(self) -> Joint:
        """The joint that it is."""
        assert self.model is not None
        joints = self.model.assembly.description.joints
        return next(joint for joint in joints if joint.name == self.name)

    @property
    def pose(self) -> np.ndarray:
        """Pose in the world, shape (7,)."""
        if self.model is None:
            return self.T_link_self
        if self.kind == "model":
            return self.model.pose
        if self.kind == "link":
            return self.model.poses[self.row]
        return compose(self.model.poses[self.row], self.T_link_self)

    @property
    def twist(self) -> np.ndarray:
        """Twist along the world's axes, shape (6,)."""
        if self.model is None:
            return np.zeros(6)
        return self.model.twist if self.kind == "model" else self.model.twists[self.row]


WORLD_ENTITY = Entity("world", "", "")
"""The world's own frame."""


class Entities:
    """All things by name; made anew when one comes or goes."""

    def __init__(self, models: Iterable[Model], lights: Iterable[Light]) -> None:
        """Find the names of all things.

        Args:
            models: In the order of the world.
            lights: In the order of the world.
        """
        self._first: dict[str, Entity] = {}
        self._joints: dict[str, Entity] = {}
        self._models: dict[str, Entity] = {}
        for light in lights:
            self._add(Entity("light", light.name, light.name, T_link_self=light.pose))
        for model in models:
            for entity in _parts(model):
                self._add(entity)

    def _add(self, entity: Entity) -> None:
        """Take a thing in; the first of a name stays."""
        for name in (entity.scoped, entity.name):
            if name:
                self._first.setdefault(name, entity)
                if entity.kind == "joint":
                    self._joints.setdefault(name, entity)
                elif entity.kind in MODELS:
                    self._models.setdefault(name, entity)

    def model(self, name: str) -> Entity:
        """Find a model or nested model by its plain or scoped name; nothing hides one.

        Raises:
            UnknownNameError: If there is none.
        """
        return self._found(self._models, name, MODELS)

    def link(self, name: str) -> Entity:
        """Find a link by its plain or scoped name.

        Raises:
            UnknownNameError: If there is none.
        """
        return self._found(self._first, name, ("link",))

    def joint(self, name: str) -> Entity:
        """Find a joint by its plain or scoped name; other things hide no joint.

        Raises:
            UnknownNameError: If there is none.
        """
        return self._found(self._joints, name, ("joint",))

    def frame(self, name: str, kinds: tuple[str, ...] = FRAMES) -> Entity:
        """Find a reference frame: the world, or a thing that has a pose.

        Args:
            name: Plain or scoped.
            kinds: What may be one besides the world.

        Raises:
            UnknownNameError: If there is none.
        """
        if name not in self._first and name in WORLD_FRAMES:
            return WORLD_ENTITY
        return self._found(self._first, name, kinds)

    @staticmethod
    def _found(names: dict[str, Entity], name: str, kinds: tuple[str, ...]) -> Entity:
        """Look a name up, and check what was found."""
        entity = names.get(name)
        if entity is None or entity.kind not in kinds:
            found = "" if entity is None else f", '{name}' is a {entity.kind}"
            raise UnknownNameError(f"There is no {kinds[0]} '{name}'{found}.")
        return entity


def _parts(model: Model) -> Iterator[Entity]:
    """Walk through a model as Gazebo does."""
    scope = model.name + SCOPE
    yield Entity("model", model.name, model.name, model)
    links = {link.name: link for link in model.assembly.description.links}
    for row, name in enumerate(model.link_names):
        yield Entity("link", scope + name, name, model, row)
        for shape in links[name].collisions:
            scoped = f"{scope}{name}{SCOPE}{shape.name}"
            yield Entity("collision", scoped, shape.name, model, row, shape.pose)
    for name in model.assembly.nested:
        plain = name.rpartition(SCOPE)[-1]
        yield Entity("nested model", scope + name, plain, model)
    for name in model.listed_joints:
        yield Entity("joint", scope + name, name, model, model.joint_row(name))


def seen_from(frame: Entity, entity: Entity) -> tuple[np.ndarray, np.ndarray]:
    """Tell where a thing is and how it moves, seen from a frame.

    Args:
        frame: The reference frame.
        entity: What is looked at.

    Returns:
        Pose in the frame, shape (7,), and the difference of the two twists along
        the frame's axes, shape (6,).
    """
    T_world_frame = frame.pose
    difference = (entity.twist - frame.twist).reshape(2, 3)
    twist = rotate(conjugate(T_world_frame[3:]), difference).reshape(6)
    return compose(inverse(T_world_frame), entity.pose), twist


def named(kind: str, things: Mapping[str, _Thing], name: str) -> _Thing:
    """Find a thing by its name.

    Raises:
        UnknownNameError: If there is none.
    """
    if name not in things:
        raise UnknownNameError(
            f"There is no {kind} '{name}'; there are {', '.join(things) or 'none'}."
        )
    return things[name]
