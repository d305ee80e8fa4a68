"""Objects around robots, in a scene of viser."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Hashable, NamedTuple

import numpy as np

from g1_description.render.patches import Patch, object_shapes, patches_of
from g1_description.robot.description import Shape
from g1_description.scenes.objects import SceneObject
from g1_description.web.scene.robot import rgb
from g1_description.web.scene.tree import wxyz

if TYPE_CHECKING:
    from viser import FrameHandle, SceneApi


class SeenObject(NamedTuple):
    """An object, and what is seen of it."""

    object: SceneObject
    patches: Sequence[Patch]


class Looks:
    """The triangles of objects, found once for all that look the same."""

    def __init__(self) -> None:
        self._known: dict[Hashable, Sequence[Patch]] = {}

    def of(self, objects: Collection[SceneObject]) -> dict[str, SeenObject]:
        """Find the triangles of objects, by name; those of others are forgotten."""
        shapes = object_shapes(objects)
        keys = {name: tuple(map(_key, some)) for name, some in shapes.items()}
        new = {key: name for name, key in keys.items() if key not in self._known}
        patches, _ = patches_of({name: shapes[name] for name in new.values()})
        found = {key: patches.get(name, ()) for key, name in new.items()}
        self._known = {
            key: found[key] if key in found else self._known[key]
            for key in keys.values()
        }
        return {
            each.name: SeenObject(each, self._known[keys[each.name]])
            for each in objects
        }


def _key(shape: Shape) -> Hashable:
    """Return all of a shape that is seen."""
    pose = tuple(shape.pose.tolist())
    return shape.kind, tuple(shape.size), pose, shape.filename, shape.color


class _Drawn(NamedTuple):
    """An object in the scene."""

    frame: FrameHandle
    seen: SeenObject


class SceneObjects:
    """Objects in a scene: a frame for each, which moves with one message."""

    def __init__(self, scene: SceneApi, path: str) -> None:
        """Begin without objects.

        Args:
            scene: Where to.
            path: Name of all objects in the scene, such as ``/objects``.
        """
        self._scene = scene
        self._root, self.path = scene.add_frame(path, show_axes=False), path
        self._drawn: dict[str, _Drawn] = {}
        self._poses: dict[str, np.ndarray] = {}
        self._count = 0
        self._act: Callable[[str], object] | None = None

    def show_all(self, shown: bool) -> None:
        """Show all objects, or hide them."""
        self._root.visible = shown

    def place(self, offset: np.ndarray) -> None:
        """Shift all objects by an offset in the map, in [m], shape (3,)."""
        if not np.array_equal(self._root.position, offset):
            self._root.position = offset

    def show(
        self, objects: Mapping[str, SeenObject], poses: Mapping[str, np.ndarray]
    ) -> None:
        """Show objects, and no others.

        Args:
            objects: By name; one that was changed is another one.
            poses: T_map_object, shape (7,), by name; one that has moved is another
                array.
        """
        for name in [name for name in self._drawn if name not in objects]:
            self._remove(name)
        for name, seen in objects.items():
            drawn = self._drawn.get(name)
            if drawn is None or drawn.seen.patches is not seen.patches:
                self._remove(name)
                self._drawn[name] = _Drawn(self._add(name, seen, poses[name]), seen)
                self._poses[name] = poses[name]
            elif poses[name] is not self._poses[name]:
                before, pose = self._poses[name], poses[name]
                self._poses[name] = pose
                if (before[:3] != pose[:3]).any():  # viser compares ten times as long
                    drawn.frame.position = pose[:3]
                if (before[3:] != pose[3:]).any():
                    drawn.frame.wxyz = wxyz(pose)

    def on_click(self, act: Callable[[str], object]) -> None:
        """Set an action for clicks on objects that come, which gets their names."""
        self._act = act

    def _clicked(self, name: str, _: object) -> None:
        """Act on a click on an object."""
        if self._act is not None:
            self._act(name)

    def _remove(self, name: str) -> None:
        """Remove an object, if it is there."""
        if name in self._drawn:
            self._drawn.pop(name).frame.remove()

    def _add(self, name: str, seen: SeenObject, pose: np.ndarray) -> FrameHandle:
        """Add an object."""
        self._count += 1  # names may contain slashes, which have a meaning in the scene
        frame = self._scene.add_frame(
            f"{self.path}/{self._count}",
            show_axes=False,
            position=pose[:3],
            wxyz=wxyz(pose),
        )
        for number, patch in enumerate(seen.patches):
            alpha = patch.color[3]
            mesh = self._scene.add_mesh_simple(
                f"{frame.name}/{number}",
                patch.vertices,
                patch.faces,
                color=rgb(patch.color),
                opacity=alpha if alpha < 1.0 else None,
                flat_shading=True,
                # A plane is not seen from behind, where it would hide all.
                side="double" if alpha == 1.0 else "front",
            )
            if self._act is not None:
                mesh.on_click()(partial(self._clicked, name))
        return frame
