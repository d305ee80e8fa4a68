"""Objects around the robots: adding, moving, changing and saving them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path, PureWindowsPath
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from g1_description.errors import InvalidValueError, SceneError
from g1_description.robot.description import Shape
from g1_description.robot.poses import user_file
from g1_description.robot.rotation import axes_to_rpy, from_rpy, rotate, to_axes
from g1_description.robot.transform import IDENTITY
from g1_description.scenes.objects import (
    SceneObject,
    shape_object,
    simple_shape,
    sizes,
)
from g1_description.scenes.scene import Scene
from g1_description.web.controls import valid_pose
from g1_description.web.panel import Panel
from g1_description.web.robot import ShownScene
from g1_description.web.saved_motions import check_file_name
from g1_description.web.scene.stage import MAP
from g1_description.web.scene.tree import free_name, pose_of, wxyz

if TYPE_CHECKING:
    from viser import UploadedFile

NONE = "none"
"""Entry of lists while no object is selected, or nothing carries it."""

NEW: dict[str, tuple[float, ...]] = {
    "box": (0.2, 0.2, 0.2),
    "cylinder": (0.05, 0.2),
    "sphere": (0.1,),
}
"""Kinds of objects to add, with their sizes in [m]."""

PLACE = np.array([0.6, 0.0, 0.1])
"""Where new objects are in the frame of the base, turned about z only, in [m]."""

FINE = 5e-5
"""Smaller changes are not shown, in [m] or [rad]."""

GIZMO = 0.3
"""Length of the gizmo's arrows, in [m]."""


def folder() -> Path:
    """Return the folder of saved scenes."""
    return user_file().parent / "scenes"


class ScenePanel(Panel):
    """Adds objects, changes the selected one, and saves all."""

    def build(self) -> None:
        """Add the elements."""
        gui, ui = self.gui, self.ui
        self._around: ShownScene = self.world.scenes[0]
        self.selected = ""
        """Name of the selected object; empty: none."""
        self._awaited = ""
        """Name of an object that is selected once it is there."""
        add = gui.add_button_group("Add object", [kind.capitalize() for kind in NEW])
        self._list = gui.add_dropdown("Object", [NONE], hint="or click on one")
        self._name = gui.add_text("Object name", "")
        self._place = gui.add_vector3(
            "Place", (0.0, 0.0, 0.0), step=0.001, hint="in the map, in m"
        )
        self._rpy = gui.add_vector3(
            "Rotation", (0.0, 0.0, 0.0), step=0.001, hint="roll, pitch, yaw in rad"
        )
        self._sides = gui.add_vector3(
            "Box size", (0.0, 0.0, 0.0), step=0.001, hint="along x, y and z, in m"
        )
        number = partial(gui.add_number, initial_value=0.0, min=0.0, step=0.001)
        self._radius = number("Radius", hint="in m")
        self._length = number("Length", hint="along z, in m")
        self._mass = number("Mass", hint="in kg; 0: static in a simulation")
        self._carrier = gui.add_dropdown(
            "Attach to", [NONE, *self._around.links], hint="from now on"
        )
        delete = gui.add_button("Delete object", color="orange")
        self._file = gui.add_text("Save scene as", "scene", hint=f"in {folder()}")
        save = gui.add_button("Save scene", hint=".yaml, or .sdf or .world")
        load = gui.add_upload_button("Open a scene", hint="replaces all objects")
        self._sizes = {
            "box": (self._sides,),
            "cylinder": (self._radius, self._length),
            "sphere": (self._radius,),
        }
        self._own = (
            *(self._name, self._place, self._rpy, self._sides, self._radius),
            *(self._length, self._mass, self._carrier, delete),
        )
        self._gizmo = self.scene.add_transform_controls(
            f"{MAP}/selected/gizmo", scale=GIZMO, visible=False
        )
        ui.on(add, lambda: self.add(str(add.value).lower()))
        ui.on(self._list, lambda: self.select(str(self._list.value)))
        ui.on(self._carrier, self._attach)
        ui.on(delete, self._delete)
        ui.on(save, self._save)
        ui.on(self._gizmo, self._dragged)
        for field in (self._place, self._rpy):
            ui.on(field, self._typed)
        fields = (self._name, self._sides, self._radius, self._length, self._mass)
        for changed in fields:
            ui.on(changed, partial(self._change, changed))
        load.on_upload(lambda _: self._uploaded(load.value))
        self._show_selection()

    @property
    def has_gizmo(self) -> bool:
        """Whether the gizmo of an object is shown."""
        return bool(self.selected)

    def leave(self) -> None:
        """Deselect."""
        self.select(NONE)

    def select(self, name: str) -> None:
        """Select an object, or none."""
        self.selected = name if name in self._around.shown()[0] else ""
        self._show_selection()

    def _do(self, act: Callable[[], object]) -> None:
        """Change objects; a simulator is called by another thread."""
        if self._around.is_live:
            self.ui.calls.do(act)
        else:
            act()
        self.ui.new.set()

    # --- changes ---

    def add(self, kind: str) -> None:
        """Add an object of a kind before the first robot."""
        state = self.world.robots[0].state()
        base = None if state is None else state.base_pose
        base = IDENTITY if base is None else base
        yaw = axes_to_rpy(to_axes(base[3:]))[2]
        at = base[:3] + rotate(from_rpy(np.array([0.0, 0.0, yaw])), PLACE)
        name = free_name(kind, {*self._around.shown()[0]})
        added = shape_object(name, kind, NEW[kind], np.round(at, 3), {})
        self._awaited = name
        self._do(partial(self._around.add, added))

    def _delete(self) -> None:
        """Delete the selected object."""
        self._do(partial(self._around.remove, self._selected[0].name))
        self.select(NONE)

    @property
    def _selected(self) -> tuple[SceneObject, np.ndarray]:
        """The selected object and T_map_object, shape (7,).

        Raises:
            InvalidValueError: If it is not there.
        """
        objects, poses = self._around.shown()
        if self.selected not in objects:
            raise InvalidValueError("No object is selected.")
        return objects[self.selected].object, poses[self.selected]

    def _change(self, field: Any) -> None:
        """Give the selected object its name, its sizes or its mass."""
        before, pose = self._selected
        shape = _sized(before)
        name = str(self._name.value).strip()
        if shape is None or field is self._name:
            changed = replace(before, link=replace(before.link, name=name))
        else:
            given = [np.ravel(element.value) for element in self._sizes[shape.kind]]
            size = sizes(name, "size", np.concatenate(given), len(shape.size))
            options = {"color": shape.color, "mass": self._mass.value or None}
            changed = shape_object(name, shape.kind, size, pose, options)
            changed = replace(changed, may_touch=before.may_touch)
        if name != before.name:
            if name in self._around.shown()[0]:
                raise InvalidValueError(f"There are two objects called {name}.")
            Scene([changed])  # the name is valid
            self._awaited = name
        self._do(partial(self._around.change, before.name, changed))

    def _attach(self) -> None:
        """Let the chosen link carry the selected object."""
        link = "" if self._carrier.value == NONE else str(self._carrier.value)
        self._do(partial(self._around.attach, self._selected[0].name, link))

    def _typed(self) -> None:
        """Place the object as typed."""
        rpy = np.array(self._rpy.value, dtype=float)
        if rpy.shape == (3,):
            self._move(np.concatenate([self._place.value, from_rpy(rpy)]))

    def _dragged(self) -> None:
        """Place the object where the gizmo is."""
        self._move(pose_of(self._gizmo.position, self._gizmo.wxyz))

    def _move(self, given: np.ndarray) -> None:
        """Place the object, if the pose is valid."""
        pose, name = valid_pose(given), self._selected[0].name
        if pose is None:
            return
        move = partial(self._around.move, name, pose)
        if self._around.is_live:
            self.ui.calls.do(move, key=self)
        else:
            move()

    # --- files ---

    def _save(self) -> None:
        """Save all objects."""
        name = str(self._file.value).strip()
        stem, dot, ending = name.rpartition(".")
        check_file_name(stem if dot else name)
        file = folder() / (name if dot else f"{name}.yaml")
        if ending and dot and ending not in ("yaml", "sdf", "world"):
            raise InvalidValueError(f"{name} must end in .yaml, .sdf or .world.")
        if file.exists():
            raise InvalidValueError(f"{file} already exists: choose another name.")
        file.parent.mkdir(parents=True, exist_ok=True)
        scene = self.page.scene_of(self.world.robots[0])
        assert scene is not None
        scene.save(file)
        self.ui.notify(f"Saved {file}.", "green")

    def _uploaded(self, file: UploadedFile) -> None:
        """Open a scene that came from a browser; called by a thread of viser."""
        self.ui.post("scene", partial(self._load, file.name, file.content))

    def _load(self, name: str, content: bytes) -> None:
        """Replace all objects by those of a file."""
        name = PureWindowsPath(name).name
        with TemporaryDirectory(prefix="g1_description_upload_") as made:
            path = Path(made, f"scene{Path(name).suffix}")
            path.write_bytes(content)
            try:
                scene = Scene.read(path)
            except SceneError as error:
                raise SceneError(str(error).replace(str(path), name)) from error
        self.select(NONE)
        self._do(partial(self._around.load, scene))

    # --- showing ---

    def update(self) -> None:
        """Show the objects, and the selected one unless it is edited."""
        objects, poses = self._around.shown()
        if self._awaited in objects:
            self.selected, self._awaited = self._awaited, ""
            self._show_selection()
        elif self.selected and self.selected not in objects:
            self.selected = ""
            self._show_selection()
        names = (NONE, *objects)
        if self._list.options != names:
            self._list.options = names
        self.show(self._list, self.selected or NONE)
        if self.selected:
            self._show_object(objects[self.selected].object, poses)

    def _show_object(self, shown: SceneObject, poses: Mapping[str, np.ndarray]) -> None:
        """Show the name, the sizes and the place of an object."""
        pose, shape = poses[shown.name], _sized(shown)
        self.show(self._name, shown.name)
        if shape is not None:
            size = shape.size
            values = [tuple(size)] if shape.kind == "box" else size
            for field, value in zip(self._sizes[shape.kind], values):
                self.show(field, value, FINE)
            self.show(self._mass, shown.mass or 0.0, FINE)
        carrier = self._around.carrier(shown.name) or NONE
        names = tuple(dict.fromkeys((NONE, *self._around.links, carrier)))
        if self._carrier.options != names:
            self._carrier.options = names
        self.show(self._carrier, carrier)
        rpy = axes_to_rpy(to_axes(pose[3:]))
        held = any([self.ui.edits.is_held(field) for field in (self._place, self._rpy)])
        for field, numbers in zip((self._place, self._rpy), (pose[:3], rpy)):
            x, y, z = np.round(numbers, 4).tolist()
            if not held:
                self.show(field, (x, y, z), FINE)
        if not self.ui.edits.is_held(self._gizmo):
            self._gizmo.position, self._gizmo.wxyz = pose[:3], np.array(wxyz(pose))

    def _show_selection(self) -> None:
        """Show what the selected object has."""
        shown = self._around.shown()[0].get(self.selected)
        shape = None if shown is None else _sized(shown.object)
        for element in self._own:
            element.visible = shown is not None
        used = () if shape is None else (*self._sizes[shape.kind], self._mass)
        for field in (self._sides, self._radius, self._length, self._mass):
            field.visible = field in used
        self._carrier.visible = shown is not None and bool(self._around.links)
        self._gizmo.visible = shown is not None


def _sized(shown: SceneObject) -> Shape | None:
    """Return the shape of an object whose sizes can be changed."""
    shape = simple_shape(shown)
    return shape if shape is not None and shape.kind in NEW else None
