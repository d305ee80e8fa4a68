"""Entities of the world by name, as in Gazebo, and link poses set by a joint."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import chain
from typing import ClassVar, NamedTuple, Union

import numpy as np

from g1_description.errors import InvalidValueError, UnknownNameError
from g1_description.robot.assembly import SCOPE, WORLD
from g1_description.robot.description import MOVABLE, Joint, Link, Shape
from g1_description.robot.joint_angles import measure, measured_joints
from g1_description.robot.rotation import angle_between, conjugate, cross, rotate
from g1_description.robot.transform import IDENTITY, compose, inverse
from g1_description.sdf.world import Light
from g1_description.sim.model import Model

WORLD_FRAMES = ("", "world", "map", "/map")
"""Names of the world's own frame, where no entity has one of them."""

FRAMES = ("model", "link", "collision", "light")
"""Kinds of entities that have a pose."""


@dataclass(frozen=True)
class Entity:
    """A model or a part of one."""

    kind: str
    """model, nested model, link, collision or joint."""

    model: Model
    """The outermost model."""

    name: str
    """Unscoped name; empty for a collision without a name."""

    scoped: str
    """Full name with scopes: model::link::collision."""

    row: int = 0
    """Row of its link in the model, for a link or a collision."""

    shape: Shape | None = field(default=None, compare=False)
    """Shape of a collision."""

    @property
    def link(self) -> Link:
        """The link in that row, in its current state."""
        return self.model.links[self.model.link_names[self.row]]

    @property
    def joint(self) -> Joint:
        """The joint of that name, possibly fixed."""
        joints = self.model.assembly.description.joints
        return next(joint for joint in joints if joint.name == self.name)

    @property
    def pose(self) -> np.ndarray:
        """Pose in the world, for the kinds in ``FRAMES``, shape (7,)."""
        if self.kind == "model":
            return self.model.pose
        pose = self.model.poses[self.row]
        return compose(pose, self.shape.pose) if self.shape else pose

    @property
    def twist(self) -> np.ndarray:
        """Twist of its link, or a model's canonical link, in world axes, shape (6,)."""
        if self.kind == "model":
            return self.model.twist
        return self.model.twists[self.row]


@dataclass(frozen=True, eq=False)
class StillFrame:
    """A frame that does not move: the world's own, or a light."""

    kind: str
    name: str
    pose: np.ndarray
    """Pose in the world, shape (7,)."""

    twist: ClassVar[np.ndarray] = np.zeros(6)

    @property
    def scoped(self) -> str:
        """Name without a scope."""
        return self.name


Frame = Union[Entity, StillFrame]

WORLD_FRAME = StillFrame("world", "world", IDENTITY)


def _entities_of(model: Model) -> Iterator[Entity]:
    """List the entities of a model in Gazebo's order: each before its parts."""
    scope = model.name + SCOPE
    yield Entity("model", model, model.name, model.name)
    for row, name in enumerate(model.link_names):
        yield Entity("link", model, name, scope + name, row)
        for shape in model.links[name].collisions:
            scoped = f"{scope}{name}{SCOPE}{shape.name}"
            yield Entity("collision", model, shape.name, scoped, row, shape)
    for name in model.assembly.nested:
        own = name.rpartition(SCOPE)[-1]
        yield Entity("nested model", model, own, scope + name)
    for joint in model.assembly.description.joints:
        if joint.listed:
            yield Entity("joint", model, joint.name, scope + joint.name)


class Entities:
    """Index of all entities by name, rebuilt when a model is added or removed.

    Gazebo traverses its tree from the root, each entity before its parts, and takes the
    first with the requested name or scoped name, ``model::link``. That may be of the
    wrong kind: a model hides a later link of its name.
    """

    def __init__(self, models: Iterable[Model], lights: Iterable[Light]) -> None:
        self._first: dict[str, Frame] = {}
        self._joints: dict[str, Entity] = {}
        self._models: dict[str, Entity] = {}
        still = (StillFrame("light", light.name, light.pose) for light in lights)
        entities: Iterable[Frame] = chain(still, *map(_entities_of, models))
        for entity in entities:
            for name in filter(None, (entity.scoped, entity.name)):
                self._first.setdefault(name, entity)
                if isinstance(entity, StillFrame):
                    continue
                if entity.kind == "joint":
                    self._joints.setdefault(name, entity)
                elif entity.kind in ("model", "nested model"):
                    self._models.setdefault(name, entity)

    def model(self, name: str) -> Entity:
        """Find a model or nested model by its plain or scoped name; nothing hides one.

        Raises:
            UnknownNameError: If there is none.
        """
        if name not in self._models:
            raise self._unknown("model", name)
        return self._models[name]

    def link(self, name: str) -> Entity:
        """Find a link by its plain or scoped name.

        Raises:
            UnknownNameError: If there is none.
        """
        entity = self._first.get(name)
        if not isinstance(entity, Entity) or entity.kind != "link":
            raise self._unknown("link", name)
        return entity

    def joint(self, name: str) -> Entity:
        """Find a joint by its plain or scoped name, also a fixed one; nothing hides it.

        Raises:
            UnknownNameError: If there is none.
        """
        if name not in self._joints:
            raise self._unknown("joint", name)
        return self._joints[name]

    def frame(self, name: str, kinds: Collection[str] = FRAMES) -> Frame:
        """Find a reference frame: the world, or an entity that has a pose.

        Args:
            name: Plain or scoped name.
            kinds: Allowed kinds of entities.

        Raises:
            UnknownNameError: If there is none.
        """
        entity = self._first.get(name)
        if entity is None and name in WORLD_FRAMES:
            return WORLD_FRAME
        if entity is None or entity.kind not in kinds:
            raise self._unknown("frame", name)
        return entity

    def _unknown(self, kind: str, name: str) -> UnknownNameError:
        other = self._first.get(name)
        note = f", '{name}' is a {other.kind}" if other else ""
        return UnknownNameError(f"There is no {kind} '{name}'{note}.")


def seen_from(frame: Frame, thing: Frame | Model) -> tuple[np.ndarray, np.ndarray]:
    """Compute the pose and the twist of an entity relative to a frame.

    Returns:
        Pose in the frame, shape (7,), and the difference of the two twists along
        the frame's axes, shape (6,).
    """
    T_world_frame = frame.pose
    difference = (thing.twist - frame.twist).reshape(2, 3)
    twist = rotate(conjugate(T_world_frame[3:]), difference).reshape(6)
    return compose(inverse(T_world_frame), thing.pose), twist


def in_world(
    frame: Frame, pose: np.ndarray, twist: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Turn a pose and a twist from a frame's axes to the world's.

    Args:
        frame: The reference frame; its own twist is ignored.
        pose: Pose in the frame, shape (7,).
        twist: Along the frame's axes, shape (6,).
    """
    T_world_frame = frame.pose
    turned = rotate(T_world_frame[3:], twist.reshape(2, 3)).reshape(6)
    return compose(T_world_frame, pose), turned


class PlacedLink(NamedTuple):
    """The remaining distance of a link placed by a joint from its desired pose."""

    joint: str
    """The joint that was set."""

    distance: float
    """Between the origins of the link's frame and of the desired one, in [m]."""

    angle: float
    """Between the link's orientation and the desired one, in [rad]."""


def joint_above(link: Entity) -> Joint | None:
    """Find the joint between a link and its parent; None for the root of a tree.

    The first link that is fixed to the world counts as a root.
    """
    for joint in link.model.assembly.description.joints:
        if joint.child == link.name:
            is_first = link.row in [tree.root_row for tree in link.model.trees]
            return None if is_first and joint.kind not in MOVABLE else joint
    return None


def place_link(
    link: Entity, joint: Joint, pose: np.ndarray, twist: np.ndarray
) -> PlacedLink:
    """Set the joint above a link so that the link is nearest to a pose.

    A revolute joint takes the rotation about its axis from the orientation, a
    prismatic one the distance along its axis from the position. The links below move
    rigidly.

    Args:
        link: The link; its model is changed.
        joint: The joint between the link and its parent.
        pose: Desired pose of the link in the world, shape (7,).
        twist: Desired velocity of its center of mass and angular velocity, along the
            world's axes, shape (6,). The joint takes the part along its axis.

    Raises:
        InvalidValueError: If the joint cannot move; nothing is changed.
    """
    model = link.model
    row = model.joint_row(joint.name)
    if row is None:
        raise InvalidValueError(
            f"{joint.child} of {model.name} is fixed to {joint.parent} by {joint.name}"
        )
    names = (*model.link_names, WORLD)
    poses = np.vstack([model.poses, model.root_poses[0]])
    twists = np.vstack([model.twists, np.zeros(6)])
    poses[link.row], twists[link.row] = pose, twist
    lever = rotate(pose[3:], model.centers[link.row])
    twists[link.row, :3] -= cross(twist[3:], lever)
    trees = model.assembly.description.trees
    tree = next(tree for tree in trees if joint.child in tree.link_names)
    joints = measured_joints(tree, names)
    positions, velocities, _ = measure(poses, twists, joints)
    index = joints.names.index(joint.name)
    position, velocity = positions[index], velocities[index]
    model.set_joint(row, float(position), float(velocity))
    T_reached_desired = compose(inverse(link.pose), pose)
    return PlacedLink(
        joint.name,
        float(np.linalg.norm(T_reached_desired[:3])),
        float(angle_between(link.pose[3:], pose[3:])),
    )
