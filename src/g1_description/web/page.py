"""The page of a world of robots: its server, its panels, and the loop that draws it."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from g1_description.checks.verdict import Verdict
from g1_description.errors import InvalidValueError
from g1_description.motion.motion import Motion, configuration
from g1_description.render.page import motion_page
from g1_description.robot.state import RobotState
from g1_description.web.check_thread import CheckThread, MakeChecker
from g1_description.web.controls import BasePanel, JointPanel, PosePanel
from g1_description.web.findings_panel import plain
from g1_description.web.history_panel import HistoryPanel
from g1_description.web.keyframes_panel import KeyframesPanel
from g1_description.web.library import Library
from g1_description.web.library_panel import LibraryPanel
from g1_description.web.motion_panel import MotionPanel
from g1_description.web.panel import Key, PageContext, RobotPanel
from g1_description.web.plots import PlotPanel
from g1_description.web.reach_panel import ReachPanel
from g1_description.web.robot import ShownRobot, ShownWorld
from g1_description.web.scene.objects import SceneObjects
from g1_description.web.scene.robot import SceneRobot
from g1_description.web.scene.stage import MAP, Stage
from g1_description.web.scene.tree import free_name
from g1_description.web.scene_panel import ScenePanel
from g1_description.web.server.address import ServerOptions
from g1_description.web.server.page_server import PageServer
from g1_description.web.shown import Shown
from g1_description.web.simulator_panel import SimulatorPanel, SimulatorStatus
from g1_description.web.timeline import Timeline
from g1_description.web.ui_loop import UiLoop
from g1_description.web.view_panel import ViewPanel

if TYPE_CHECKING:
    from viser import ClientHandle


RATE = 40.0
"""Largest frame rate, in [Hz]."""

IDLE = 0.25
"""Longest wait for changes, in [s]: panels show running times."""

WATCH_PERIOD = 0.1
"""Period of checks whether the page is open, in [s]."""

MAX_LINES = 8
"""Largest number of listed findings of the current state."""

ROBOT_PANELS: tuple[type[RobotPanel], ...] = (
    ReachPanel,
    KeyframesPanel,
    PosePanel,
    BasePanel,
    JointPanel,
)
"""The tab of a robot that can be moved, from top to bottom."""


class Page:
    """Shows and controls a world."""

    def __init__(
        self,
        world: ShownWorld,
        options: ServerOptions,
        make_checker: MakeChecker,
        library: Library | None = None,
        motion_first: bool = False,
    ) -> None:
        """Open the page.

        Args:
            world: The robots.
            options: Who may come in, and where.
            make_checker: Creates the checker of a robot.
            library: Motions to look through; None: none.
            motion_first: Whether the tab of the motion is the first, which is open.

        Raises:
            PageServerError: If the page cannot be opened.
        """
        self._gateway = PageServer(options)
        self.address = self._gateway.address
        """Its URL."""
        self._server, self._world = self._gateway.viser, world
        server = self._server
        self.ui = UiLoop(server, world.changed)
        self._checks = CheckThread(self.ui, make_checker, self._seen)
        self._stage = Stage(server)
        names: set[str] = set()
        self._shown = [
            Shown(server, robot, free_name(robot.name, names)) for robot in world.robots
        ]
        for row, shown in enumerate(self._shown if len(self._shown) > 1 else ()):
            shown.body.tag(shown.robot.name, row)
        self._objects = [
            SceneObjects(server.scene, f"{MAP}/objects/{number}")
            for number, _ in enumerate(world.scenes)
        ]
        self._stopped = threading.Event()
        self._page = PageContext(
            server,
            self.ui,
            world,
            self._stage,
            self._checks,
            make_checker,
            options.read_only,
        )
        self._found: dict[ShownRobot, Verdict] = {}
        self._add_panels(library, motion_first)
        server.on_client_connect(self._label)

    def _add_panels(self, library: Library | None, motion_first: bool) -> None:
        """Add all panels."""
        gui, page, world = self._server.gui, self._page, self._world
        gui.set_panel_label(world.robots[0].description.name)
        gui.configure_theme(
            control_width="large", show_logo=False, show_share_button=False
        )
        self._lack = gui.add_markdown("", visible=False)
        if world.simulator is not None:
            SimulatorStatus(page)
            if not page.read_only:
                SimulatorPanel(page)
        head, tabs = gui.add_folder(None), gui.add_tab_group()
        folder = tabs.add_tab("Folder") if library is not None else None
        motion = tabs.add_tab("Motion") if motion_first else None
        controls = []
        if not page.read_only and world.can_move:
            several = len(self._shown) > 1
            controls = [
                (shown, tabs.add_tab(shown.robot.name if several else "Robot"))
                for shown in self._shown
            ]
        if motion is None:
            motion = tabs.add_tab("Motion" if world.can_move else "Checks")
        # Of two panels with the same key, the first one has it.
        self._history: HistoryPanel | None = None
        has_past = any(robot.history is not None for robot in world.robots)
        if has_past and world.can_move and not page.read_only:
            with tabs.add_tab("History"):
                self._history = HistoryPanel(page, head)
        with motion:
            self.motion = MotionPanel(page)
            self._now = gui.add_markdown("")
        if library is not None and folder is not None:
            with folder:
                LibraryPanel(page, library, head)
        for shown, tab in controls:
            with tab:
                for kind in ROBOT_PANELS:
                    if kind.fits(shown):
                        kind(page, shown)
        if controls and world.scenes:
            with tabs.add_tab("Scene"):
                around = ScenePanel(page)
            self._objects[0].on_click(
                lambda name: self.ui.post("select", partial(around.select, name))
            )
        self._view: ViewPanel | None = None
        if not page.read_only:
            bodies = [shown.body for shown in self._shown]
            for body in bodies:
                body.on_click(partial(self._name, body))
            with tabs.add_tab("View"):
                self._view = ViewPanel(page, bodies, self._objects, self._one_file)
                self._add_keys()
            with tabs.add_tab("Plots"):
                PlotPanel(page)

    def _name(self, body: SceneRobot, link: str) -> None:
        """Show the name of a link that was clicked."""
        self.ui.post("name", partial(body.name, link))

    def _add_keys(self) -> None:
        """Let the keys of all panels act, and list them."""
        keys: dict[tuple[str, str | None], Key] = {}
        for key in (key for panel in self._page.panels for key in panel.hotkeys()):
            keys.setdefault((key.hotkey, key.modifier), key)
        gui = self._server.gui
        for key in keys.values():
            command = gui.add_command(
                key.effect.capitalize(), hotkey=key.hotkey, modifier=key.modifier
            )
            command.on_trigger(lambda _, key=key: self.ui.post(key, key.act))
        lines = "\n".join(f"| {key.shown} | {key.effect} |" for key in keys.values())
        with gui.add_folder("Keys", expand_by_default=False):
            gui.add_markdown(f"| key | effect |\n| --- | --- |\n{lines}")

    def _label(self, client: ClientHandle) -> None:
        """Say in upright windows that the panel, which covers half of them, folds."""
        if client.camera.image_width < client.camera.image_height:
            name = self._world.robots[0].description.name
            client.gui.set_panel_label(f"{name}: tap to fold or open")

    def _one_file(self) -> str:
        """Write a page: of the past that is shown, the open motion, or the present.

        It may block.

        Raises:
            G1DescriptionError: If nothing is known of the robot.
        """
        scene = self._page.scene_of(self._shown[0].robot)
        past = None if self._history is None else self._history.past_motion()
        if past is not None:
            verdict = self._verdict(*past)
            return motion_page(past[0].description, past[1], verdict, scene=scene)
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
        return motion_page(robot.description, motion, verdict, scene=scene)

    def _verdict(self, robot: ShownRobot, motion: Motion) -> Verdict | None:
        """Wait for the check of a motion; None if it fails."""
        answers: queue.Queue[Verdict | None] = queue.Queue()
        fail = partial(answers.put, None)
        self._checks.check_motion(answers, robot, motion, answers.put, fail)
        found = answers.get()
        self._checks.forces.pop((answers, robot), None)
        return found

    # --- drawing ---

    def run(self) -> None:
        """Draw changes until ``stop`` is called, and close the page."""
        threading.Thread(target=self._watch, daemon=True).start()
        try:
            while not self._stopped.is_set():
                self._world.changed.wait(IDLE)
                began = time.monotonic()
                self._world.changed.clear()
                with self._server.atomic():  # each message alone would wake viser
                    self.ui.do_all()
                    if self._gateway.browsers:
                        self.ui.guarded(self._draw)
                self._server.flush()  # else viser lets messages gather
                spent = time.monotonic() - began
                self._stopped.wait(max(0.0, 1.0 / RATE - spent))
        finally:
            self._gateway.close()

    def _watch(self) -> None:
        """Notify the world when the page is opened or closed; this may block."""
        is_watched = False
        while not self._stopped.wait(WATCH_PERIOD):
            if bool(self._gateway.browsers) != is_watched:
                is_watched = not is_watched
                self.ui.guarded(partial(self._world.watch, is_watched))
                if not is_watched:
                    self.ui.post("leave", self._leave)

    def _leave(self) -> None:
        """Let panels hide what nobody needs once the last browser is closed."""
        if self._gateway.browsers:  # another has come since
            return
        for panel in self._page.panels:
            self.ui.guarded(panel.leave)

    def stop(self) -> None:
        """End ``run``; from any thread, and from a signal."""
        self._stopped.set()
        self._world.changed.set()

    def _draw(self) -> None:
        """Show the states of all robots."""
        self._world.tick()
        seen: dict[ShownRobot, RobotState] = {}
        for shown in self._shown:
            self.ui.guarded(partial(self._show, shown, seen))
        self.ui.guarded(self._show_objects)
        self._show_lack(seen)
        self._show_found()
        self._follow(seen)
        for panel in self._page.panels:
            self.ui.guarded(panel.follow)

    def _show_objects(self) -> None:
        """Show the objects around the robots."""
        for objects, scene in zip(self._objects, self._world.scenes):
            objects.place(scene.offset)
            objects.show(*scene.shown())

    def _follow(self, states: Mapping[ShownRobot, RobotState]) -> None:
        """Keep the first robot in the centre, if switched on."""
        if self._view is None or not self._view.follows.value:
            self._stage.follow(np.zeros(2))
            return
        if any(panel.has_gizmo for panel in self._page.panels):
            return  # which would run away from the mouse
        state = states.get(self._shown[0].robot)
        if state is not None and state.base_pose is not None:
            self._stage.follow(state.base_pose[:2])

    def _show_lack(self, states: Mapping[ShownRobot, RobotState]) -> None:
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
        self._lack.content = "  \n".join(lacks)
        self._lack.visible = bool(lacks)

    def _show(
        self,
        shown: Shown,
        seen: dict[ShownRobot, RobotState],
    ) -> None:
        """Show a robot, and add the shown state to those of all."""
        now, past = shown.robot.state(), self._past(shown.robot)
        shown.newest = now
        if now is None:
            return
        view = self._view
        state = now if past is None or past.state is None else past.state
        seen[shown.robot] = state
        shown.show(state)
        shown.show_commanded(view is not None and bool(view.ghost.value))
        if past is None:
            shown.trail(view is not None and bool(view.trails.value))
        self._show_forces(shown, past)
        if view is None or view.checks.value:
            if shown.must_be_checked():
                before = None if past is None else past.before
                self._checks.check_state(shown.robot, state, bool(past), before)
        elif shown.is_checked:
            shown.unmark()
            self._found.clear()

    def _show_forces(self, shown: Shown, past: Timeline | None) -> None:
        """Show the contact forces of the open motion, or of the past, once checked."""
        forces, player = None, self.motion.player
        owner: tuple[object, ShownRobot] = self.motion, shown.robot
        time = 0.0 if player is None else player.time
        if past is not None and past.state is not None:
            owner, time = (self._history, shown.robot), past.state.time
        if self._view is not None and self._view.forces.value:
            forces = self._checks.forces.get(owner)
        shown.show_forces(forces, time)

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

    def _show_found(self) -> None:
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
        self._now.content = text
        if self._history is not None and self._history.shown is not None:
            self._history.found.content = text


def report_address(
    page: Page, options: ServerOptions, report: Callable[[str], object]
) -> None:
    """Report the address, and the effect of a token in it."""
    report(f"open {page.address}")
    if "token=" in page.address:
        may = "sees" if options.read_only else "moves"
        report(f"Anyone with this address {may} the robot.")
