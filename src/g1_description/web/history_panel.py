"""The history of robots that run: rewound, checked, saved, and gone on from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Callable

from g1_description.checks.verdict import Verdict
from g1_description.errors import G1DescriptionError, InvalidValueError
from g1_description.motion.files.history_bag import read_history
from g1_description.motion.history import CommandStream, HistoryPart
from g1_description.motion.motion import Motion
from g1_description.robot.state import RobotState
from g1_description.web.findings_panel import FindingList, plain
from g1_description.web.first_cause import FirstCause, Past
from g1_description.web.motion_panel import MotionPanel
from g1_description.web.panel import Key, PageContext, Panel
from g1_description.web.robot import ShownRobot
from g1_description.web.saved_motions import check_file_name, folder, save_motion
from g1_description.web.timeline import SECOND, Timeline
from g1_description.web.ui_loop import Lane

if TYPE_CHECKING:
    from viser import GuiFolderHandle

    from g1_description.ros.history import HistoryClient

LENGTHS = ("5", "10", "30", "60", "300", "600")
"""Lengths of the time line to choose from, in [s]."""

STEP = 0.001
"""Step of the time line, in [s]."""

BEFORE, AFTER = 10 * SECOND, SECOND
"""Commands are listed from this time before the shown one to that after it: a motion
may still be played."""

MAX_LINES = 12
"""Largest number of listed commands."""


class HistoryPanel(Panel):
    """Shows the past of one robot, in all browsers; the robot is not commanded."""

    def __init__(self, page: PageContext, head: GuiFolderHandle) -> None:
        """Add the panel where the GUI is.

        Args:
            page: What it shares with others.
            head: Has the line that names the shown time.
        """
        self._head = head
        super().__init__(page)

    def build(self) -> None:
        """Add the elements."""
        gui, ui = self.gui, self.ui
        self._robots = {robot.name: robot for robot in self.world.robots}
        self._lane = Lane(ui)
        self.shown: Timeline | None = None
        """The time line that is shown, with its state; None: the present."""
        self._requested: Timeline | None = None
        """The one that is shown, or will be."""
        self._checked: Timeline | None = None
        """The one of the findings that are shown, or will be."""
        with self._head:
            self._when = gui.add_markdown("")
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
        check = gui.add_button("Check this range", hint="the time line")
        why = gui.add_button(
            "Why?",
            hint="the first cause of the last fall or large error of the time line",
        )
        self._name = gui.add_text(
            "File name",
            "history",
            hint="saved as CSV unless it ends in .npz, .bag or .mcap",
        )
        save = gui.add_button("Save this range", hint=f"into {folder()}")
        self._ended = self._add_ended()
        start = gui.add_button(
            "Start here",
            color="orange",
            hint="put the robot to the shown state, at rest; physics does not go on "
            "from there to the last bit",
        )
        self.found = gui.add_markdown("")
        """The findings at the shown time."""
        self._cause = FirstCause(gui, self.page, self._lane)
        self._list = gui.add_markdown("")
        self._findings = FindingList(gui, ui, self._jump, False)
        ui.on(self._whose, self.live)
        ui.on(self._runs, self._choose_run)
        ui.on(self._length, self._set_length)
        ui.on(self._back, self._dragged)
        ui.on(self._steps, lambda: self.step(self._steps.value))
        ui.on(live, self.live)
        ui.on(start, self._start)
        ui.on(check, self._check)
        ui.on(why, self._explain)
        ui.on(save, self._save)
        ui.on(self._ended, self._open_ended)

    def _add_ended(self) -> Any:
        """Add the choice of histories that bridges left at their ends."""
        kept = [path.name for path in sorted(folder().parent.glob("last*.bag"))]
        return self.gui.add_dropdown(
            "Ended bridge",
            ["", *kept],
            hint="opens the history that it left on the tab Motion, and says why the "
            "robot fell",
            visible=bool(kept),
        )

    def hotkeys(self) -> list[Key]:
        """List its keys; the arrows step through the open motion in the present."""
        motion = self.page.get(MotionPanel)

        def step(way: str) -> None:
            if self.shown is None:
                motion.step(way)
            else:
                self.step(way)

        return [
            Key("←", "one sample back", lambda: step("-1"), "arrowleft"),
            Key("→", "one sample on", lambda: step("+1"), "arrowright"),
            Key("L", "back from the past to live", self.live, "L"),
        ]

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
        self.shown = self._requested = None
        self._back.value = 0.0
        self._list.content = self.found.content = ""
        self.report("")

    def update(self) -> None:
        """Show which time is shown, in one line: nothing moves."""
        text, line = "**Live**", self.shown
        if line is not None:
            whose = f" of {plain(line.robot.name)}" if len(self._robots) > 1 else ""
            text = f"**Past{whose}:** {line.title(line.robot.state())}, *key L: live*"
        self._when.content = text

    @property
    def _robot(self) -> ShownRobot:
        """The chosen robot."""
        return self._robots[str(self._whose.value)]

    def _set_length(self) -> None:
        """Change the length of the time line; the shown time stays."""
        self._back.min = -1e-9 * self.length
        self._show_place()

    def _show_place(self) -> None:
        """Move the handle to the shown time."""
        if self.shown is not None:
            self._back.value = self.shown.back(self.length)

    # --- going back ---

    def _line(self) -> Timeline:
        """Return the time line that is shown or requested, else one that ends now.

        Raises:
            InvalidValueError: If there is no state yet.
        """
        if self._requested is not None:
            return self._requested
        state = self._robot.state()
        if state is None:
            raise InvalidValueError(
                f"No state of {self._robot.name} has been received yet."
            )
        return Timeline.until_now(self._robot, state.stamp)

    def _dragged(self) -> None:
        """Show the time at the handle."""
        back, line = float(self._back.value), self._requested
        back = min(max(back, -1e-9 * self.length), 0.0)
        if not back < 0.0 and (line is None or line.ends_live):
            self.live()
            return
        line = self._line()
        end = line.end or 0
        self._show(line, end + round(SECOND * back), is_dragged=True)

    def step(self, way: str) -> None:
        """Show the previous (``-1``) or next (``+1``) state, or that a second away.

        Raises:
            InvalidValueError: If there is no state yet.
        """
        if self._requested is None and way.startswith("+"):
            return  # there is nothing later
        line = self._line()
        if way == "+1":
            state, end = line.state, line.left_at
            if state is not None and end is not None and state.stamp < end:
                at = state.stamp
                self._fetch(line, lambda history, run: history.after(at, end, run))
            return
        shift = {"-1": -1, "-1 s": -SECOND}.get(way, SECOND)
        self._show(line, line.limited((line.requested or 0) + shift))

    def go_to(self, robot: ShownRobot, at: float) -> None:
        """Show a robot at a past time, in [s]; another one only if none is shown."""
        if self._requested is None:
            self._whose.value = robot.name
        line = self._line()
        self._show(line, line.limited(round(SECOND * at)))

    def _jump(self, at: float) -> None:
        """Show a time of the time line that was checked, in [s]."""
        line = self._checked
        if line is not None:
            self._whose.value = line.robot.name
            self._show(replace(line, state=None, before=None), round(SECOND * at))

    def _choose_run(self) -> None:
        """Show the last state of a run."""

        def last(history: HistoryClient, run: int) -> HistoryPart:
            return history.at(history.part(run=run, max_states=1).last, run)

        self._fetch(Timeline(self._robot, int(self._runs.value)), last)

    def _show(self, line: Timeline, stamp: int, is_dragged: bool = False) -> None:
        """Show the last state that is not later than a time, or the first one."""
        line.requested = stamp
        self._fetch(line, lambda history, run: history.at(stamp, run), is_dragged)

    def _fetch(
        self,
        line: Timeline,
        ask: Callable[[HistoryClient, int], HistoryPart],
        is_dragged: bool = False,
    ) -> None:
        """Request a state; a newer request replaces it."""
        self._requested, requested = line, line.requested

        def fetch() -> Callable[[], object]:
            try:
                history = _history(line.robot)
                part = ask(history, line.run or 0)
                stamp = int(part.stretch.stamps[-1])
                span = max(stamp - BEFORE, 1), stamp + AFTER
                run = part.stretch.run
                around = history.part(*span, run, max_states=1, with_commands=True)
            except G1DescriptionError as error:
                return partial(self._fail, line, str(error))
            commands = around.commands
            return partial(self._arrived, line, requested, part, commands, is_dragged)

        self.ui.calls.do(fetch, lambda show: show(), key=self)

    def _fail(self, line: Timeline, problem: str) -> None:
        """Report why a state cannot be shown; the shown one stays."""
        if self._requested is line:
            self._requested = self.shown
            self._show_place()
            if self.shown is None:
                self.live()
            self.report(problem)

    def _arrived(
        self,
        line: Timeline,
        requested: int | None,
        part: HistoryPart,
        commands: Sequence[CommandStream],
        is_dragged: bool,
    ) -> None:
        """Show a state; that of a time line that was left meanwhile is dropped."""
        if self._requested is not line:
            return
        line.take(part, requested)
        self.shown = line
        runs = tuple(str(run) for run in range(part.first_run, part.last_run + 1))
        self._runs.options = runs
        self._runs.value = str(line.run)
        self._runs.visible = len(runs) > 1
        if not is_dragged:
            self._show_place()
        self._list.content = commands_text(commands)
        is_before = requested is not None and requested < part.first
        begin = f"The history of run {line.run} begins at {1e-9 * part.first:.3f} s."
        self.report(begin if is_before else "")

    # --- what is done with it ---

    def _start(self) -> None:
        """Put the robot to the shown state, and show it live."""
        line = self.shown
        if line is None or line.state is None:
            raise InvalidValueError("Go back to a past state first.")
        self.ui.calls.do(
            partial(self._place, line.robot, line.state), lambda _: self.live()
        )

    def _place(self, robot: ShownRobot, state: RobotState) -> None:
        """Put a robot to a state, and end a motion of this page."""
        player, simulator = self.page.get(MotionPanel).player, self.world.simulator
        if player is not None and player.is_running:
            player.pause()
        positions = state.positions_by_name
        if simulator is not None and not simulator.is_kinematic:
            simulator.place(robot.name, state)
            self.ui.notify(
                "The robot begins there at rest; physics does not go on as it did to "
                "the last bit."
            )
        elif state.base_pose is None:
            robot.command(positions)
        else:
            robot.command_all(positions, state.base_pose)

    def _whole(self) -> tuple[Timeline, Callable[[], HistoryPart]]:
        """Return the time line as it is now, and a call that gets all of its states."""
        line, history = replace(self._line()), _history(self._line().robot)
        span = line.begin(self.length), line.end or 0, line.run or 0
        return line, lambda: history.whole(*span)

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
        """Check the time line; results of earlier checks are dropped."""
        line, ask = self._whole()
        self._checked = line
        begin, end = line.begin(self.length), line.end or 0
        self._findings.begin(f"{1e-9 * begin:.1f} s to {1e-9 * end:.1f} s")

        def fail() -> None:
            if self._checked is line:
                self._findings.fail()

        def motion() -> Motion:
            try:
                part = ask()
                line.run = part.stretch.run
                if part.note:
                    self.ui.notify(part.note)
                return _timed(part)
            except G1DescriptionError:
                self.ui.post((self, "failed"), fail)
                raise

        def check(found: Motion) -> None:
            def show(verdict: Verdict) -> None:
                if self._checked is line:
                    self._findings.show(verdict, (found.times[0], found.times[-1]))

            self.page.checks.check_motion(self, line.robot, found, show, fail)

        self._lane.do(motion, check)

    def _explain(self) -> None:
        """Explain the last failure of the time line, and show its first cause."""
        line, ask = self._whole()
        history, span = _history(line.robot), (line.begin(self.length), line.end or 0)

        def states() -> Past:
            found = ask().stretch
            line.run = found.run
            return found, history.commands(*span, found.run)

        def show(at: float) -> None:
            self._show(replace(line, state=None, before=None), round(SECOND * at))

        scene = self.page.scene_of(line.robot)
        self._cause.explain(line.robot, states, show, scene)

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
            self.ui.notify(text.strip(), "green")

        self._lane.do(save)

    def _open_ended(self) -> None:
        """Open the history that a bridge left at its end."""
        name, robot = str(self._ended.value), self._robot
        if name:
            file, motion = folder().parent / name, self.page.get(MotionPanel)
            read = partial(self.world.read, file, robot, None)
            self._lane.do(read, partial(motion.open, name, robot))
            self._cause.explain(robot, partial(read_history, file, robot.description))


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
