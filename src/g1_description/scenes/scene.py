"""A scene: the objects around a robot, by name."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any, Mapping

import numpy as np

from g1_description.errors import InvalidValueError, SceneError, UnknownNameError
from g1_description.robot.assembly import MAP, WORLD
from g1_description.scenes.moveit import apply_message
from g1_description.scenes.objects import (
    SceneObject,
    attached,
    described_object,
    object_pose,
)
from g1_description.scenes.scene_file import read_objects, write_objects
from g1_description.text import listed, similar_first

MAX_OBJECTS = 5000
"""Most objects of a scene."""

MAX_NAME = 200
"""Longest name in characters."""


class Scene(Mapping[str, SceneObject]):
    """Objects by name, in the order in which they were added."""

    def __init__(
        self, objects: Collection[SceneObject] = (), notes: Collection[str] = ()
    ) -> None:
        """Begin with some objects.

        Args:
            objects: The objects.
            notes: Messages on parts of a file that are ignored.

        Raises:
            InvalidValueError: If two have one name, or there are too many.
        """
        self.notes = tuple(notes)
        """Messages on parts of its file that are ignored, such as missing models."""
        self._objects: dict[str, SceneObject] = {}
        for each in objects:
            self.add(each)

    def __getitem__(self, name: str) -> SceneObject:
        if name not in self._objects:
            known = listed(similar_first(name, self._objects)) or "none"
            raise UnknownNameError(f"Unknown object '{name}'. Known objects: {known}.")
        return self._objects[name]

    def get(self, name: str, default: Any = None) -> Any:
        """Return the object of a name, or a default."""
        return self._objects.get(name, default)

    def __contains__(self, name: object) -> bool:
        return name in self._objects

    def __iter__(self) -> Iterator[str]:
        return iter(self._objects)

    def __len__(self) -> int:
        return len(self._objects)

    def __repr__(self) -> str:
        """Show the names."""
        return f"<Scene: {listed(self._objects) or 'no objects'}>"

    def copy(self) -> Scene:
        """Return a scene of the same objects."""
        return Scene([*self.values()], self.notes)

    def add(self, added: SceneObject) -> SceneObject:
        """Add an object.

        Raises:
            InvalidValueError: If the name is taken or invalid, or there are too many.
        """
        name = added.name
        is_line = isinstance(name, str) and name.isprintable() and name.strip() == name
        if not is_line or not 0 < len(name) <= MAX_NAME or name in (MAP, WORLD):
            raise InvalidValueError(
                f"{str(name)[:80]!r} cannot be the name of an object: it must be a "
                f"line of 1 to {MAX_NAME} characters, other than {MAP} and {WORLD}."
            )
        if name in self._objects:
            raise InvalidValueError(f"There are two objects called {name}.")
        if len(self) >= MAX_OBJECTS:
            raise InvalidValueError(f"A scene has at most {MAX_OBJECTS} objects.")
        self._objects[name] = added
        return added

    def box(self, name: str, size: Any, at: Any, **options: Any) -> SceneObject:
        """Add a box.

        Args:
            name: Its name.
            size: Along its x, y and z, in [m].
            at: Its middle in the map, in [m], shape (3,), or its pose, shape (7,).
            options: ``rpy``: roll, pitch and yaw in [rad]; ``mass`` in [kg], without
                which it is static in a simulation; ``color``: red, green, blue and
                optionally opacity, from 0 to 1; ``may_touch``: names of links, roles
                and objects whose contact with it is no collision.

        Raises:
            InvalidValueError: If a value is invalid, or the name is taken.
        """
        return self.add(described_object("box", name, at, {"size": size, **options}))

    def cylinder(
        self, name: str, radius: float, length: float, at: Any, **options: Any
    ) -> SceneObject:
        """Add a cylinder along its z axis; see ``box``."""
        given = {"radius": radius, "length": length, **options}
        return self.add(described_object("cylinder", name, at, given))

    def sphere(self, name: str, radius: float, at: Any, **options: Any) -> SceneObject:
        """Add a sphere; see ``box``."""
        given = {"radius": radius, **options}
        return self.add(described_object("sphere", name, at, given))

    def plane(self, name: str, normal: Any, at: Any, **options: Any) -> SceneObject:
        """Add all that is behind a plane.

        Args:
            name: Its name.
            normal: Direction to its free side in its own frame, shape (3,).
            at: One of its points in the map, in [m], shape (3,), or its pose.
            options: As for ``box``.

        Raises:
            InvalidValueError: If a value is invalid, or the name is taken.
        """
        given = {"normal": normal, **options}
        return self.add(described_object("plane", name, at, given))

    def mesh(
        self,
        name: str,
        file: str | PathLike[str],
        at: Any,
        scale: Any = 1.0,
        **options: Any,
    ) -> SceneObject:
        """Add a mesh; each of its parts counts as its convex hull.

        Args:
            name: Its name.
            file: STL, OBJ or Collada: a path, or ``package://`` or ``model://``.
            at: Its frame in the map, in [m], shape (3,), or its pose, shape (7,).
            scale: A factor, or three along x, y and z.
            options: As for ``box``.

        Raises:
            InvalidValueError: If a value is invalid, there is no such file, or the name
                is taken.
        """
        given = {"file": file, "scale": scale, **options}
        return self.add(described_object("mesh", name, at, given))

    def remove(self, name: str) -> None:
        """Remove an object.

        Raises:
            UnknownNameError: If there is none of the name.
        """
        del self._objects[self[name].name]

    def replace(self, changed: SceneObject) -> None:
        """Replace the object of the same name.

        Raises:
            UnknownNameError: If there is none of the name.
        """
        self._objects[self[changed.name].name] = changed

    def move(self, name: str, at: Any, rpy: Any = None) -> None:
        """Place an object.

        Args:
            name: Its name.
            at: Its place in the map, in [m], shape (3,), or its pose, shape (7,).
            rpy: Roll, pitch and yaw in [rad]; None: as it is turned, or as in the pose.

        Raises:
            UnknownNameError: If there is none of the name.
            InvalidValueError: If the place is invalid.
        """
        before, pose = self[name], object_pose(name, at, rpy)
        if np.size(at) == 3 and rpy is None:
            pose[3:] = before.pose[3:]
        self.replace(replace(before, pose=pose))

    def attach(
        self, name: str, link: str, begin: float = -np.inf, end: float = np.inf
    ) -> None:
        """Let a link carry an object for a time.

        Args:
            name: Name of the object.
            link: Name of the link, or of a role in the robot's profile.
            begin: When it is taken, in [s] of the motion; by default from its start.
            end: When it is let go, in [s]; by default never.

        Raises:
            UnknownNameError: If there is no such object.
            InvalidValueError: If the times are not in order, or overlap those of
                another attachment.
        """
        self.replace(attached(self[name], link, begin, end))

    def detach(self, name: str) -> None:
        """Remove all attachments of an object.

        Raises:
            UnknownNameError: If there is none of the name.
        """
        self.replace(replace(self[name], attachments=()))

    def apply(
        self, message: Any, frames: Mapping[str, np.ndarray] | None = None
    ) -> None:
        """Change the scene as a message of MoveIt says.

        Args:
            message: A PlanningScene, CollisionObject or AttachedCollisionObject of
                moveit_msgs.
            frames: Poses in the map, shape (7,), of the frames that it names besides
                map and world, such as those of ``Robot.link_poses``.

        Raises:
            G1DescriptionError: If it is invalid; the scene stays as it was.
        """
        changed = dict(self._objects)
        apply_message(changed, message, frames or {})
        self._objects = Scene(changed.values())._objects

    @staticmethod
    def read(file: str | PathLike[str]) -> Scene:
        """Read a scene: YAML, or an SDF model or world; see docs/scenes.md.

        Raises:
            G1DescriptionError: If it cannot be read; the message has the reason.
        """
        objects, notes = read_objects(Path(file))
        try:
            return Scene(objects, notes)
        except InvalidValueError as error:
            raise SceneError(f"The scene {file} cannot be used: {error}") from error

    def save(self, file: str | PathLike[str]) -> None:
        """Write a scene: by default YAML.

        Args:
            file: An SDF world if the name ends in .sdf or .world; a file for MoveIt,
                without attachments, if it ends in .scene.

        Raises:
            SceneError: If it has attachments, which SDF has not.
            OSError: If it cannot be written.
        """
        write_objects([*self.values()], Path(file))


def as_scene(given: Any) -> Scene | None:
    """Return a scene or None, or read a file; see ``Scene.read``.

    Raises:
        InvalidValueError: If it is something else.
    """
    if given is None or isinstance(given, Scene):
        return given
    if not isinstance(given, (str, PathLike)):
        raise InvalidValueError(
            f"scene must be a Scene or its file (got {str(given)[:80]})."
        )
    return Scene.read(given)
