"""The page of a world of robots: its panels, and the loop that draws it."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from g1_description.checks.verdict import Verdict
from g1_description.collisions.self_collisions import SelfCollisions
from g1_description.errors import InvalidValueError
from g1_description.ik.posing import roles_of
from g1_description.motion.motion import Motion, configuration
from g1_description.render.page import motion_page
from g1_description.robot.state import RobotState
from g1_description.web.check_thread import CheckThread, MakeChecker
from g1_description.web.controls import BasePanel, JointPanel, PosePanel
from g1_description.web.findings_panel import plain
from g1_description.web.history_panel import HistoryPanel, Timeline
from g1_description.web.keyframes_panel import KeyframesPanel
from g1_description.web.keys import add_keys, keys_of
from g1_description.web.library import Library
from g1_description.web.library_panel import LibraryPanel
from g1_description.web.motion_panel import MotionPanel
from g1_description.web.plots import PlotPanel
from g1_description.web.reach_panel import ReachPanel
from g1_description.web.robot import ShownRobot, ShownWorld
from g1_description.web.scene.stage import Stage
from g1_description.web.scene.tree import free_name
from g1_description.web.shown import Shown
from g1_description.web.simulator_panel import SimulatorPanel
from g1_description.web.ui_loop import UiLoop
from g1_description.web.view_panel import ViewPanel

if TYPE_CHECKING:
    from viser import ClientHandle, GuiTabGroupHandle, ViserServer


RATE = 40.0
"""Largest frame rate, in [Hz]."""

IDLE = 0.25
"""Longest wait for changes, in [s]: panels show running times."""

WATCH_PERIOD = 0.1
"""Period of checks whether the page is open, in [s]."""

MAX_LINES = 8
"""Largest number of listed findings of the current state."""


class Page:
    """Shows and controls a world."""

    def __init__(
        self,
        server: ViserServer,
        world: ShownWorld,
        make_checker: MakeChecker,
        read_only: bool = False,
        library: Library | None = None,
        motion_first: bool = False,
    ) -> None:
        """Build the page.

        Args:
            server: Where to.
            world: The robots.
            make_checker: Creates the checker of a robot.
            read_only: Whether the page has no controls.
            library: Motions to look through; None: none.
            motion_first: Whether the tab of the motion is the first, which is open.
        """
        self._server, self._world = server, world
        self.ui = UiLoop(server, world.changed)
        self._make_checker = make_checker
        self._checks = CheckThread(self.ui, make_checker, self._seen)
        self._stage = Stage(server)
        names: set[str] = set()
        self._shown = [
            Shown(server, robot, free_name(robot.name, names)) for robot in world.robots
        ]
        for row, shown in enumerate(self._shown if len(self._shown) > 1 else ()):
            shown.body.tag(shown.robot.name, row)
        self._stopped = threading.Event()
        self.watched: Callable[[], int] = lambda: len(server.get_clients())
        """Number of viewers."""
        self._read_only = read_only
        self._library = library
        self._found: dict[ShownRobot, Verdict] = {}
        self._add_panels(motion_first)
        server.on_client_connect(self._label)

    def _add_panels(self, motion_first: bool) -> None:
        """Add all panels."""
        gui = self._server.gui
        gui.set_panel_label(self._world.robots[0].description.name)
        gui.configure_theme(
            control_width="large", show_logo=False, show_share_button=False
        )
        self._lack = gui.add_markdown("", visible=False)
        past = gui.add_markdown("", visible=self._can_rewind)
        self._simulator = None
        if self._world.simulator is not None:
            robot, simulator = self._world.robots[0].name, self._world.simulator
            self._simulator = SimulatorPanel(
                gui, self.ui, simulator, robot, self._read_only
            )
        library, folder = None, None
        if self._library is not None:
            library = LibraryPanel(gui, self.ui, self._world, self._library)
        tabs = gui.add_tab_group()
        if library is not None:
            folder = tabs.add_tab("Folder")
        if motion_first:
            self._add_motion(tabs)
        if not self._read_only and self._world.can_move:
            for shown in self._shown:
                title = shown.robot.name if len(self._shown) > 1 else "Robot"
                with tabs.add_tab(title):
                    self._add_controls(shown)
        if not motion_first:
            self._add_motion(tabs)
        self._history: HistoryPanel | None = None
        if self._can_rewind:
            with tabs.add_tab("History"):
                self._history = HistoryPanel(
                    gui, self.ui, self._world, self._checks, self.motion, past
                )
        self._view: ViewPanel | None = None
        self._plots: PlotPanel | None = None
        if library is not None and folder is not None:
            with folder:
                library.add_list(self.motion)
        if not self._read_only:
            self._add_looks(tabs, library)

    def _label(self, client: ClientHandle) -> None:
        """Say in upright windows that the panel, which covers half of them, folds."""
        if client.camera.image_width < client.camera.image_height:
            name = self._world.robots[0].description.name
            client.gui.set_panel_label(f"{name}: tap to fold or open")

    @property
    def _can_rewind(self) -> bool:
        """Whether the past of robots is kept, and may be shown."""
        has_history = any(robot.history is not None for robot in self._world.robots)
        return has_history and self._world.can_move and not self._read_only

    def _add_motion(self, tabs: GuiTabGroupHandle) -> None:
        """Add the tab of the motion, and of what is found."""
        gui = self._server.gui
        with tabs.add_tab("Motion" if self._world.can_move else "Checks"):
            self.motion = MotionPanel(
                gui, self.ui, self._world, self._checks, self._read_only
            )
            self._now = gui.add_markdown("")
        self.motion.opened = self._on_opened

    def _add_looks(self, tabs: GuiTabGroupHandle, library: LibraryPanel | None) -> None:
        """Add the tabs View and Plots."""
        gui, world = self._server.gui, self._world
        for shown in self._shown:
            self._name_on_click(shown)
        with tabs.add_tab("View"):
            bodies = [shown.body for shown in self._shown]
            self._view = ViewPanel(
                gui, self.ui, self._stage, bodies, world.has_commanded, self._one_file
            )
            if world.can_arrange:
                self._add_arrangement()
            first, history = self._shown[0], self._history
            keys = keys_of(self.motion, self._view, first, history, library)
            add_keys(gui, self.ui, keys)
        with tabs.add_tab("Plots"):
            robots = [shown.robot for shown in self._shown]
            self._plots = PlotPanel(gui, self.ui, robots, self.motion, history)

    def _one_file(self) -> str:
        """Write a page: of the past that is shown, the open motion, or the present.

        It may block.

        Raises:
            G1DescriptionError: If nothing is known of the robot.
        """
        past = None if self._history is None else self._history.past_motion()
        if past is not None:
            return motion_page(past[0].description, past[1], self._verdict(*past))
        robot = self._shown[0].robot
        motion, verdict = self.motion.motions.get(robot), None
        if motion is None:
            state = robot.state()
            if state is None:
                raise InvalidValueError(
                    "There is nothing to share: no state has been received yet."
                )
            motion = configuration(state.positions_by_name, state.base_pose)
        else:
            verdict = self.motion.verdicts.get(robot)
        return motion_page(robot.description, motion, verdict)

    def _verdict(self, robot: ShownRobot, motion: Motion) -> Verdict | None:
        """Wait for the check of a motion; None if it fails."""
        answers: queue.Queue[Verdict | None] = queue.Queue()
        fail = partial(answers.put, None)
        self._checks.check_motion(answers, robot, motion, answers.put, fail)
        return answers.get()

    def _add_arrangement(self) -> None:
        """Add the switch between robots next to each other and overlaid."""
        box = self._server.gui.add_checkbox(
            "Overlay", False, hint="draw all robots at the same place"
        )
        others = self._shown[1:]

        def arrange() -> None:
            self._world.arrange(beside=not box.value)
            for shown in others:
                shown.body.fade(bool(box.value))

        self.ui.on(box, arrange)

    def _add_controls(self, shown: Shown) -> None:
        """Add the controls of a robot."""
        server, robot = self._server, shown.robot
        shown.joints = JointPanel(server.gui, self.ui, robot)
        shown.base = BasePanel(server, self.ui, robot)
        if roles_of(robot.description):
            shown.reach = ReachPanel(
                server,
                self.ui,
                robot,
                shown.joints,
                shown.body,
                self._stage,
                partial(self._collisions, robot),
            )
            shown.keyframes = KeyframesPanel(
                server.gui, self.ui, robot, shown.reach.posing, lambda: self.motion
            )
        poses = PosePanel(server.gui, self.ui, self._world, robot, shown.joints)
        if shown.keyframes is not None:
            shown.keyframes.saved = poses.refresh

    def _collisions(self, robot: ShownRobot) -> SelfCollisions:
        """Prepare the self-collisions of a robot."""
        return self._make_checker(robot.description).collisions

    def _name_on_click(self, shown: Shown) -> None:
        """Show the name of a link on a click."""
        body, post = shown.body, self.ui.post
        body.on_click(lambda link: post("name", lambda: body.name(link)))

    def _on_opened(self) -> None:
        """Plot another motion."""
        if self._plots is not None:
            self._plots.refresh()

    # --- drawing ---

    def run(self) -> None:
        """Draw changes until ``stop`` is called."""
        threading.Thread(target=self._watch, daemon=True).start()
        while not self._stopped.is_set():
            self._world.changed.wait(IDLE)
            began = time.monotonic()
            self._world.changed.clear()
            with self._server.atomic():  # each message alone would wake viser
                self.ui.do_all()
                if self.watched():
                    self.ui.guarded(self._draw)
            self._server.flush()  # else viser lets messages gather
            spent = time.monotonic() - began
            self._stopped.wait(max(0.0, 1.0 / RATE - spent))

    def _watch(self) -> None:
        """Notify the world when the page is opened or closed; this may block."""
        is_watched = False
        while not self._stopped.wait(WATCH_PERIOD):
            if bool(self.watched()) != is_watched:
                is_watched = not is_watched
                self.ui.guarded(partial(self._world.watch, is_watched))

    def stop(self) -> None:
        """End ``run``."""
        self._stopped.set()
        self._world.changed.set()

    def _draw(self) -> None:
        """Show the states of all robots."""
        self._world.tick()
        if self._simulator is not None:
            self._simulator.follow()
        self.motion.follow()
        if self._history is not None:
            self._history.follow()
        seen: dict[ShownRobot, RobotState] = {}
        for shown in self._shown:
            self.ui.guarded(partial(self._show, shown, seen))
        self._tell_lack(seen)
        self._tell_found()
        self._follow(seen)
        if self._plots is not None:
            self._plots.follow()

    def _follow(self, states: Mapping[ShownRobot, RobotState]) -> None:
        """Keep the first robot in the centre, if switched on."""
        if self._view is None or not self._view.follow.value:
            self._stage.follow(np.zeros(2))
            return
        if any(shown.has_gizmo for shown in self._shown):
            return  # which would run away from the mouse
        state = states.get(self._shown[0].robot)
        if state is not None and state.base_pose is not None:
            self._stage.follow(state.base_pose[:2])

    def _tell_lack(self, states: Mapping[ShownRobot, RobotState]) -> None:
        """Show which states are missing."""
        lacks = []
        for shown in self._shown:
            robot = shown.robot
            if robot not in states:
                lacks.append(
                    f"{plain(robot.name)}: no joint states have been received yet."
                )
            elif states[robot].base_pose is None:
                lacks.append(f"{plain(robot.name)}: the pose of its base is unknown.")
        text = "  \n".join(lacks)
        if self._lack.content != text:
            self._lack.content = text
            self._lack.visible = bool(text)

    def _show(
        self,
        shown: Shown,
        seen: dict[ShownRobot, RobotState],
    ) -> None:
        """Show a robot, and add the shown state to those of all."""
        now, past = shown.robot.state(), self._past(shown.robot)
        if now is None:
            return
        view = self._view
        state = now if past is None or past.state is None else past.state
        seen[shown.robot] = state
        shown.show(state, now)
        shown.show_commanded(view is not None and bool(view.ghost.value))
        if past is None:
            shown.trail(view is not None and bool(view.trails.value))
        if view is None or view.checks.value:
            if shown.must_be_checked():
                before = None if past is None else past.before
                self._checks.check_state(shown.robot, state, bool(past), before)
        elif shown.is_checked:
            shown.unmark()
            self._found.clear()

    def _past(self, robot: ShownRobot) -> Timeline | None:
        """Return the time line of a robot whose past is shown."""
        return None if self._history is None else self._history.past(robot)

    def _seen(self, robot: ShownRobot, state: RobotState, verdict: Verdict) -> None:
        """Show the findings of a robot's current state."""
        shown = next(s for s in self._shown if s.robot is robot)
        if not shown.is_checked:  # switched off meanwhile
            return
        shown.mark(state, verdict)
        self._found[robot] = verdict

    def _tell_found(self) -> None:
        """List the findings of all current states."""
        lines = []
        for robot, verdict in self._found.items():
            whose = f" {plain(robot.name)}" if len(self._shown) > 1 else ""
            found = [f"- {plain(f.text)}" for f in verdict.findings[:MAX_LINES]]
            more = len(verdict.findings) - MAX_LINES
            found += [f"- and {more} more"] if more > 0 else []
            when = "at this time" if self._past(robot) else "now"
            title = f"**Configuration{whose} {when}:**"
            lines += [title + ("" if found else " nothing found.")]
            lines += ["", *found, ""] if found else [""]
        text = "\n".join(lines)
        told = [self._now]
        if self._history is not None and self._history.shown is not None:
            told.append(self._history.found)
        for element in told:
            if element.content != text:
                element.content = text
