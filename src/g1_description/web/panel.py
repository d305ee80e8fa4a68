"""The base of the page's panels, and what they share."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from g1_description.robot.transform import compose, translation
from g1_description.scenes.carried import scene_around
from g1_description.scenes.objects import Attachment
from g1_description.scenes.scene import Scene
from g1_description.web.check_thread import CheckThread, MakeChecker
from g1_description.web.findings_panel import plain
from g1_description.web.robot import ShownRobot, ShownScene, ShownWorld
from g1_description.web.scene.stage import Stage
from g1_description.web.shown import Shown
from g1_description.web.ui_loop import UiLoop

if TYPE_CHECKING:
    from viser import ViserServer

P = TypeVar("P", bound="Panel")


class Key(NamedTuple):
    """A key of the page, which acts where nobody types."""

    shown: str
    """Its name for people."""

    effect: str
    act: Callable[[], object]
    hotkey: str
    """Its name for viser."""

    modifier: str | None = None


@dataclass(eq=False)
class PageContext:
    """All that the panels of a page share."""

    server: ViserServer
    ui: UiLoop
    world: ShownWorld
    stage: Stage
    checks: CheckThread
    make_checker: MakeChecker
    read_only: bool
    panels: list[Panel] = field(default_factory=list)
    """All that are there, in the order of their creation."""

    def find(self, kind: type[P]) -> P | None:
        """Return the first panel of a kind; None if there is none."""
        return next((one for one in self.panels if isinstance(one, kind)), None)

    def get(self, kind: type[P]) -> P:
        """Return the first panel of a kind that is there."""
        found = self.find(kind)
        assert found is not None
        return found

    def scene_of(self, robot: ShownRobot) -> Scene | None:
        """Return the objects around a robot, which carries those that are attached.

        None: nothing is known of any.
        """
        around = self._around(robot)
        if around is None:
            return None
        objects = around.scene().values()
        return scene_around(objects, robot.description, robot.name)

    def scene_now(self, robot: ShownRobot) -> Scene | None:
        """Return the objects where the page shows them now, and what carries them."""
        around = self._around(robot)
        if around is None:
            return None
        objects, poses = around.shown()
        shift, now = translation(around.offset), []
        for name, seen in objects.items():
            link, pose = around.carrier(name), compose(shift, poses[name])
            held = (Attachment(link),) if link else ()
            now.append(replace(seen.object, pose=pose, attachments=held))
        return scene_around(now, robot.description, robot.name)

    def _around(self, robot: ShownRobot) -> ShownScene | None:
        """Return the scene around a robot."""
        scenes = self.world.scenes
        row = min(self.world.robots.index(robot), len(scenes) - 1)
        return scenes[row] if scenes else None

    def refresh(self) -> None:
        """Let all panels look again at files that were saved."""
        for panel in self.panels:
            panel.refresh()


class Panel:
    """A part of the page.

    A panel overrides ``build``, which adds its elements, and ``update``, which shows
    what has changed; the rest as needed.
    """

    title = ""
    """Of its folder; empty: it has none."""

    is_open = False
    """Whether the folder is open at first."""

    period = 0.1
    """Least time between two updates, in [s]."""

    def __init__(self, page: PageContext) -> None:
        """Add the panel where the GUI is.

        Args:
            page: What it shares with others.
        """
        self.page, self.ui, self.world = page, page.ui, page.world
        self.gui, self.scene = page.server.gui, page.server.scene
        self._updated = -math.inf
        with self.gui.add_folder(self.title or None, expand_by_default=self.is_open):
            self.build()
            self._message = self.gui.add_markdown("", visible=False)
        page.panels.append(self)

    def build(self) -> None:
        """Add the elements."""

    def update(self) -> None:
        """Show what has changed."""

    def follow(self) -> None:
        """Update the panel, unless that was done just now."""
        now = time.monotonic()
        if now >= self._updated + self.period:
            self._updated = now
            self.update()

    def refresh(self) -> None:
        """Look again at files that were saved."""

    def leave(self) -> None:
        """Hide what nobody needs once the last browser is closed."""

    @property
    def has_gizmo(self) -> bool:
        """Whether it shows a gizmo, which a moving map would carry away."""
        return False

    def hotkeys(self) -> list[Key]:
        """List its keys; of two panels with the same key, the first has it."""
        return []

    def report(self, text: str) -> None:
        """Show a sentence below the elements, or none."""
        self._message.content = plain(text)
        self._message.visible = bool(text)

    def show(self, handle: Any, value: Any, tolerance: float = 0.0) -> None:
        """Show a value, unless a person edits it; see ``Edits.show``."""
        self.ui.edits.show(handle, value, tolerance)


class RobotPanel(Panel):
    """A panel of one robot.

    Those of ``page.ROBOT_PANELS`` are on the tab of each robot that can be moved. What
    they show is in ``self.shown.newest``, the robot's last state.
    """

    def __init__(self, page: PageContext, shown: Shown) -> None:
        """Add the panel where the GUI is.

        Args:
            page: What it shares with others.
            shown: The robot.
        """
        self.shown, self.robot = shown, shown.robot
        super().__init__(page)

    @classmethod
    def fits(cls, shown: Shown) -> bool:
        """Return whether a robot can have it."""
        return True
