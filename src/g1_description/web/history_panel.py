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
from g1_description.motion.history_chunks import Stretch
from g1_description.robot.state import RobotState
from g1_description.web.check_thread import CheckThread
from g1_description.web.findings_panel import FindingList, plain
from g1_description.web.keyframes_panel import folder, save_motion
from g1_description.web.motion_panel import MotionPanel
from g1_description.web.robot import ShownRobot, ShownWorld
from g1_description.web.ui_loop import Newest, UiLoop

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

AROUND = SECOND
"""Commands are listed from this time before the shown one to as long after it."""

MAX_LINES = 12
"""Largest number of listed commands."""


@dataclass(eq=False)
class Line:
    """A time line of the past, which stays as it is while time goes on."""

    robot: ShownRobot
    run: int
    """Number of the run; 0: the newest, until a state of it is known."""

    end: int
    """Its right end, in [ns]; 0: that of the run, until it is known."""

    last: int
    """When the page left the present, or the end of an earlier run, in [ns]."""


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
        self._newest = Newest(ui)
        self._line: Line | None = None
        self._state: RobotState | None = None
        """The shown one; None: live, or not known yet."""
        self._run = 0
        """Number of the newest run; 0: not known."""
        self._live_stamp = 0
        self._looked = 0.0
        self._add(gui)
        self._checked = Line(world.robots[0], 0, 0, 0)
        """The time line that was checked last."""
        self._findings = FindingList(
            gui, ui, lambda at: self._jump(self._checked, at), False
        )

    def _add(self, gui: GuiApi) -> None:
        """Add the elements."""
        ui = self._ui
        self._whose = gui.add_dropdown(
            "Rewind", [*self._robots], visible=len(self._robots) > 1
        )
        self._runs = gui.add_dropdown(
            "Run", ["1"], hint="a new one begins when time goes back", visible=False
        )
        self._length = gui.add_dropdown(
            "Last seconds",
            LENGTHS,
            initial_value="30",
            hint="what the time line shows, and what is checked and saved",
        )
        self._back = gui.add_slider(
            "Back", -30.0, 0.0, STEP, 0.0, hint="in s; at the right end: live"
        )
        self._steps = gui.add_button_group("State", ["-1 s", "-1", "+1", "+1 s"])
        live = gui.add_button("Live", hint="show the robot as it is now")
        start = gui.add_button(
            "Start here",
            hint="put the robot to the shown state, at rest; physics does not go on "
            "from there to the last bit",
        )
        check = gui.add_button("Check this stretch", hint="the time line")
        self._name = gui.add_text(
            "File name", "history", hint="a motion; a bag if it ends in .bag"
        )
        save = gui.add_button("Save this stretch", hint=f"into {folder()}")
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
    def is_past(self) -> bool:
        """Whether the past is shown."""
        return self._line is not None

    def past(self, robot: ShownRobot) -> RobotState | None:
        """Return the past state of a robot that is to be shown; None: the newest."""
        is_chosen = self._line is not None and self._line.robot is robot
        return self._state if is_chosen else None

    @property
    def shown_time(self) -> float | None:
        """The past time that is shown, in [s]; None: live."""
        return None if self._state is None else self._state.time

    @property
    def place(self) -> object:
        """Which part of which past is on the time line; None: the present."""
        line = self._line
        return line and (line.robot, line.run, line.end, self._seconds)

    def states_of(
        self, robot: ShownRobot, few: int, many: int
    ) -> Callable[[], Stretch | None]:
        """Return what asks for the states on the time line of a robot; it blocks.

        Args:
            robot: The robot.
            few: Of the present, this many states are taken.
            many: Of the past, this many.
        """
        length, line = self._seconds * SECOND, self._line

        def ask() -> Stretch | None:
            history = robot.history
            if history is None:
                return None
            if line is not None and line.robot is robot and line.end:
                begin = max(line.end - length, 1)
                return history.part(begin, line.end, line.run, many).stretch
            return history.part(max_states=few, last=1e-9 * length).stretch

        return ask

    def go_to(self, robot: ShownRobot | None, at: float) -> None:
        """Show a robot at a past time, in [s]; None: the chosen one."""
        line = self._line
        if line is None or robot not in (None, line.robot):
            if robot is not None:
                self._whose.value = robot.name
            self._line = None
            line = self._leave()
        stamp = round(SECOND * at)
        self._show(line, min(stamp, line.last or stamp))

    def live(self) -> None:
        """Show the robot as it is now."""
        self._line = self._state = None
        self._back.value = 0.0
        self._list.content = self.found.content = ""
        self._tell("")

    def follow(self) -> None:
        """Say which time is shown."""
        now = time.monotonic()
        if now < self._looked + PERIOD:
            return
        self._looked = now
        newest = self._robot.state()
        stamp = 0 if newest is None else newest.stamp
        text, state, line = "", self._state, self._line
        was_newest = line is not None and line.run == self._run
        if line is not None and was_newest and stamp < min(self._live_stamp, line.last):
            self._run += 1  # a reset
        self._live_stamp = stamp
        if state is not None and line is not None:
            when = f"{1e-9 * (stamp - state.stamp):.2f} s ago ({state.time:.3f} s)"
            if line.run != self._run or stamp < state.stamp:
                when = f"run {line.run}, {state.time:.3f} s"
            text = f"**The past is shown:** {when}.  \n*Live* or the key L ends that."
        if self._told.content != text:
            self._told.content = text
            self._told.visible = bool(text)

    @property
    def _robot(self) -> ShownRobot:
        """The chosen robot."""
        return self._robots[str(self._whose.value)]

    @property
    def _seconds(self) -> int:
        """Length of the time line, in [s]."""
        return int(self._length.value)

    def _set_length(self) -> None:
        """Change the length of the time line; the shown time stays."""
        self._back.min = -float(self._seconds)
        self._show_place()

    def _show_place(self) -> None:
        """Move the handle to the shown time, and the time line if that is beyond it."""
        line, state = self._line, self._state
        if line is None or state is None:
            return
        length = self._seconds * SECOND
        if not line.end - length <= state.stamp <= line.end:
            line.end = min(state.stamp + length // 2, line.last)
        back = 1e-9 * (state.stamp - line.end)
        self._back.value = round(min(max(back, -self._seconds), 0.0), 3)

    # --- going back ---

    def _leave(self) -> Line:
        """Leave the present, if that is not done yet; return the time line."""
        if self._line is None:
            self._line = self._newest_line()
        return self._line

    def _newest_line(self) -> Line:
        """Return the time line that ends now."""
        now = self._now()
        return Line(self._robot, 0, now, now)

    def _now(self) -> int:
        """Return the time of the chosen robot's newest state, in [ns].

        Raises:
            InvalidValueError: If there is none.
        """
        state = self._robot.state()
        if state is None:
            raise InvalidValueError(
                f"No state of {self._robot.name} has been received yet."
            )
        return state.stamp

    def _dragged(self) -> None:
        """Show the time at the handle."""
        back = float(self._back.value)
        line = self._line
        is_newest = line is None or line.run in (0, self._run)
        if not back < 0.0 and is_newest and (line is None or line.end == line.last):
            self.live()
            return
        line = self._leave()
        self._show(line, line.end + round(SECOND * back), is_dragged=True)

    def step(self, way: str) -> None:
        """Show the previous (``-1``) or next (``+1``) state, or that a second away.

        Raises:
            InvalidValueError: If there is no state yet.
        """
        line = self._leave()
        at = line.last if self._state is None else self._state.stamp
        if way == "+1" and at < line.last:
            self._fetch(line, partial(_first_after, at=at, end=line.last))
        elif way != "+1":
            shift = {"-1": -1, "-1 s": -SECOND}.get(way, SECOND)
            self._show(line, min(at + shift, line.last))

    def _jump(self, line: Line, at: float) -> None:
        """Show a time of a time line, in [s]."""
        self._whose.value = line.robot.name
        self._line = line
        self._show(line, round(SECOND * at))

    def _choose_run(self) -> None:
        """Show the last state of a run."""
        run = int(self._runs.value)
        self._line = line = Line(self._robot, run, 0, 0)
        self._fetch(line, lambda history, run: history.part(run=run, max_states=2))

    def _show(self, line: Line, stamp: int, is_dragged: bool = False) -> None:
        """Show the last state that is not later than a time, or the first one."""
        self._fetch(line, partial(_at, stamp=stamp), is_dragged)

    def _fetch(
        self,
        line: Line,
        ask: Callable[[HistoryClient, int], HistoryPart],
        is_dragged: bool = False,
    ) -> None:
        """Ask for a state, and show it if it is still wanted then."""

        def fetch() -> None:
            try:
                history = _history(line.robot)
                part = ask(history, line.run)
                stamp = int(part.stretch.stamps[-1])
                span = max(stamp - AROUND, 1), stamp + AROUND
                commands = history.part(*span, part.stretch.run, max_states=1).commands
            except G1DescriptionError as error:
                self._ui.post(self, partial(self._fail, line, str(error)))
                return
            act = partial(self._arrived, line, part, commands, is_dragged)
            self._ui.post(self, act)

        self._newest.wait_for(fetch)

    def _fail(self, line: Line, problem: str) -> None:
        """Tell why a state cannot be shown."""
        if self._line is line:
            if self._state is None:
                self.live()
            self._tell(problem)

    def _arrived(
        self,
        line: Line,
        part: HistoryPart,
        commands: Sequence[CommandStream],
        is_dragged: bool,
    ) -> None:
        """Show a state, unless another time line is wanted by now."""
        if self._line is not line:
            return
        self._state = part.stretch.states()[-1]
        if not line.run or part.stretch.run > self._run:
            self._run = part.stretch.run
        line.run = part.stretch.run
        if not line.last:
            line.end = line.last = part.last
        runs = tuple(str(run) for run in range(part.first_run, self._run + 1))
        if tuple(self._runs.options) != runs:
            self._runs.options = runs
        self._runs.value = str(part.stretch.run)
        self._runs.visible = len(runs) > 1
        if not is_dragged:
            self._show_place()
        self._list.content = commands_text(commands)
        self._tell("")

    def _tell(self, problem: str) -> None:
        """Show a problem, or none."""
        self._problem.content = plain(problem)
        self._problem.visible = bool(problem)

    # --- what is done with it ---

    def _start(self) -> None:
        """Put the robot to the shown state, and show it live."""
        state, line = self._state, self._line
        if state is None or line is None:
            raise InvalidValueError("Go back to a past state first.")
        self._ui.wait_for(
            partial(self._place, line.robot, state), lambda _: self.live()
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

    def _whole(self, line: Line) -> HistoryPart:
        """Ask for all states of the time line."""
        begin = max(line.end - self._seconds * SECOND, 0)
        return _history(line.robot).whole(begin, line.end, line.run)

    def _check(self) -> None:
        """Check the time line."""
        line = self._line or self._newest_line()
        self._findings.begin(f"last {self._seconds} s")
        self._ui.wait_for(
            partial(self._guarded_whole, line), partial(self._begin_check, line)
        )

    def _guarded_whole(self, line: Line) -> HistoryPart:
        """Ask for all states of the time line; say where it is checked if it fails."""
        try:
            return self._whole(line)
        except G1DescriptionError:
            self._ui.post((self, "failed"), self._findings.fail)
            raise

    def _begin_check(self, line: Line, part: HistoryPart) -> None:
        """Check states, whose findings have simulated times."""
        stretch = part.stretch
        line.run = stretch.run
        motion = replace(stretch.motion(), times=1e-9 * stretch.stamps)
        span = 1e-9 * line.end - self._seconds, 1e-9 * line.end
        self._checks.check_motion(
            self,
            line.robot,
            motion,
            partial(self._show_verdict, line, span),
            self._findings.fail,
        )

    def _show_verdict(
        self, line: Line, span: tuple[float, float], verdict: Verdict
    ) -> None:
        """Show findings."""
        self._checked = line
        self._findings.show(verdict, span)

    def _save(self) -> None:
        """Save the time line as a motion."""
        name = self._name.value.strip()
        line = self._line or self._newest_line()

        def save() -> None:
            stretch = self._whole(line).stretch
            motion, begin = stretch.motion(), int(stretch.stamps[0])
            file = save_motion(name, motion, line.robot.description, begin)
            self._ui.tell(f"Saved {file}, {motion.duration:.2f} s.", "green")

        self._ui.wait_for(save)


def _history(robot: ShownRobot) -> HistoryClient:
    """Return the history of a robot that has one."""
    assert robot.history is not None
    return robot.history


def _at(history: HistoryClient, run: int, stamp: int) -> HistoryPart:
    """Ask for the last state that is not later than a time in [ns], or the first."""
    at = max(stamp, 1)  # zero would be the whole run
    try:
        return history.part(at, at, run)
    except G1DescriptionError:
        return history.part(run=run, max_states=1)


def _first_after(history: HistoryClient, run: int, at: int, end: int) -> HistoryPart:
    """Ask for the first state that is later than a time, in [ns]."""
    return history.part(at + 1, end, run, max_states=1)


def commands_text(commands: Sequence[CommandStream]) -> str:
    """Format commands in Markdown, with time, sender and content."""
    lines = ["**Commands within 1 s:**" + ("" if commands else " none"), ""]
    for one in commands[:MAX_LINES]:
        sender, topic, content = one.command
        again = f" x {one.count}" if one.count > 1 else ""
        text = f"{1e-9 * one.first:.3f} s{again}, {sender}, {topic}: {content}"
        lines.append(f"- {plain(text)}")
    if len(commands) > MAX_LINES:
        lines.append(f"- and {len(commands) - MAX_LINES} more")
    return "\n".join(lines)
