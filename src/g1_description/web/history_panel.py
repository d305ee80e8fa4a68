"""The history of robots that run: rewound, checked, saved, and gone on from."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Callable

from g1_description.checks.verdict import Verdict
from g1_description.errors import G1DescriptionError, InvalidValueError
from g1_description.motion.history import CommandStream, HistoryPart
from g1_description.motion.motion import Motion
from g1_description.robot.state import RobotState
from g1_description.web.check_thread import CheckThread
from g1_description.web.findings_panel import FindingList, plain
from g1_description.web.motion_panel import MotionPanel
from g1_description.web.robot import ShownRobot, ShownWorld
from g1_description.web.saved_motions import check_file_name, folder, save_motion
from g1_description.web.ui_loop import Lane, UiLoop

if TYPE_CHECKING:
    from viser import GuiApi, GuiMarkdownHandle

    from g1_description.ros.history import HistoryClient

SECOND = 1_000_000_000
"""In [ns]."""

LENGTHS = ("5", "10", "30", "60", "300", "600")
"""Lengths of the time line to choose from, in [s]."""

STEP = 0.001
"""Step of the time line, in [s]."""

PERIOD = 0.1
"""Period of updates of the text, in [s]."""

BEFORE, AFTER = 10 * SECOND, SECOND
"""Commands are listed from this time before the shown one to that after it: a motion
may still be played."""

MAX_LINES = 12
"""Largest number of listed commands."""


@dataclass(eq=False)
class Timeline:
    """A part of the past of a robot; it stays as it is while time goes on."""

    robot: ShownRobot
    run: int
    """Number of the run; 0: the newest, until a state of it is known."""

    end: int
    """Its right end, in [ns]; 0: that of the run, until it is known."""

    left_at: int
    """When the page left the present, or the end of an earlier run, in [ns]."""

    wanted: int = 0
    """The time that was last asked for, in [ns]."""

    state: RobotState | None = None
    """The shown state, once it is known."""

    before: RobotState | None = None
    """One shortly before it, if there is one."""

    is_newest: bool = True
    """Whether there was no later run when the state was asked for."""


class HistoryPanel:
    """Shows the past of one robot, in all browsers; the robot is not commanded."""

    def __init__(
        self,
        gui: GuiApi,
        ui: UiLoop,
        world: ShownWorld,
        checks: CheckThread,
        motion: MotionPanel,
        told: GuiMarkdownHandle,
    ) -> None:
        """Add the panel.

        Args:
            gui: Where to.
            ui: Runs the actions.
            world: The robots, which have a history.
            checks: Checks motions.
            motion: Plays motions, which end where a robot is put to a past state.
            told: Says that the past is shown.
        """
        self._ui, self._world, self._checks = ui, world, checks
        self._motion, self._told = motion, told
        self._robots = {robot.name: robot for robot in world.robots}
        self._lane = Lane(ui)
        self.shown: Timeline | None = None
        """What is shown, with its state; None: the present."""
        self._wanted: Timeline | None = None
        """What is shown or has been asked for."""
        self._looked = 0.0
        self._add(gui)
        self._checked = Timeline(world.robots[0], 0, 0, 0)
        """The one that was checked last."""
        self._findings = FindingList(
            gui, ui, lambda at: self._jump(self._checked, at), False
        )

    def _add(self, gui: GuiApi) -> None:
        """Add the elements."""
        ui = self._ui
        self._whose = gui.add_dropdown(
            "History of", [*self._robots], visible=len(self._robots) > 1
        )
        self._runs = gui.add_dropdown(
            "Run", ["1"], hint="a new one begins when time goes back", visible=False
        )
        self._length = gui.add_dropdown(
            "Last seconds",
            LENGTHS,
            initial_value="30",
            hint="what the time line shows, and what is checked, saved and plotted",
        )
        self._back = gui.add_slider(
            "Back",
            -30.0,
            0.0,
            STEP,
            0.0,
            hint="in s before the right end, which is live",
        )
        self._steps = gui.add_button_group("State", ["-1 s", "-1", "+1", "+1 s"])
        live = gui.add_button("Live", hint="show the robot as it is now")
        start = gui.add_button(
            "Start here",
            color="orange",
            hint="put the robot to the shown state, at rest; physics does not go on "
            "from there to the last bit",
        )
        check = gui.add_button("Check this range", hint="the time line")
        self._name = gui.add_text(
            "File name", "history", hint="a motion; a bag if it ends in .bag"
        )
        save = gui.add_button("Save this range", hint=f"into {folder()}")
        self._problem = gui.add_markdown("", visible=False)
        self.found = gui.add_markdown("")
        """What is found at the shown time."""
        self._list = gui.add_markdown("")
        ui.on(self._whose, self.live)
        ui.on(self._runs, self._choose_run)
        ui.on(self._length, self._set_length)
        ui.on(self._back, self._dragged)
        ui.on(self._steps, lambda: self.step(self._steps.value))
        ui.on(live, self.live)
        ui.on(start, self._start)
        ui.on(check, self._check)
        ui.on(save, self._save)

    # --- what is shown ---

    @property
    def length(self) -> int:
        """Length of the time line, in [ns]."""
        return int(self._length.value) * SECOND

    def past(self, robot: ShownRobot) -> Timeline | None:
        """Return the time line of a robot whose past is shown; None: its present."""
        is_chosen = self.shown is not None and self.shown.robot is robot
        return self.shown if is_chosen else None

    def live(self) -> None:
        """Show the robot as it is now."""
        self.shown = self._wanted = None
        self._back.value = 0.0
        self._list.content = self.found.content = ""
        self._tell("")

    def follow(self) -> None:
        """Say which time is shown."""
        now = time.monotonic()
        if now < self._looked + PERIOD:
            return
        self._looked = now
        text, line = "**Live**", self.shown
        if line is not None and line.state is not None:
            newest, when = line.robot.state(), f"{line.state.time:.3f} s"
            is_later = newest is not None and newest.stamp >= line.left_at
            if not (line.is_newest and is_later):
                when = f"run {line.run}, {when}"
            whose = f" of {plain(line.robot.name)}" if len(self._robots) > 1 else ""
            text = f"**Past{whose}:** {when}, *key L: live*"
        if self._told.content != text:  # which is always one line: nothing moves
            self._told.content = text

    @property
    def _robot(self) -> ShownRobot:
        """The chosen robot."""
        return self._robots[str(self._whose.value)]

    def _set_length(self) -> None:
        """Change the length of the time line; the shown time stays."""
        self._back.min = -1e-9 * self.length
        self._show_place()

    def _show_place(self) -> None:
        """Move the handle to the shown time, and the time line if that is beyond it."""
        line = self.shown
        if line is None or line.state is None:
            return
        at = line.state.stamp
        if not line.end - self.length <= at <= line.end:
            line.end = min(at + self.length // 2, line.left_at)
        back = 1e-9 * (at - line.end)
        self._back.value = round(min(max(back, -1e-9 * self.length), 0.0), 3)

    # --- going back ---

    def _line(self) -> Timeline:
        """Return what is shown or asked for, else a time line that ends now.

        Raises:
            InvalidValueError: If there is no state yet.
        """
        if self._wanted is not None:
            return self._wanted
        state = self._robot.state()
        if state is None:
            raise InvalidValueError(
                f"No state of {self._robot.name} has been received yet."
            )
        return Timeline(self._robot, 0, state.stamp, state.stamp, state.stamp)

    def _dragged(self) -> None:
        """Show the time at the handle."""
        back, line = float(self._back.value), self._wanted
        back = min(max(back, -1e-9 * self.length), 0.0)
        is_end_now = line is None or (line.is_newest and line.end == line.left_at)
        if not back < 0.0 and is_end_now:
            self.live()
            return
        line = self._line()
        self._show(line, line.end + round(SECOND * back), is_dragged=True)

    def step(self, way: str) -> None:
        """Show the previous (``-1``) or next (``+1``) state, or that a second away.

        Raises:
            InvalidValueError: If there is no state yet.
        """
        if self._wanted is None and way.startswith("+"):
            return  # there is nothing later
        line = self._line()
        if way == "+1":
            state = line.state
            if state is not None and state.stamp < line.left_at:
                at, end = state.stamp, line.left_at
                self._fetch(line, lambda history, run: history.after(at, end, run))
            return
        shift = {"-1": -1, "-1 s": -SECOND}.get(way, SECOND)
        self._show(line, min(line.wanted + shift, line.left_at))

    def go_to(self, robot: ShownRobot, at: float) -> None:
        """Show a robot at a past time, in [s]; another one only if none is shown."""
        if self._wanted is None:
            self._whose.value = robot.name
        line = self._line()
        self._show(line, min(round(SECOND * at), line.left_at))

    def _jump(self, line: Timeline, at: float) -> None:
        """Show a time of a time line that was checked, in [s]."""
        self._whose.value = line.robot.name
        self._show(replace(line, state=None, before=None), round(SECOND * at))

    def _choose_run(self) -> None:
        """Show the last state of a run."""
        run = int(self._runs.value)
        line = Timeline(self._robot, run, 0, 0)

        def last(history: HistoryClient, run: int) -> HistoryPart:
            return history.at(history.part(run=run, max_states=1).last, run)

        self._fetch(line, last)

    def _show(self, line: Timeline, stamp: int, is_dragged: bool = False) -> None:
        """Show the last state that is not later than a time, or the first one."""
        line.wanted = stamp
        self._fetch(line, lambda history, run: history.at(stamp, run), is_dragged)

    def _fetch(
        self,
        line: Timeline,
        ask: Callable[[HistoryClient, int], HistoryPart],
        is_dragged: bool = False,
    ) -> None:
        """Request a state; a newer request replaces it."""
        self._wanted, wanted = line, line.wanted

        def fetch() -> Callable[[], object]:
            try:
                history = _history(line.robot)
                part = ask(history, line.run)
                stamp = int(part.stretch.stamps[-1])
                span = max(stamp - BEFORE, 1), stamp + AFTER
                run = part.stretch.run
                around = history.part(*span, run, max_states=1, with_commands=True)
            except G1DescriptionError as error:
                return partial(self._fail, line, str(error))
            commands = around.commands
            return partial(self._arrived, line, wanted, part, commands, is_dragged)

        self._ui.calls.do(fetch, lambda show: show(), key=self)

    def _fail(self, line: Timeline, problem: str) -> None:
        """Tell why a state cannot be shown; what is shown stays."""
        if self._wanted is line:
            self._wanted = self.shown
            self._show_place()
            if self.shown is None:
                self.live()
            self._tell(problem)

    def _arrived(
        self,
        line: Timeline,
        wanted: int,
        part: HistoryPart,
        commands: Sequence[CommandStream],
        is_dragged: bool,
    ) -> None:
        """Show a state; that of a time line that was left meanwhile is dropped."""
        if self._wanted is not line:
            return
        states = part.stretch.states()
        line.state, line.before = states[-1], states[0] if states[1:] else None
        if line.wanted == wanted:
            line.wanted = line.state.stamp
        line.run, line.is_newest = part.stretch.run, part.stretch.run == part.last_run
        if not line.left_at:
            line.end = line.left_at = part.last
        self.shown = line
        runs = tuple(str(run) for run in range(part.first_run, part.last_run + 1))
        if tuple(self._runs.options) != runs:
            self._runs.options = runs
        self._runs.value = str(line.run)
        self._runs.visible = len(runs) > 1
        if not is_dragged:
            self._show_place()
        self._list.content = commands_text(commands)
        is_before = 0 < wanted < part.first
        begin = f"The history of run {line.run} begins at {1e-9 * part.first:.3f} s."
        self._tell(begin if is_before else "")

    def _tell(self, problem: str) -> None:
        """Show a problem, or none."""
        self._problem.content = plain(problem)
        self._problem.visible = bool(problem)

    # --- what is done with it ---

    def _start(self) -> None:
        """Put the robot to the shown state, and show it live."""
        line = self.shown
        if line is None or line.state is None:
            raise InvalidValueError("Go back to a past state first.")
        self._ui.calls.do(
            partial(self._place, line.robot, line.state), lambda _: self.live()
        )

    def _place(self, robot: ShownRobot, state: RobotState) -> None:
        """Put a robot to a state, and end a motion of this page."""
        player, simulator = self._motion.player, self._world.simulator
        if player is not None and player.is_running:
            player.pause()
        positions = state.positions_by_name
        if simulator is not None and not simulator.is_kinematic:
            simulator.place(robot.name, state)
            self._ui.tell(
                "The robot begins there at rest; physics does not go on as it did to "
                "the last bit."
            )
        elif state.base_pose is None:
            robot.command(positions)
        else:
            robot.command_all(positions, state.base_pose)

    def _whole(self) -> tuple[Timeline, Callable[[], HistoryPart]]:
        """Return the time line as it is now, and what asks for all of its states."""
        line, length = replace(self._line()), self.length
        begin = max(line.end - length, 1)
        history = _history(line.robot)
        return line, lambda: history.whole(begin, line.end, line.run)

    def past_motion(self) -> tuple[ShownRobot, Motion] | None:
        """Return the time line with simulated times; None: the present is shown.

        Raises:
            G1DescriptionError: If the bridge does not give it.
        """
        if self.shown is None:
            return None
        line, ask = self._whole()
        return line.robot, _timed(ask())

    def _check(self) -> None:
        """Check the time line."""
        line, ask = self._whole()
        begin, end = 1e-9 * max(line.end - self.length, 0), 1e-9 * line.end
        self._findings.begin(f"{begin:.1f} s to {end:.1f} s")

        def motion() -> Motion:
            try:
                part = ask()
                line.run = part.stretch.run
                if part.note:
                    self._ui.tell(part.note)
                return _timed(part)
            except G1DescriptionError:
                self._ui.post((self, "failed"), self._findings.fail)
                raise

        def check(found: Motion) -> None:
            span = found.times[0], found.times[-1]
            show = partial(self._show_verdict, line, span)
            fail = self._findings.fail
            self._checks.check_motion(self, line.robot, found, show, fail)

        self._lane.do(motion, check)

    def _show_verdict(
        self, line: Timeline, span: tuple[float, float], verdict: Verdict
    ) -> None:
        """Show findings."""
        self._checked = line
        self._findings.show(verdict, span)

    def _save(self) -> None:
        """Save the time line as a motion."""
        name = self._name.value.strip()
        check_file_name(name)
        line, ask = self._whole()

        def save() -> None:
            part = ask()
            motion, begin = part.stretch.motion(), int(part.stretch.stamps[0])
            file = save_motion(name, motion, line.robot.description, begin)
            text = f"Saved {file}, {motion.duration:.2f} s. {part.note}"
            self._ui.tell(text.strip(), "green")

        self._lane.do(save)


def _timed(part: HistoryPart) -> Motion:
    """Return states as a motion, whose findings have simulated times."""
    return replace(part.stretch.motion(), times=1e-9 * part.stretch.stamps)


def _history(robot: ShownRobot) -> HistoryClient:
    """Return the history of a robot that has one."""
    assert robot.history is not None
    return robot.history


def commands_text(commands: Sequence[CommandStream]) -> str:
    """Format commands in Markdown, with time, sender and content."""
    lines = ["**Commands, 10 s before to 1 s after:**" + " none" * (not commands), ""]
    if len(commands) > MAX_LINES:
        lines.append(f"- {len(commands) - MAX_LINES} earlier ones")
    for one in commands[-MAX_LINES:]:
        sender, topic, content, _ = one.command
        again = f" x {one.count}" if one.count > 1 else ""
        text = f"{1e-9 * one.first:.3f} s{again}, {sender}, {topic}: {content}"
        lines.append(f"- {plain(text)}")
    return "\n".join(lines)
