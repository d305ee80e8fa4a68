"""Findings of motions: a summary, bars along the time line, and buttons."""

from __future__ import annotations

import html
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from g1_description.checks.marks import short_name
from g1_description.checks.verdict import FAILED, Finding, Verdict, cause_text, worst_of
from g1_description.web.ui_loop import UiLoop

if TYPE_CHECKING:
    from viser import GuiApi, GuiButtonHandle


SPECIAL = frozenset("\\`*_{}[]()#+-.!|<>&~$:/@")
"""Special characters of Markdown; ``:`` and others make links of addresses."""


def plain(text: str) -> str:
    """Escape a text for Markdown, in one line."""
    line = " ".join(text.split())
    return "".join(f"\\{c}" if c in SPECIAL else c for c in line)


MAX_BUTTONS = 25
"""Largest number of causes with a button; failures come first, then the earliest."""

COLORS = {FAILED: "#d64541", "warning": "#f0932b"}

LEAST_WIDTH = 0.6
"""Least width of a bar, in percent of the motion."""


class FindingList:
    """Shows the findings of the motion of one robot."""

    def __init__(
        self, gui: GuiApi, ui: UiLoop, jump: Callable[[float], object], read_only: bool
    ) -> None:
        """Create a hidden list.

        Args:
            gui: Where to.
            ui: Does what a person wants.
            jump: Shows a time in [s].
            read_only: Whether to show text instead of buttons.
        """
        self._gui, self._ui, self._jump = gui, ui, jump
        self._read_only = read_only
        self._buttons: list[GuiButtonHandle] = []
        self.folder = gui.add_folder("Findings", visible=False)
        """Where the findings are."""
        with self.folder:
            # Kept: removing them during their creation is an error in the browser.
            self._summary = gui.add_markdown("")
            self._strips = gui.add_html("")
            self._chosen = gui.add_markdown("")

    def begin(self, name: str) -> None:
        """Show that a motion is being checked."""
        self._clear()
        self.folder.label = f"Findings: {name}"
        self.folder.visible = True
        self._summary.content = "*Checking ...*"

    def fail(self) -> None:
        """Show that a motion could not be checked."""
        self._summary.content = "*The check failed.*"

    def _clear(self) -> None:
        """Remove the findings of the last motion."""
        for button in self._buttons:
            button.remove()
        self._buttons = []
        self._strips.content = self._chosen.content = ""

    def show(self, verdict: Verdict, span: tuple[float, float]) -> None:
        """Show findings.

        Args:
            verdict: The verdict on the motion.
            span: Start and end of the time line, in [s].
        """
        self._clear()
        causes = verdict.causes[:MAX_BUTTONS]
        more = len(verdict.causes) - len(causes)
        rest = f"  \n{more} more are not listed; `check` lists all." if more > 0 else ""
        self._summary.content = summary(verdict) + rest
        if causes:
            self._strips.content = strips(causes, span)
        if self._read_only:
            lines = [f"- {plain(title(findings))}" for findings in causes]
            self._summary.content += "\n\n" + "\n".join(lines)
        else:
            with self.folder:
                self._buttons = [self._add(findings) for findings in causes]

    def _add(self, findings: Sequence[Finding]) -> GuiButtonHandle:
        """Add the button of the findings of one cause."""
        worst = worst_of(findings)
        button = self._gui.add_button(
            title(findings),
            hint=cause_text(findings),
            color="red" if worst.severity == FAILED else "orange",
        )

        def choose() -> None:
            self._chosen.content = plain(cause_text(findings))
            self._jump(worst.worst_time)

        self._ui.on(button, choose)
        return button


def title(findings: Sequence[Finding]) -> str:
    """Format the findings of one cause in a few words, with the time of the worst."""
    worst = worst_of(findings)
    check = worst.check.replace("_", " ")
    words = check.split()  # "base jump base" says it twice
    names = (name for name in worst.subject if name not in words)
    subject = " - ".join(map(short_name, names))
    more = f" +{len(findings) - 1}" if len(findings) > 1 else ""
    return f"{worst.worst_time:.2f} s  {check} {subject}".strip() + more


def failed_causes(verdict: Verdict) -> int:
    """Count the causes with a failure."""
    return sum(worst_of(found).severity == FAILED for found in verdict.causes)


def summary(verdict: Verdict) -> str:
    """Format a verdict in Markdown, with the skipped checks."""
    failures = failed_causes(verdict)
    warnings = len(verdict.causes) - failures
    counts = [
        f"{count} {word}{'s' if count > 1 else ''}"
        for count, word in ((failures, "failure"), (warnings, "warning"))
        if count
    ]
    lines = [f"**{verdict.severity}**" + (f": {', '.join(counts)}" if counts else "")]
    if verdict.nothing_made:
        lines = [verdict.nothing_made]
    elif verdict.skipped:
        lines.append(f"*Not checked: {', '.join(verdict.skipped)}.*")
    return "  \n".join(lines)


def strips(causes: Sequence[Sequence[Finding]], span: tuple[float, float]) -> str:
    """Draw the times of findings as bars, as wide as the time line, a row per cause.

    Args:
        causes: The findings of each cause.
        span: Start and end of the time line, in [s].

    Returns:
        HTML.
    """
    begin, length = span[0], max(span[1] - span[0], 1e-9)
    rows = []
    for findings in causes:
        color = COLORS[worst_of(findings).severity]
        bars = []
        for first, last in (bar for f in findings for bar in f.intervals):
            left = 100.0 * (first - begin) / length
            width = max(100.0 * (last - first) / length, LEAST_WIDTH)
            bars.append(
                f'<i style="position:absolute;left:{min(left, 100 - width):.2f}%;'
                f"width:{width:.2f}%;height:100%;"
                f'background:{color}"></i>'
            )
        text = html.escape(cause_text(findings), quote=True)
        rows.append(
            f'<div title="{text}" style="position:relative;height:7px;margin:2px 0;'
            f'background:#e6e9ef;border-radius:2px;overflow:hidden">{"".join(bars)}'
            "</div>"
        )
    return f'<div style="margin:0 0.8em 0.5em">{"".join(rows)}</div>'
