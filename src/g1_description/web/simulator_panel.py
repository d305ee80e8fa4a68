"""Status and controls of the simulator."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from g1_description.web.robot import Simulator
from g1_description.web.ui_loop import UiLoop

if TYPE_CHECKING:
    from viser import GuiApi, GuiInputHandle


PERIOD = 0.5
"""Time between two looks at the simulator, in [s]."""

SPEEDS = {"0.1": 0.1, "0.25": 0.25, "0.5": 0.5, "1": 1.0, "2": 2.0, "no limit": 0.0}
"""Speeds of simulated time to choose from; 0 is that of the processor."""

MAX_STEPS = 100_000

ROPE = 2.0
"""Length of the rope at first, in [m]: that of a standing G1 just does not pull."""

SLICE = 100
"""Steps per request; other buttons wait for at most one request."""


class SimulatorPanel:
    """Pauses, steps and resets the simulator."""

    def __init__(
        self,
        gui: GuiApi,
        ui: UiLoop,
        simulator: Simulator,
        robot: str,
        read_only: bool,
    ) -> None:
        """Add the panel.

        Args:
            gui: Where to.
            ui: Does what a person wants.
            simulator: The simulator.
            robot: The robot that hangs on the gantry.
            read_only: Whether to show its state only.
        """
        self._simulator, self._robot = simulator, robot
        self._looked = 0.0
        self._left = 0
        """Steps still to be done; only the thread that waits sets it."""
        self._status = gui.add_markdown("")
        self._pause = None
        self._own: tuple[GuiInputHandle, ...] = ()
        """What the stand-in has only."""
        if read_only:
            return
        with gui.add_folder("Simulator", expand_by_default=False):
            self._pause = gui.add_button("Pause")
            self._steps = gui.add_number(
                "Steps", 10, min=1, max=MAX_STEPS, step=1, hint="of the physics"
            )
            step = gui.add_button("Step", hint="run this number of steps while paused")
            self._speed = gui.add_dropdown(
                "Speed", [*SPEEDS], initial_value="1", hint="of simulated time"
            )
            reset = gui.add_button("Reset", hint="reset the world")
            self._hangs = gui.add_checkbox(
                "Gantry", False, hint="hang the first robot on a rope, in hold and limp"
            )
            self._rope = gui.add_slider(
                "Rope", 0.5, 3.0, 0.05, ROPE, hint="its length in m, from 3 m above"
            )
        self._own = self._steps, step, self._speed, self._hangs, self._rope
        self._ui = ui
        ui.on(self._pause, self._toggle)
        ui.on(step, lambda: ui.calls.do(self._step))
        ui.on(
            self._speed,
            lambda: ui.calls.do(lambda: simulator.set_speed(SPEEDS[self._speed.value])),
        )
        for field in (self._hangs, self._rope):
            ui.on(field, lambda: ui.calls.do(self._hang))
        ui.on(reset, lambda: ui.calls.do(lambda: self._end_steps(simulator.reset)))

    def _toggle(self) -> None:
        """Pause, or go on: what the button said when it was pressed."""
        is_pause = self._pause is not None and self._pause.label == "Pause"
        act = self._simulator.pause if is_pause else self._simulator.go_on
        self._ui.calls.do(lambda: self._end_steps(act))

    def _hang(self) -> None:
        """Hang the robot on its rope, or let it go."""
        length = float(self._rope.value)
        try:
            self._simulator.hang(self._robot, bool(self._hangs.value), length)
        except Exception:
            self._hangs.value = False
            raise

    def _end_steps(self, act: Callable[[], object]) -> None:
        """Do no more steps, but something else."""
        self._left = 0
        act()

    def _step(self) -> None:
        """Begin to run some steps; time is paused first."""
        if not self._simulator.is_paused:
            self._simulator.pause()
        self._left = min(max(int(self._steps.value), 1), MAX_STEPS)
        self._step_on()

    def _step_on(self) -> None:
        """Run a slice of the steps that are left; the rest after what waits."""
        steps = min(self._left, SLICE)
        if not steps:
            return
        try:
            self._simulator.step(steps)
        except Exception:
            self._left = 0
            raise
        self._left -= steps
        self._ui.calls.do(self._step_on)

    def follow(self) -> None:
        """Show what the simulator says."""
        now = time.monotonic()
        if now < self._looked + PERIOD:
            return
        self._looked = now
        status = self._simulator.status()
        if self._status.content != status:
            self._status.content = status
        for element in self._own:
            if element.visible != self._simulator.is_stand_in:
                element.visible = self._simulator.is_stand_in
        if self._pause is not None:
            stands = self._simulator.is_paused and not self._left
            label = "Go on" if stands else "Pause"
            if self._pause.label != label:
                self._pause.label = label
