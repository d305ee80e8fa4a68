"""A robot in a scene: its shapes, on the frames of its links."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from g1_description.render.patches import Color, Patch, link_patches
from g1_description.robot.assembly import WORLD
from g1_description.robot.description import Description
from g1_description.web.scene.tree import LinkTree

if TYPE_CHECKING:
    from viser import LabelHandle, MeshHandle, SceneApi


RED = (0.85, 0.05, 0.05, 1.0)
"""Colour of links that collide."""

SOLID: Color = (0.2, 0.5, 0.9, 0.45)
"""Colour of collision shapes."""

TAG, TAG_ROW = 0.65, 0.12
"""Height of the lowest tag over a robot's root link, which for one of a person's height
is above its head, and from one tag to the next, in [m]."""

SMALL, LARGE = 0.7, 1.1
"""Size of names among many, and of one alone, in those of viser's own labels."""

SEE_THROUGH = 0.35
"""Opacity of a robot that is not the one itself, such as a ghost."""


class SceneRobot:
    """A robot in a scene.

    Collision shapes and names are created when they are first switched on.
    """

    def __init__(
        self,
        scene: SceneApi,
        path: str,
        robot: Description,
        tint: Color | None = None,
    ) -> None:
        """Add a robot, its base at the origin and its joints at zero.

        Args:
            scene: Where to.
            path: Its name in the scene, such as ``/robots/g1``.
            robot: The robot.
            tint: Colour of all its shapes; by default their own.
        """
        self.description = robot
        self._scene = scene
        self._root = scene.add_frame(path, show_axes=False)
        self.tree = LinkTree(scene, self._root.name, robot)
        self.patches, _ = link_patches(robot)
        """Triangles by link."""
        self._visuals = self._add("visual", self.patches, tint)
        self._red: set[str] = set()
        self._named: tuple[str, LabelHandle] | None = None

    def _add(
        self, kind: str, patches: Mapping[str, list[Patch]], tint: Color | None
    ) -> dict[str, list[tuple[MeshHandle, Color]]]:
        """Add triangles to the frames of links; return them with their colours."""
        found: dict[str, list[tuple[MeshHandle, Color]]] = {}
        for link, some in patches.items():
            frame = self.tree.frames.get(link)
            if frame is None:  # of a tree of its own, whose place nobody knows
                continue
            for number, patch in enumerate(some):
                color = tint or patch.color
                mesh = self._scene.add_mesh_simple(
                    f"{frame.name}/{kind}_{number}",
                    patch.vertices,
                    patch.faces,
                    color=rgb(color),
                    opacity=color[3] if color[3] < 1.0 else None,
                    flat_shading=True,
                    side="double",
                )
                found.setdefault(link, []).append((mesh, color))
        return found

    def show(self, base: np.ndarray | None, positions: Mapping[str, float]) -> None:
        """Show a state of the robot.

        Args:
            base: T_map_base, shape (7,); None: where it was.
            positions: In [rad] or [m] by name; other joints stay where they are.
        """
        if base is not None:
            self.tree.place(base)
        self.tree.bend(positions)

    @property
    def visible(self) -> bool:
        """Whether it is visible."""
        return bool(self._root.visible)

    @visible.setter
    def visible(self, visible: bool) -> None:
        """Show or hide all of it."""
        self._root.visible = visible

    def redden(self, links: Collection[str]) -> None:
        """Show some links in red, and all others in their own colours."""
        for link in self._red.symmetric_difference(links):
            for mesh, color in self._visuals.get(link, ()):
                mesh.color = rgb(RED if link in links else color)
        self._red = set(links)

    def fade(self, faded: bool) -> None:
        """Make the robot translucent, or opaque."""
        for meshes in self._visuals.values():
            for mesh, color in meshes:
                alpha = SEE_THROUGH if faded else color[3]
                mesh.opacity = alpha if alpha < 1.0 else None

    def show_visuals(self, shown: bool) -> None:
        """Show the visual shapes, or hide them."""
        for meshes in self._visuals.values():
            for mesh, _ in meshes:
                mesh.visible = shown

    @cached_property
    def _solids(self) -> list[MeshHandle]:
        """The collision shapes."""
        patches, _ = link_patches(self.description, solid=True)
        found = self._add("collision", patches, SOLID)
        return [mesh for meshes in found.values() for mesh, _ in meshes]

    @cached_property
    def _names(self) -> list[LabelHandle]:
        """Names of links at their origins."""
        return [self._add_name(link) for link in self.tree.frames if link != WORLD]

    def on_click(self, act: Callable[[str], object]) -> None:
        """Set an action for clicks on a link, which gets its name."""

        def attach(mesh: MeshHandle, link: str) -> None:
            mesh.on_click()(lambda _: act(link))

        for link, meshes in self._visuals.items():
            for mesh, _ in meshes:
                attach(mesh, link)

    def on_drag(self, act: Callable[[str, Any], object] | None) -> None:
        """Set an action for drags of a link with the left button.

        Args:
            act: Called with the link's name and viser's event, in the order of events;
                None: drags turn the view.
        """

        def attach(mesh: MeshHandle, link: str) -> None:
            async def came(event: Any) -> None:
                if act is not None:
                    act(link, event)

            mesh.remove_drag_callback("all")
            if act is not None:
                mesh.on_drag("left")(came)

        for link, meshes in self._visuals.items():
            for mesh, _ in meshes:
                attach(mesh, link)

    def name(self, link: str) -> None:
        """Show the name of one link, or hide it if that is the one shown."""
        shown, self._named = self._named, None
        if shown is not None:
            shown[1].remove()
        if shown is None or shown[0] != link:
            self._named = link, self._add_name(link, "picked", LARGE)

    def tag(self, text: str, row: int) -> None:
        """Show the robot's name above its head.

        Args:
            text: Its name.
            row: How many tags are below it if robots stand in one place.
        """
        root = self.tree.frames[self.description.root].name
        place = (0.0, 0.0, TAG + TAG_ROW * row)
        self._scene.add_label(f"{root}/tag", text, position=place)

    def _add_name(
        self, link: str, kind: str = "name", scale: float = SMALL
    ) -> LabelHandle:
        """Add the name of a link at its origin."""
        path = f"{self.tree.frames[link].name}/{kind}"
        return self._scene.add_label(
            path, link, font_screen_scale=scale, anchor="center-left"
        )

    def show_collisions(self, shown: bool) -> None:
        """Show the collision shapes, or hide them."""
        self._show("_solids", shown)

    def show_names(self, shown: bool) -> None:
        """Show the names of links, or hide them."""
        self._show("_names", shown)

    def _show(self, layer: str, shown: bool) -> None:
        """Show or hide a layer that is created on first use."""
        if shown or layer in self.__dict__:
            for node in getattr(self, layer):
                node.visible = shown


def rgb(color: Color) -> tuple[int, int, int]:
    """Return red, green, blue, from 0 to 255."""
    red, green, blue = (round(255 * part) for part in color[:3])
    return red, green, blue
