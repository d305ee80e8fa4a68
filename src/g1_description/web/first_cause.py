"""The first cause of the last failure of a robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Callable, Sequence, Tuple

from g1_description.checks.checker import Checker
from g1_description.checks.first_cause import Explanation, failure_text
from g1_description.errors import G1DescriptionError
from g1_description.motion.history import CommandStream
from g1_description.motion.history_chunks import Stretch
from g1_description.scenes.scene import Scene
from g1_description.web.findings_panel import plain
from g1_description.web.panel import PageContext
from g1_description.web.robot import ShownRobot
from g1_description.web.ui_loop import Lane

if TYPE_CHECKING:
    from viser import GuiApi

Past = Tuple[Stretch, Sequence[CommandStream]]
"""States, and the commands meanwhile with their positions."""


class FirstCause:
    """A text that explains the last failure."""

    def __init__(self, gui: GuiApi, page: PageContext, lane: Lane) -> None:
        """Add the text, still empty; the lane reads states."""
        self._page, self._lane = page, lane
        self._text = gui.add_markdown("")

    def explain(
        self,
        robot: ShownRobot,
        read: Callable[[], Past],
        show: Callable[[float], object] = lambda _: None,
        scene: Scene | None = None,
    ) -> None:
        """Explain a failure.

        Args:
            robot: The robot.
            read: Returns its states and commands.
            show: Given the time of the first cause in [s], shows it.
            scene: The objects around the robot; None: there are none.
        """

        def forget() -> None:
            self._text.content = ""

        def get() -> Past:
            try:
                return read()
            except G1DescriptionError:
                self._page.ui.post((self, "failed"), forget)
                raise

        def ask(past: Past) -> None:
            def find(checker: Checker) -> Explanation | None:
                return (checker.among(scene) if scene else checker).explain(*past)

            def write(found: Explanation | None) -> None:
                self._text.content = _markdown(found, past[0])
                if found is not None:
                    show(next(iter(found.chain), found.failure).time)

            self._page.checks.ask(self, robot, find, write, forget)

        self._text.content = "*Looking for the first cause ...*"
        self._lane.do(get, ask)


def _markdown(found: Explanation | None, states: Stretch) -> str:
    """Write an explanation with its events as a list."""
    head, *lines = map(plain, failure_text(found, states).splitlines())
    count = len(found.later) if found else 0
    events = "\n".join(f"- {line}" for line in lines[:count])
    return "\n\n".join(filter(None, [f"**{head}**", events, *lines[count:]]))
