"""Buttons that fix the open motion of a robot, undo that, and download the motion."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path, PureWindowsPath
from typing import Any

from g1_description.checks.verdict import Verdict
from g1_description.errors import G1DescriptionError, InvalidValueError
from g1_description.mend.certificate import Certificate
from g1_description.mend.mending import Mended, mending_steps
from g1_description.mend.options import FINDINGS
from g1_description.motion.files.formats import contents
from g1_description.motion.motion import Motion
from g1_description.scenes.scene import Scene
from g1_description.web.findings_panel import failed_causes, plain
from g1_description.web.panel import PageContext
from g1_description.web.robot import ShownRobot
from g1_description.web.ui_loop import Lane

FIXED = frozenset(check for checks in FINDINGS.values() for check in checks)
"""Checks whose findings can be fixed."""

PARTS = ("joints", "sliding joints", "base")
"""Parts of the robot whose changes are shown."""

MAX_LEFT = 3
"""Largest number of shown sentences on what is left."""


class MendButtons:
    """Fixes the open motion of one robot."""

    def __init__(
        self,
        page: PageContext,
        robot: ShownRobot,
        replace: Callable[[str, Motion], object],
    ) -> None:
        """Add hidden buttons where the GUI is.

        Args:
            page: What it shares with others.
            robot: The robot.
            replace: Opens another motion in place of the open one, with its name.
        """
        gui, ui = page.server.gui, page.ui
        self._page, self._robot, self._replace = page, robot, replace
        self._lane = Lane(ui)
        self._open: tuple[str, Motion] | None = None
        """The open motion, and its name."""
        self._fixed: tuple[Motion, Motion] | None = None
        """The motion as it was opened, and the fixed one; None: it is not fixed."""
        self._fix = gui.add_button(
            "Fix", hint="removes findings by small changes", visible=False
        )
        self._undo = gui.add_button(
            "Undo", hint="the motion as it was opened", visible=False
        )
        self._download = gui.add_button("Download", hint="the open motion as CSV")
        self._text = gui.add_markdown("")
        ui.on(self._fix, self.fix)
        ui.on(self._undo, self.undo)
        self._download.on_click(self._send)

    def opened(self, name: str, motion: Motion) -> None:
        """Note which motion is open, also after ``replace``.

        Args:
            name: Its name.
            motion: The motion.
        """
        self._lane.cancel("fix")
        self._open = name, motion
        if self._fixed is not None and motion is not self._fixed[1]:
            self._fixed = None
        self._fix.visible = self._fix.disabled = False
        self._undo.visible = self._fixed is not None
        self._text.content = ""

    def checked(self, verdict: Verdict) -> None:
        """Offer to fix the open motion, if that can be fixed and is not yet.

        Args:
            verdict: The verdict on it.
        """
        found = any(finding.check in FIXED for finding in verdict.findings)
        self._fix.visible = found and self._fixed is None

    def fix(self) -> None:
        """Fix the open motion, which takes a while."""
        if self._open is None or not self._fix.visible or self._fix.disabled:
            return  # another browser was faster
        self._fix.disabled = True
        self._text.content = "*Fixing ...*"
        motion, scene = self._open[1], self._page.scene_of(self._robot)
        self._lane.go_through(self._steps(motion, scene), self._found, "fix")

    def _steps(self, motion: Motion, scene: Scene | None) -> Iterator[Verdict | Mended]:
        """Fix a motion; called by the thread of the lane."""
        try:
            # A checker of its own, as PyBullet is made for one thread.
            checker = self._page.make_checker(self._robot.description)
            checker = checker.among(scene) if scene else checker
            yield from mending_steps(checker, motion)
        except Exception:
            self._page.ui.post(object(), partial(self._fail, motion))
            raise

    def _fail(self, motion: Motion) -> None:
        """Show that a motion could not be fixed, if it is still open."""
        if self._open is not None and self._open[1] is motion:
            self._fix.disabled = False
            self._text.content = "*The motion could not be fixed.*"

    def _found(self, found: Verdict | Mended) -> None:
        """Show what still fails, and in the end the fixed motion and its changes."""
        assert self._open is not None
        if isinstance(found, Verdict):
            self._text.content = f"*Fixing ... failures left: {failed_causes(found)}*"
            return
        self._fix.visible = False
        name, motion = self._open
        if found.certificate.moved:
            self._fixed = motion, found.motion
            self._replace(name, found.motion)
        counts = failed_causes(found.before), failed_causes(found.after)
        self._text.content = summary(found.certificate, counts)

    def undo(self) -> None:
        """Open the motion again as it was opened.

        Raises:
            InvalidValueError: If it is not fixed.
        """
        if self._open is None or self._fixed is None:
            raise InvalidValueError("There is nothing to undo.")
        self._replace(self._open[0], self._fixed[0])

    def _send(self, event: Any) -> None:
        """Send the open motion to one person; called by a thread of viser's."""
        client = event.client
        if client is None or self._open is None:
            return
        (name, motion), fixed = self._open, self._fixed
        is_fixed = fixed is not None and motion is fixed[1]
        stem = PureWindowsPath(name).stem or "motion"
        file = Path(f"{stem}_fixed.csv" if is_fixed else f"{stem}.csv")
        try:
            files, _ = contents(file, motion, self._robot.description)
        except G1DescriptionError as error:
            client.add_notification("No file", f"{error}", color="red")
            return
        client.send_file_download(file.name, files[file], save_immediately=True)


def summary(certificate: Certificate, failures: tuple[int, int]) -> str:
    """Format in Markdown what was changed, and what is left.

    Args:
        certificate: That of the motion.
        failures: Numbers of causes with a failure, before and after.
    """
    before, after = failures
    if certificate.moved:
        moved = [
            f"{one.name} {one.rms:.3g} {one.unit}"
            for one in certificate.moved
            if one.name in PARTS
        ]
        lines = [f"**Fixed.** Failures: {before} before, {after} after."]
        lines += [plain(f"Changes (rms): {', '.join(moved)}.")]
    else:
        lines = ["**Nothing was changed.** Small changes do not remove what was found."]
    left = [f"- {plain(text)}" for text in certificate.left[:MAX_LEFT]]
    if left:
        more = len(certificate.left) - len(left)
        left += [f"- and {more} more"] if more else []
        left = ["", "Left:", "", *left]
    return "  \n".join(lines) + "\n".join(["", *left])
