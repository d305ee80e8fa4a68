"""Switches for layers of the scene, and files of the shown state."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from g1_description.errors import G1DescriptionError
from g1_description.web.panel import Key, PageContext, Panel
from g1_description.web.scene.objects import SceneObjects
from g1_description.web.scene.robot import SceneRobot

if TYPE_CHECKING:
    from viser import GuiCheckboxHandle


RENDER_TIMEOUT = 20.0
"""Longest wait for a picture, in [s]: browsers without a GPU are slow."""


class ViewPanel(Panel):
    """Switches of layers that are drawn beside or instead of the robots."""

    def __init__(
        self,
        page: PageContext,
        robots: Sequence[SceneRobot],
        objects: Sequence[SceneObjects],
        share: Callable[[], str],
    ) -> None:
        """Add the panel where the GUI is.

        Args:
            page: What it shares with others.
            robots: All robots.
            objects: Those around the robots.
            share: Writes a page of what is shown; it may block.
        """
        self._robots, self._objects, self._make_page = robots, objects, share
        self._pictured: set[int] = set()
        """Browsers whose picture is awaited."""
        super().__init__(page)

    def build(self) -> None:
        """Add the elements."""
        gui, stage, robots = self.gui, self.page.stage, self._robots

        def each(
            show: Callable[[SceneRobot, bool], object],
        ) -> Callable[[bool], object]:
            return lambda shown: [show(robot, shown) for robot in robots]

        self._switch("Visual shapes", True, each(SceneRobot.show_visuals))
        self._switch("Collision shapes", False, each(SceneRobot.show_collisions))
        self._switch("Frames", False, each(lambda r, on: r.tree.show_axes(on)))
        self._switch("Names of links", False, each(SceneRobot.show_names))
        self._switch("Objects", True, self._show_objects)
        self._switch("Floor", True, stage.show_floor)
        self._switch("Axes of the map", False, stage.show_axes)
        self.follows = self._switch("Follow the robot", False)
        self.trails = self._switch("Trails", False)
        self.ghost = self._switch("Commanded configuration", False)
        self.ghost.visible = self.world.has_commanded
        self.checks = self._switch("Checks", True)
        self.forces = self._switch("Contact forces", False, self._fade)
        picture = gui.add_button("Save a picture", hint="of what you see, as PNG")
        picture.on_click(self._save)
        page = gui.add_button(
            "Share",
            hint="the shown past, the open motion or the robot, as one HTML file",
        )
        page.on_click(self._share)
        self._overlay = self._switch("Overlay", False, self._arrange)
        self._overlay.visible = self.world.can_arrange

    def hotkeys(self) -> list[Key]:
        """List its keys."""
        return [Key("F", "follow the robot, or do not", self.toggle_follow, "F")]

    def _show_objects(self, shown: bool) -> None:
        """Show the objects around the robots, or hide them."""
        for objects in self._objects:
            objects.show_all(shown)

    def _arrange(self, is_overlay: bool) -> None:
        """Draw all robots at the same place, or next to each other."""
        self.world.arrange(beside=not is_overlay)
        self._fade()

    def _fade(self, _: bool = False) -> None:
        """Make robots translucent that would hide other robots, or their forces."""
        for number, robot in enumerate(self._robots):
            is_second = number > 0 and bool(self._overlay.value)
            robot.fade(bool(self.forces.value) or is_second)

    def toggle_follow(self) -> None:
        """Follow the robot, or stop that."""
        self.follows.value = not self.follows.value

    def _switch(
        self,
        label: str,
        initial: bool,
        show: Callable[[bool], object] = lambda _: None,
    ) -> GuiCheckboxHandle:
        """Add a switch."""
        box = self.gui.add_checkbox(label, initial)
        self.ui.on(box, lambda: show(bool(box.value)))
        return box

    def _save(self, event: Any) -> None:
        """Save what one person sees; called by a thread of viser's."""
        from PIL import Image

        client, file = event.client, io.BytesIO()
        if client is None or client.client_id in self._pictured:
            return
        self._pictured.add(client.client_id)
        try:
            height, width = client.camera.image_height, client.camera.image_width
            pixels = client.get_render(height, width, timeout=RENDER_TIMEOUT)
            Image.fromarray(pixels).save(file, "PNG")
            client.send_file_download(
                "robot.png", file.getvalue(), save_immediately=True
            )
        except (TimeoutError, RuntimeError) as error:
            client.add_notification("No picture", f"{error}", color="red")
        finally:
            self._pictured.discard(client.client_id)

    def _share(self, event: Any) -> None:
        """Send one person a page; called by a thread of viser's."""
        client = event.client
        if client is None:
            return
        try:
            page = self._make_page()
        except G1DescriptionError as error:
            client.add_notification("No page", f"{error}", color="red")
            return
        client.send_file_download(
            "robot.html",
            page.encode("utf-8", "backslashreplace"),
            save_immediately=True,
        )
