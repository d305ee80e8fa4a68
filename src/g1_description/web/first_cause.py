"""The first cause of the last failure of a robot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Tuple

from g1_description.checks.first_cause import Explanation, failure_text
from g1_description.errors import G1DescriptionError
from g1_description.motion.history import CommandStream
from g1_description.motion.history_chunks import Stretch
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
    ) -> None:
        """Explain a failure.

        Args:
            robot: The robot.
            read: Returns its states and commands.
            show: Given the time of the first cause in [s], shows it.
        """

        def write(states: Stretch, found: Explanation | None) -> None:
            head, *lines = failure_text(found, states).splitlines()
            rows = [f"- {plain(line)}" for line in lines]
            self._text.content = "\n".join([f"**{plain(head)}**", "", *rows])
            if found is not None:
                show(next(iter(found.chain), found.failure).time)

        def forget() -> None:
            self._text.content = ""

        def get() -> Past:
            try:
                return read()
            except G1DescriptionError:
                self._page.ui.post((self, "failed"), forget)
                raise

        def ask(past: Past) -> None:
            self._page.checks.ask(
                self,
                robot,
                lambda checker: checker.explain(*past),
                partial(write, past[0]),
                forget,
            )

        self._text.content = "*Looking for the first cause ...*"
        self._lane.do(get, ask)
