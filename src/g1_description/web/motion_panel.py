"""Motions from files: opening, time line, and checks."""

from __future__ import annotations

import math
import re
import time
from functools import partial
from pathlib import Path, PureWindowsPath
from secrets import token_hex
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from g1_description.checks.verdict import Verdict
from g1_description.errors import InvalidValueError, MotionError
from g1_description.motion.motion import Motion
from g1_description.web.findings_panel import FindingList, plain
from g1_description.web.mend_buttons import MendButtons
from g1_description.web.panel import Key, Panel
from g1_description.web.robot import Player, ShownRobot
from g1_description.web.ui_loop import Lane

if TYPE_CHECKING:
    from viser import UploadedFile


STEP = 0.001
"""Step of the time line, in [s]."""

REST = 1.0
"""Pause before a motion is repeated, in [s]."""

RATE = 30.0
"""Default rate of files without times, in [Hz]."""

SPEEDS = ("0.1", "0.25", "0.5", "1", "1.5", "2", "4")

SUFFIX = re.compile(r"(\.[A-Za-z0-9]{1,10}){0,2}$")
"""End of a file's name that readers look at."""


class MotionPanel(Panel):
    """Opens, plays and checks motions."""

    def build(self) -> None:
        """Add the elements."""
        gui, ui, names = self.gui, self.ui, [robot.name for robot in self.world.robots]
        self._read_only = self.page.read_only
        self.player: Player | None = None
        self.motions: dict[ShownRobot, Motion] = {}
        """The open ones."""
        self.verdicts: dict[ShownRobot, Verdict] = {}
        """Verdicts on open motions, as far as they are checked."""
        self.opened = 0
        """Number of motions that were opened up to now."""
        self._titles: dict[ShownRobot, str] = {}
        self._files = Lane(ui)
        self._again = math.inf
        """Time of the next repetition on the monotonic clock, in [s]."""
        can_open = not self._read_only and self.world.can_move
        file = gui.add_upload_button("Open a motion", visible=can_open)
        self._robot = gui.add_dropdown(
            "Robot", names, visible=can_open and len(names) > 1
        )
        self._rate = gui.add_number(
            "Samples per second",
            RATE,
            min=0.001,
            max=1e6,
            hint="for files without times",
            visible=can_open,
        )
        self._title = gui.add_markdown("*No motion is open.*" if can_open else "")
        self._line = gui.add_slider(
            "Time", 0.0, 1.0, STEP, 0.0, visible=False, disabled=self._read_only
        )
        self._play = gui.add_button("Play", visible=False)
        self._steps = gui.add_button_group(
            "Sample", ["first", "-1", "+1", "last"], visible=False
        )
        self._speed = gui.add_dropdown(
            "Speed", SPEEDS, initial_value="1", visible=False
        )
        self._loop = gui.add_checkbox("Loop", self._read_only, visible=False)
        self._findings = {
            robot: FindingList(gui, ui, self.jump, self._read_only)
            for robot in self.world.robots
        }
        self._mends = (
            {} if self._read_only else {r: self._mend(r) for r in self._findings}
        )
        file.on_upload(lambda _: self._uploaded(file.value))
        ui.on(self._robot, lambda: None)
        ui.on(self._line, self._moved)
        ui.on(self._play, self.toggle)
        ui.on(self._steps, lambda: self.step(self._steps.value))
        ui.on(self._speed, self._change_speed)

    def _mend(self, robot: ShownRobot) -> MendButtons:
        """Add the buttons that fix the motion of a robot to its findings."""
        with self._findings[robot].folder:
            return MendButtons(self.page, robot, partial(self._replace, robot))

    def hotkeys(self) -> list[Key]:
        """List its keys."""
        return [
            Key("Space", "play, or pause", self.toggle, "space"),
            Key("←", "one sample back", lambda: self.step("-1"), "arrowleft"),
            Key("→", "one sample on", lambda: self.step("+1"), "arrowright"),
        ]

    # --- opening ---

    def _uploaded(self, file: UploadedFile) -> None:
        """Open a file that came from a browser; called by a thread of viser."""
        robots = {robot.name: robot for robot in self.world.robots}
        robot, name = robots[self._robot.value], PureWindowsPath(file.name).name
        name = name or "file"
        read = partial(self._read, name, file.content, robot)
        self._files.do(read, partial(self.open, name, robot))

    def _read(self, name: str, content: bytes, robot: ShownRobot) -> Motion:
        """Read a motion; errors have the person's name of the file."""
        rate = float(self._rate.value)
        if not 0.0 < rate < math.inf:
            raise InvalidValueError(
                f"Samples per second must be greater than 0 (got {rate:g})."
            )
        end = SUFFIX.search(name)
        with TemporaryDirectory(prefix="g1_description_upload_") as folder:
            path = Path(folder, f"upload_{token_hex(4)}{end.group() if end else ''}")
            path.write_bytes(content)
            try:
                # None for the default rate, else files with times would note that it
                # is ignored.
                return self.world.read(path, robot, None if rate == RATE else rate)
            except MotionError as error:
                text = str(error).replace(str(path), name).replace(path.name, name)
                raise MotionError(text) from error

    def open(
        self,
        name: str,
        robot: ShownRobot,
        motion: Motion,
        at: float | None = None,
    ) -> None:
        """Set the motion of a robot, and show its time line.

        Args:
            name: Its name.
            robot: The robot.
            motion: The motion.
            at: Time at which the robot is already, in [s]; None: it may be elsewhere.
        """
        self.motions[robot] = motion
        self.verdicts.pop(robot, None)
        player = self.player = self.world.open(robot, motion, at)
        span = player.end - player.begin
        self._line.min, self._line.max = player.begin, player.begin + max(span, STEP)
        self.show(self._line, round(player.time, 3))
        for element in (self._line, self._play, self._steps, self._speed, self._loop):
            element.visible = not self._read_only
        self._line.visible = True
        self._titles[robot] = _title(name, motion)
        self._title.content = "\n\n".join(self._titles.values())
        self._findings[robot].begin(name)
        if robot in self._mends:
            self._mends[robot].opened(name, motion)
        self.page.checks.check_motion(
            self,
            robot,
            motion,
            partial(self._checked, robot, motion),
            self._findings[robot].fail,
            self.page.scene_of(robot),
        )
        self.opened += 1
        if self._read_only:
            self._start(player.begin)

    def _checked(self, robot: ShownRobot, motion: Motion, verdict: Verdict) -> None:
        """Show findings, unless another motion was opened meanwhile."""
        if self.motions.get(robot) is motion and self.player is not None:
            self.verdicts[robot] = verdict
            span = self.player.begin, self.player.end
            self._findings[robot].show(verdict, span)
            if robot in self._mends:
                self._mends[robot].checked(verdict)

    def _replace(self, robot: ShownRobot, name: str, motion: Motion) -> None:
        """Open another motion in place of the open one, at the shown time."""
        at = self._player.time
        self.open(name, robot, motion, at)
        if robot.history is None:  # a robot that runs stays where it is
            self.jump(at)

    # --- playing ---

    def play(self) -> None:
        """Play the open motion from its first sample.

        Raises:
            InvalidValueError: If none is open.
        """
        self._start(self._player.begin)

    def _start(self, begin: float) -> None:
        """Play from a time; at the end, from the first sample."""
        player = self._player
        begin = player.begin if begin >= player.end else begin
        speed, self._again = float(self._speed.value), math.inf
        self.ui.calls.do(lambda: player.play(begin, speed))

    @property
    def _player(self) -> Player:
        if self.player is None:
            raise InvalidValueError("No motion is open: open a file first.")
        return self.player

    def toggle(self) -> None:
        """Play, or pause."""
        player = self._player
        if self._play.label == "Pause":  # the label when it was pressed
            self.ui.calls.do(player.pause)
        else:
            self._start(player.time)

    def _change_speed(self) -> None:
        """Continue at another speed."""
        if self._player.is_running:
            self._start(self._player.time)

    def _moved(self) -> None:
        """Show the selected time."""
        to = float(self._line.value)
        if math.isfinite(to):
            self.jump(to)

    def step(self, requested: str) -> None:
        """Show the ``first``, ``last``, previous (``-1``) or next (``+1``) sample.

        Raises:
            InvalidValueError: If no motion is open.
        """
        player = self._player
        times = sorted({t for m in self.motions.values() for t in m.times.tolist()})
        near = min(range(len(times)), key=lambda n: abs(times[n] - player.time))
        row = {"first": 0, "-1": near - 1, "+1": near + 1}.get(
            requested, len(times) - 1
        )
        self.jump(times[min(max(row, 0), len(times) - 1)])

    def jump(self, to: float) -> None:
        """Show the configuration of a time."""
        player = self._player
        self._again = math.inf
        to = min(max(to, player.begin), player.end)
        self._line.value = to  # as if a person had set it
        self.ui.calls.do(partial(player.show, to), key=self)

    def update(self) -> None:
        """Update the time line, and repeat the motion if selected."""
        now, player = time.monotonic(), self.player
        if player is None:
            return
        at, is_running = player.time, player.is_running
        if is_running and at >= player.end:
            player.rest()
            is_running = False
            self._again = now + REST if self._loop.value else math.inf
        if now > self._again and self._loop.value and not self.ui.calls.is_busy:
            self._start(player.begin)
        self._play.label = "Pause" if is_running else "Play"
        self.show(self._line, round(min(max(at, player.begin), player.end), 3))


def _title(name: str, motion: Motion) -> str:
    """Describe a motion in Markdown."""
    times = motion.times
    notes = "".join(f"\n- {plain(note)}" for note in motion.notes)
    lasts = f"{times[-1] - times[0]:.2f} s, {len(times)} samples"
    return f"**{plain(name)}** {lasts}{notes}"
