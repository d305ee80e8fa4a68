"""The page of a world of robots: what is drawn, and the thread that draws it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from g1_description.core.checks.verdict import Verdict
from g1_description.sim.checks.timeline import Judged
from g1_description.sim.marks.robot_marks import RobotMarks
from g1_description.web.robots.robot import RobotState, ShownRobot, ShownWorld
from g1_description.web.scene.marks import SceneMarks
from g1_description.web.scene.robot import SEE_THROUGH, SceneRobot
from g1_description.web.scene.stage import Stage
from g1_description.web.scene.trails import Trails

from .base import BasePanel
from .desk import Desk
from .joints import JointPanel
from .judges import Judges, MakeChecker
from .motion import MotionPanel
from .plots import PlotPanel
from .poses import PosePanel
from .simulator import SimulatorPanel
from .view import ViewPanel

if TYPE_CHECKING:
    from viser import ViserServer

RATE = 30.0
"""Pictures in a second at most, in [Hz]."""

IDLE = 0.25
"""Longest wait for something new, in [s]: panels show times that go on."""

LIMIT_MARGIN = 0.05
"""Joints this near to a limit are marked, in [rad] or [m]."""

GHOST = (0.95, 0.6, 0.1, SEE_THROUGH)
"""Colour of where a robot is wanted."""

FLOOR = 0.0
"""Height of the floor in the map, in [m]."""


class _Shown:
    """All that is drawn of one robot."""

    def __init__(self, server: ViserServer, robot: ShownRobot) -> None:
        scene, name = server.scene, robot.name.replace("/", "_")
        self.robot = robot
        self.body = SceneRobot(scene, f"/robots/{name}", robot.description)
        self.ghost: SceneRobot | None = None
        self.ghost_path = f"/commanded/{name}"
        self.trails = Trails(scene, f"/trails/{name}", robot.description)
        self.canvas = SceneMarks(scene, f"/checks/{name}")
        self.marks = RobotMarks(robot.description, FLOOR, LIMIT_MARGIN)
        self.joints: JointPanel | None = None
        self.base: BasePanel | None = None
        self.judged: RobotState | None = None


class Page:
    """Shows a world, and does what people want of it."""

    def __init__(
        self,
        server: ViserServer,
        world: ShownWorld,
        make_checker: MakeChecker,
        read_only: bool = False,
    ) -> None:
        """Build the page.

        Args:
            server: Where to.
            world: The robots.
            make_checker: Prepares the checks of a robot.
            read_only: Whether people can only look.
        """
        self._server, self._world = server, world
        self.desk = Desk(server, world.changed)
        self._judges = Judges(self.desk, make_checker, self._seen)
        self._stage = Stage(server)
        self._shown = [_Shown(server, robot) for robot in world.robots]
        self._stopped = threading.Event()
        self.watched: Callable[[], int] = lambda: len(server.get_clients())
        """How many look."""
        self._read_only = read_only
        self._add_panels()

    def _add_panels(self) -> None:
        """Add all panels."""
        gui = self._server.gui
        gui.set_panel_label(self._world.robots[0].description.name)
        gui.configure_theme(
            control_width="large", show_logo=False, show_share_button=False
        )
        self._simulator = None
        if self._world.simulator is not None:
            self._simulator = SimulatorPanel(
                gui, self.desk, self._world.simulator, self._read_only
            )
        tabs = gui.add_tab_group()
        if not self._read_only and self._world.can_move:
            for shown in self._shown:
                title = shown.robot.name if len(self._shown) > 1 else "Robot"
                with tabs.add_tab(title):
                    self._add_hands(shown)
        with tabs.add_tab("Motion" if self._world.can_move else "Checks"):
            self.motion = MotionPanel(
                gui, self.desk, self._world, self._judges, self._read_only
            )
            self._now = gui.add_markdown("")
        self._view: ViewPanel | None = None
        self._plots: PlotPanel | None = None
        self.motion.opened = self._on_opened
        if not self._read_only:
            with tabs.add_tab("View"):
                bodies = [shown.body for shown in self._shown]
                self._view = ViewPanel(gui, self.desk, self._stage, bodies)
                if self._world.can_arrange:
                    self._add_arrangement()
            with tabs.add_tab("Plots"):
                robots = [shown.robot for shown in self._shown]
                self._plots = PlotPanel(gui, self.desk, robots)

    def _add_arrangement(self) -> None:
        """Let people choose how robots that are compared are shown."""
        box = self._server.gui.add_checkbox(
            "Over each other", False, hint="instead of beside each other"
        )
        others = self._shown[1:]

        def arrange() -> None:
            self._world.arrange(beside=not box.value)
            for shown in others:
                shown.body.fade(bool(box.value))

        self.desk.on(box, arrange)

    def _add_hands(self, shown: _Shown) -> None:
        """Add what moves a robot."""
        server, robot = self._server, shown.robot
        shown.joints = JointPanel(server.gui, self.desk, robot)
        shown.base = BasePanel(server, self.desk, robot)
        PosePanel(server.gui, self.desk, self._world, robot, shown.joints)

    def _on_opened(self) -> None:
        """Plot another motion."""
        if self._plots is not None:
            self._plots.forget()
            self._plots.motions = self.motion.motions

    # --- drawing ---

    def run(self) -> None:
        """Draw what is new until ``stop`` is called."""
        is_watched = False
        while not self._stopped.is_set():
            self._world.changed.wait(IDLE)
            began = time.monotonic()
            self._world.changed.clear()
            self.desk.do_all()
            if bool(self.watched()) != is_watched:
                is_watched = not is_watched
                self._world.watch(is_watched)
            if is_watched:
                self.desk.guarded(self._draw)
            spent = time.monotonic() - began
            self._stopped.wait(max(0.0, 1.0 / RATE - spent))

    def stop(self) -> None:
        """End ``run``."""
        self._stopped.set()
        self._world.changed.set()

    def _draw(self) -> None:
        """Show where all robots are."""
        self._world.tick()
        if self._simulator is not None:
            self._simulator.follow()
        self.motion.follow()
        states = {}
        with self._server.atomic():
            for shown in self._shown:
                state = shown.robot.state()
                if state is not None:
                    wanted = self._show(shown, state)
                    states[shown.robot] = state, wanted
        if self._plots is not None:
            self._plots.add(states, self.motion.player)

    def _show(self, shown: _Shown, state: RobotState) -> RobotState | None:
        """Show where a robot is; return where it is wanted, if that is known."""
        shown.body.show(state.base, state.positions)
        wanted = shown.robot.wanted()
        if shown.joints is not None:
            shown.joints.follow(state)
        if shown.base is not None:
            shown.base.follow(state)
        view = self._view
        self._show_ghost(shown, wanted, view is not None and bool(view.ghost.value))
        if view is not None and view.trails.value:
            shown.trails.add(state.time, state.base, state.positions)
        else:
            shown.trails.clear()
        self._judge(shown, state, view is None or bool(view.checks.value))
        return wanted

    def _show_ghost(
        self, shown: _Shown, wanted: RobotState | None, is_on: bool
    ) -> None:
        """Show where a robot is wanted."""
        if is_on and wanted is not None:
            if shown.ghost is None:
                shown.ghost = SceneRobot(
                    self._server.scene,
                    shown.ghost_path,
                    shown.robot.description,
                    GHOST,
                )
            shown.ghost.show(wanted.base, wanted.positions)
        if shown.ghost is not None:
            is_seen = is_on and wanted is not None
            if shown.ghost.visible != is_seen:
                shown.ghost.visible = is_seen

    # --- checks ---

    def _judge(self, shown: _Shown, state: RobotState, is_on: bool) -> None:
        """Have a robot judged where it is, if it has moved."""
        last = shown.judged
        if not is_on:
            if last is not None:
                shown.judged = None
                self._clear(shown)
        elif last is None or not _same(last, state):
            shown.judged = state
            self._judges.judge_state(shown.robot, state)

    def _clear(self, shown: _Shown) -> None:
        """Show no marks."""
        shown.body.redden(())
        shown.canvas.show()
        self._now.content = ""

    def _seen(
        self, robot: ShownRobot, state: RobotState, judged: Judged, verdict: Verdict
    ) -> None:
        """Show what was found of a robot where it is."""
        shown = next(s for s in self._shown if s.robot is robot)
        if shown.judged is None:  # switched off meanwhile
            return
        shown.body.redden(
            {
                link
                for finding in verdict.findings
                if finding.check == "self_collision"
                for link in finding.subject
            }
        )
        if state.base is not None:
            shown.marks.draw(shown.canvas, judged.timeline, verdict, state.base)
        shown.canvas.show()
        lines = [f"- {finding.text}" for finding in verdict.findings[:8]]
        text = "\n".join(["**Now:**", *lines]) if lines else "**Now:** nothing found."
        if self._now.content != text:
            self._now.content = text


def _same(a: RobotState, b: RobotState) -> bool:
    """Tell whether two states are of one place."""
    same_base = (a.base is None) == (b.base is None) and (
        a.base is None or b.base is None or (a.base == b.base).all()
    )
    return bool(same_base and dict(a.positions) == dict(b.positions))
