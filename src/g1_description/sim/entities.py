"""What has a name in the world: models, links, collisions, joints and lights."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from g1_description.robot.assembly import SCOPE
from g1_description.robot.description import Joint, Link, Shape
from g1_description.robot.rotation import conjugate, rotate
from g1_description.robot.transform import IDENTITY, compose, inverse
from g1_description.sdf.world import Light
from g1_description.sim.model import Model


class Entity(Protocol):
    """A thing in the world."""

    kind: ClassVar[str]
    """What messages call it."""

    @property
    def name(self) -> str:
        """Its own name."""

    @property
    def scoped(self) -> str:
        """Its name with those of what holds it: model::link::collision."""


class Frame(Protocol):
    """A thing that has a pose."""

    @property
    def pose(self) -> np.ndarray:
        """Pose in the world, shape (7,)."""

    @property
    def twist(self) -> np.ndarray:
        """Twist along the world's axes, shape (6,)."""


class WorldFrame:
    """The world's own frame."""

    pose = IDENTITY
    twist = np.zeros(6)


WORLD_ENTITY = WorldFrame()


@dataclass(frozen=True, eq=False)
class LightEntity:
    """A light; none moves."""

    light: Light
    kind: ClassVar[str] = "light"
    twist: ClassVar[np.ndarray] = np.zeros(6)

    @property
    def name(self) -> str:
        """Its name."""
        return self.light.name

    @property
    def scoped(self) -> str:
        """Its name; the world has no scope."""
        return self.name

    @property
    def pose(self) -> np.ndarray:
        """Pose in the world, shape (7,)."""
        return self.light.pose


@dataclass(frozen=True)
class ModelEntity:
    """A model of the world."""

    model: Model
    kind: ClassVar[str] = "model"

    @property
    def name(self) -> str:
        """Its name."""
        return self.model.name

    @property
    def scoped(self) -> str:
        """Its name; the world has no scope."""
        return self.name

    @property
    def pose(self) -> np.ndarray:
        """Pose in the world, shape (7,)."""
        return self.model.pose

    @property
    def twist(self) -> np.ndarray:
        """Twist of its canonical link along the world's axes, shape (6,)."""
        return self.model.twist


@dataclass(frozen=True)
class NestedModelEntity:
    """A model inside another one."""

    model: Model
    """The outermost model."""

    inner: str
    """Its name with those of what holds it inside the outermost model."""

    kind: ClassVar[str] = "nested model"

    @property
    def name(self) -> str:
        """Its own name."""
        return self.inner.rpartition(SCOPE)[-1]

    @property
    def scoped(self) -> str:
        """Its name with those of all models around it."""
        return f"{self.model.name}{SCOPE}{self.inner}"


@dataclass(frozen=True)
class LinkEntity:
    """A link of a model."""

    model: Model
    row: int
    """Which of the model's links it is."""

    kind: ClassVar[str] = "link"

    @property
    def name(self) -> str:
        """Its name in the model."""
        return self.model.link_names[self.row]

    @property
    def scoped(self) -> str:
        """Its name as ``model::link``."""
        return f"{self.model.name}{SCOPE}{self.name}"

    @property
    def link(self) -> Link:
        """The link of the model as it is now."""
        return self.model.links[self.name]

    @property
    def pose(self) -> np.ndarray:
        """Pose in the world, shape (7,)."""
        return self.model.poses[self.row]

    @property
    def twist(self) -> np.ndarray:
        """Twist of its frame along the world's axes, shape (6,)."""
        return self.model.twists[self.row]


@dataclass(frozen=True, eq=False)
class CollisionEntity:
    """A collision shape of a link."""

    link: LinkEntity
    shape: Shape
    kind: ClassVar[str] = "collision"

    @property
    def name(self) -> str:
        """Its own name, empty where the file gives none."""
        return self.shape.name

    @property
    def scoped(self) -> str:
        """Its name as ``model::link::collision``."""
        return f"{self.link.scoped}{SCOPE}{self.name}"

    @property
    def pose(self) -> np.ndarray:
        """Pose in the world, shape (7,)."""
        return compose(self.link.pose, self.shape.pose)

    @property
    def twist(self) -> np.ndarray:
        """Twist of its link along the world's axes, shape (6,)."""
        return self.link.twist


@dataclass(frozen=True)
class JointEntity:
    """A joint of a model, also a fixed one."""

    model: Model
    number: int
    """Which of all joints of the model's file it is."""

    kind: ClassVar[str] = "joint"

    @property
    def joint(self) -> Joint:
        """The joint of the description."""
        return self.model.assembly.description.joints[self.number]

    @property
    def name(self) -> str:
        """Its name in the model."""
        return self.joint.name

    @property
    def scoped(self) -> str:
        """Its name as ``model::joint``."""
        return f"{self.model.name}{SCOPE}{self.name}"

    @property
    def row(self) -> int | None:
        """Which of the model's movable joints it is, None for a fixed one."""
        return self.model.joint_row(self.name)


def entities_of(model: Model) -> Iterator[Entity]:
    """Walk through a model as Gazebo does, each thing before what it holds."""
    yield ModelEntity(model)
    for row, name in enumerate(model.link_names):
        link = LinkEntity(model, row)
        yield link
        for shape in model.links[name].collisions:
            yield CollisionEntity(link, shape)
    for name in model.assembly.nested:
        yield NestedModelEntity(model, name)
    for number, joint in enumerate(model.assembly.description.joints):
        if joint.listed:
            yield JointEntity(model, number)


def seen_from(frame: Frame, entity: Frame) -> tuple[np.ndarray, np.ndarray]:
    """Compute where a thing is and how it moves, seen from a frame.

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


def in_world(
    frame: Frame, pose: np.ndarray, twist: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Turn a pose and a twist from a frame's axes to the world's.

    Args:
        frame: The reference frame; its own twist does not count.
        pose: Pose in the frame, shape (7,).
        twist: Along the frame's axes, shape (6,).
    """
    T_world_frame = frame.pose
    turned = rotate(T_world_frame[3:], twist.reshape(2, 3)).reshape(6)
    return compose(T_world_frame, pose), turned
