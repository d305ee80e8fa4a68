"""Models and lights that are in the world, by name, and where they are."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import TypeVar

import numpy as np

from g1_description.errors import UnknownNameError
from g1_description.robot.assembly import SCOPE
from g1_description.robot.transform import compose
from g1_description.sdf.world import Light
from g1_description.sim.entities import (
    WORLD_ENTITY,
    CollisionEntity,
    Entity,
    Frame,
    JointEntity,
    LightEntity,
    LinkEntity,
    ModelEntity,
    NestedModelEntity,
    entities_of,
)
from g1_description.sim.model import Model

_Named = TypeVar("_Named")

WORLD_FRAMES = ("", "world", "map", "/map")
"""Names of the world's own frame, where nothing has one of them."""

FRAMES = (ModelEntity, LinkEntity, CollisionEntity, LightEntity)
"""Kinds of things that have a pose."""


class Entities:
    """All things by name, found the way Gazebo does; made again when one comes or goes.

    Gazebo walks its tree from the root, each thing before what it holds, and takes
    the first whose name or scoped name, ``model::link``, is the requested one. What
    is found may then be of the wrong kind: a model hides a later link of its name.
    """

    def __init__(self, models: Iterable[Model], lights: Iterable[Light]) -> None:
        """Collect the names of all things.

        Args:
            models: In the order of the world.
            lights: In the order of the world.
        """
        self._first: dict[str, Entity] = {}
        self._joints: dict[str, JointEntity] = {}
        self._models: dict[str, ModelEntity | NestedModelEntity] = {}
        for light in lights:
            self._add(LightEntity(light))
        for model in models:
            for entity in entities_of(model):
                self._add(entity)

    def _add(self, entity: Entity) -> None:
        """Add a thing; the first of a name stays."""
        for name in filter(None, (entity.scoped, entity.name)):
            self._first.setdefault(name, entity)
            if isinstance(entity, JointEntity):
                self._joints.setdefault(name, entity)
            elif isinstance(entity, (ModelEntity, NestedModelEntity)):
                self._models.setdefault(name, entity)

    def model(self, name: str) -> ModelEntity | NestedModelEntity:
        """Find a model or nested model by its plain or scoped name; nothing hides one.

        Raises:
            UnknownNameError: If there is none.
        """
        if name not in self._models:
            raise self._unknown("model", name)
        return self._models[name]

    def link(self, name: str) -> LinkEntity:
        """Find a link by its plain or scoped name.

        Raises:
            UnknownNameError: If there is none.
        """
        entity = self._first.get(name)
        if not isinstance(entity, LinkEntity):
            raise self._unknown("link", name)
        return entity

    def joint(self, name: str) -> JointEntity:
        """Find a joint by its plain or scoped name; other things hide no joint.

        Raises:
            UnknownNameError: If there is none.
        """
        if name not in self._joints:
            raise self._unknown("joint", name)
        return self._joints[name]

    def frame(self, name: str) -> Frame:
        """Find a reference frame: the world, or a thing that has a pose.

        Args:
            name: Plain or scoped.

        Raises:
            UnknownNameError: If there is none.
        """
        if self._is_world(name):
            return WORLD_ENTITY
        entity = self._first.get(name)
        if not isinstance(entity, FRAMES):
            raise self._unknown("frame", name)
        return entity

    def link_frame(self, name: str) -> Frame:
        """Find a reference frame as ``frame`` does, the world or a link.

        Raises:
            UnknownNameError: If there is none.
        """
        return WORLD_ENTITY if self._is_world(name) else self.link(name)

    def _is_world(self, name: str) -> bool:
        """Return whether a name means the world's own frame."""
        return name in WORLD_FRAMES and name not in self._first

    def _unknown(self, kind: str, name: str) -> UnknownNameError:
        """Make the error for a name that nothing of a kind has."""
        entity = self._first.get(name)
        found = f", '{name}' is a {entity.kind}" if entity else ""
        return UnknownNameError(f"There is no {kind} '{name}'{found}.")


class Contents:
    """Models and lights, in the order in which they came.

    What is made of their names stays one object while nothing comes or goes.
    """

    def __init__(self) -> None:
        self.models: dict[str, Model] = {}
        self.lights: dict[str, Light] = {}
        self.lock = threading.Lock()
        """For threads that read while another one steps and changes the world. A step
        holds it only while it changes what they see; who changes anything otherwise
        holds it, and does not step meanwhile."""

    @cached_property
    def entities(self) -> Entities:
        """All things by name."""
        return Entities(self.models.values(), self.lights.values())

    @cached_property
    def link_names(self) -> tuple[str, ...]:
        """All links as ``model::link``, in the order of ``link_states``."""
        return tuple(
            f"{model.name}{SCOPE}{link}"
            for model in self.models.values()
            for link in model.link_names
        )

    @cached_property
    def model_names(self) -> tuple[str, ...]:
        """All models, in the order of ``model_states``."""
        return tuple(self.models)

    def _forget_names(self) -> None:
        """Make what is made of names again, when it is next needed."""
        for name in ("entities", "link_names", "model_names"):
            self.__dict__.pop(name, None)

    def model(self, name: str) -> Model:
        """Find a model.

        Raises:
            UnknownNameError: If there is none of this name.
        """
        return _named("model", self.models, name)

    def light(self, name: str) -> Light:
        """Find a light.

        Raises:
            UnknownNameError: If there is none of this name.
        """
        return _named("light", self.lights, name)

    def add_light(self, light: Light) -> None:
        """Add a light, or replace the one of its name."""
        self.lights[light.name] = light
        self._forget_names()

    def delete_light(self, name: str) -> None:
        """Remove a light.

        Raises:
            UnknownNameError: If there is no such light.
        """
        del self.lights[self.light(name).name]
        self._forget_names()

    def link_states(self) -> tuple[np.ndarray, np.ndarray]:
        """Collect the states of all links.

        Returns:
            Poses of the link frames in the world, shape (n_links, 7), and twists
            of their origins along the world's axes, shape (n_links, 6).
        """
        models = self.models.values()
        poses = [np.zeros((0, 7)), *(model.poses for model in models)]
        twists = [np.zeros((0, 6)), *(model.twists for model in models)]
        return np.concatenate(poses), np.concatenate(twists)

    def model_states(self) -> tuple[np.ndarray, np.ndarray]:
        """Compute the states of all models.

        Returns:
            Poses of the model frames in the world, shape (n_models, 7), and twists of
            their canonical links' origins along the world's axes, shape (n_models, 6).
        """
        models = self.models.values()
        carriers = np.array([model.carrier_pose for model in models])
        offsets = np.array([model.T_carrier_model for model in models])
        twists = np.array([model.twist for model in models])
        poses = compose(carriers.reshape(-1, 7), offsets.reshape(-1, 7))
        return poses, twists.reshape(-1, 6)


def _named(kind: str, things: Mapping[str, _Named], name: str) -> _Named:
    """Find a thing by its name.

    Raises:
        UnknownNameError: If there is none.
    """
    if name not in things:
        raise UnknownNameError(
            f"There is no {kind} '{name}'; there are {', '.join(things) or 'none'}."
        )
    return things[name]
