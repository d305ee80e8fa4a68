"""Status and controls of the simulator."""

from __future__ import annotations

from collections.abc import Callable

from g1_description.web.panel import Panel

SPEEDS = {"0.1": 0.1, "0.25": 0.25, "0.5": 0.5, "1": 1.0, "2": 2.0, "no limit": 0.0}
"""Speeds of simulated time to choose from; 0 is that of the processor."""

MAX_STEPS = 100_000

ROPE = 2.0
"""Length of the rope at first, in [m]: that of a standing G1 just does not pull."""

SLICE = 100
"""Steps per request; other buttons wait for at most one request."""


class SimulatorStatus(Panel):
    """The line above the tabs that shows what the simulator does."""

    period = 0.5

    def build(self) -> None:
        """Add the line."""
        self._status = self.gui.add_markdown("")

    def update(self) -> None:
        """Show physics, time and speed."""
        assert self.world.simulator is not None
        self._status.content = self.world.simulator.status()


class SimulatorPanel(Panel):
    """Pauses, steps and resets the simulator."""

    title, period = "Simulator", 0.5

    def build(self) -> None:
        """Add the elements."""
        gui, ui, simulator = self.gui, self.ui, self.world.simulator
        assert simulator is not None
        self._simulator = simulator
        self._left = 0
        """Steps still to be done; only the lane of calls sets it."""
        self._pause = gui.add_button("Pause")
        self._steps = gui.add_number(
            "Steps", 10, min=1, max=MAX_STEPS, step=1, hint="of the physics"
        )
        step = gui.add_button("Step", hint="run this number of steps while paused")
        self._speed = gui.add_dropdown(
            "Speed", [*SPEEDS], initial_value="1", hint="of simulated time"
        )
        reset = gui.add_button("Reset", color="orange", hint="reset the world")
        self._hangs = gui.add_checkbox(
            "Gantry", False, hint="hang the first robot on a rope, in hold and limp"
        )
        self._rope = gui.add_slider(
            "Rope", 0.5, 3.0, 0.05, ROPE, hint="its length in m, from 3 m above"
        )
        self._own = self._steps, step, self._speed, self._hangs, self._rope
        """Elements that only the stand-in has."""
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
        """Pause, or go on, as the button said when it was pressed."""
        is_pause = self._pause.label == "Pause"
        act = self._simulator.pause if is_pause else self._simulator.go_on
        self.ui.calls.do(lambda: self._end_steps(act))

    def _hang(self) -> None:
        """Hang the robot on its rope, or let it go."""
        length = float(self._rope.value)
        try:
            robot = self.world.robots[0].name
            self._simulator.hang(robot, bool(self._hangs.value), length)
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
        self.ui.calls.do(self._step_on)

    def update(self) -> None:
        """Show what can be done now."""
        for element in self._own:
            element.visible = self._simulator.is_stand_in
        stands = self._simulator.is_paused and not self._left
        self._pause.label = "Go on" if stands else "Pause"
