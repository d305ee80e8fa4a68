"""Plots of chosen quantities, over the history of a robot or the open motion."""

from __future__ import annotations

import math
import time
from functools import partial
from typing import TYPE_CHECKING, Any

from g1_description.errors import InvalidValueError
from g1_description.web.findings_panel import plain
from g1_description.web.history_panel import HistoryPanel
from g1_description.web.motion_panel import MotionPanel
from g1_description.web.panel import Panel
from g1_description.web.plot_data import Answer, Curve, PlotData
from g1_description.web.quantities import (
    DISTANCE,
    KINDS,
    OF_JOINTS,
    Quantity,
    label_of,
)
from g1_description.web.ui_loop import Lane

if TYPE_CHECKING:
    from viser import GuiUplotHandle


PERIOD = 0.5
"""Time between two pictures of a plot of a robot that is shown live, in [s]."""

SHARE = 4.0
"""Least pause after lines were computed, as a multiple of the time that it took."""

ROBOT, MOTION = "the robot", "the open motion"

COLORS = ("#d64541", "#1f77b4", "#2ca02c", "#ff7f0e", "#9467bd", "#17becf")

LEGEND = "*Solid: measured. Dashed: commanded.*"

NOTHING = "*Nothing is known: open a motion, or wait for a state of the robot.*"

AGAIN = 3.0
"""Pause after an error, in [s]."""

TIME = "Time in the plots"


class PlotPanel(Panel):
    """Plots, one per unit."""

    def build(self) -> None:
        """Add the elements."""
        gui, ui = self.gui, self.ui
        self._robots = {robot.name: robot for robot in self.world.robots}
        self._motion = self.page.get(MotionPanel)
        self._history = self.page.find(HistoryPanel)
        self._data = PlotData(self.world.robots)
        self._plots: dict[str, GuiUplotHandle] = {}
        self._lane, self._next = Lane(ui), 0.0
        self._shown: object = None
        """The view that the newest numbers are of."""
        self._marked: float | None = None
        several = len(self._robots) > 1
        self._whose = gui.add_dropdown("Whose", [*self._robots], visible=several)
        self._kind = gui.add_dropdown("Quantity", KINDS)
        self._of = gui.add_dropdown("Of", ["none"])
        self._to = gui.add_dropdown("To", ["none"], visible=False)
        add, clear = gui.add_button("Add"), gui.add_button("Clear")
        self._source = gui.add_dropdown(
            "Source",
            [ROBOT, MOTION],
            initial_value=MOTION if self._history is None else ROBOT,
            visible=self._history is not None,
            hint="the last seconds of the tab History, or the open motion",
        )
        self._legend = gui.add_markdown(LEGEND)
        self._folder = gui.add_folder(None)
        self._time = gui.add_number(
            TIME, 0.0, step=0.001, hint="in s; type one to go there"
        )
        self._choose()
        ui.on(self._whose, self._choose)
        ui.on(self._kind, self._choose)
        ui.on(self._of, lambda: None)
        ui.on(self._to, lambda: None)
        ui.on(add, self._add_curve)
        ui.on(clear, self._clear)
        ui.on(self._source, self._compute_again)
        ui.on(self._time, self._go)

    # --- the curves ---

    def _choose(self) -> None:
        """List the subjects of the chosen quantity."""
        robot, kind = self._robots[self._whose.value], self._kind.value
        names = self._data.quantities[robot].choices(kind) or ("none",)
        if kind in OF_JOINTS:
            names = tuple(label_of(name) for name in names)
        self._of.options = names
        self._to.visible = kind == DISTANCE
        if kind == DISTANCE:
            self._to.options = names
            self._to.value = names[min(1, len(names) - 1)]

    def _add_curve(self) -> None:
        """Add the chosen curve."""
        robot, kind = self._robots[self._whose.value], self._kind.value
        choices = self._data.quantities[robot].choices(kind)
        subject = self._of.value
        if kind in OF_JOINTS:
            subject = next((n for n in choices if label_of(n) == subject), "")
        if subject not in choices:
            raise InvalidValueError(f"{robot.name} has nothing to plot of that kind.")
        subjects: tuple[str, ...] = (subject,)
        if kind == DISTANCE:
            subjects = (subject, self._to.value)
            if subject == self._to.value:
                raise InvalidValueError("Choose two links, in Of and To.")
        self._data.add(Curve(robot, Quantity(kind, subjects)))
        self._make()

    def _clear(self) -> None:
        """Remove all curves."""
        self._data.curves = ()
        self._make()

    def _make(self) -> None:
        """Recreate the plots."""
        for plot in self._plots.values():
            plot.remove()
        self._plots, by_unit = {}, self._data.by_unit()
        for unit, curves in by_unit.items():
            series: list[Any] = [{"label": "s"}]
            for curve in curves:
                color = COLORS[self._data.curves.index(curve)]
                name = self._data.label(curve)
                series.append({"label": name, "stroke": color, "width": 1.5})
                if curve.quantity.is_commanded:
                    dashed = {"stroke": color, "width": 1.0, "dash": [5, 4]}
                    series.append({"label": "commanded", **dashed})
            series.append({"label": "shown time", "stroke": "#888888", "width": 1.0})
            with self._folder:
                self._plots[unit] = self.gui.add_uplot(
                    self._data.columns(curves, self._marked),
                    tuple(series),
                    scales={"x": {"time": False}},  # a change would zoom out
                    axes=({"show": True}, {"label": unit, "size": 56}),
                    padding=(10, 24, 0, 0),
                    cursor={"drag": {"x": False, "y": False}},  # type: ignore
                    aspect=1.1 if len(by_unit) == 1 else 1.6,
                )
        self._compute_again()

    # --- drawing ---

    def _compute_again(self) -> None:
        """Compute the lines again."""
        self._shown, self._next = None, 0.0

    @property
    def _plotted(self) -> HistoryPanel | None:
        """The history, if it is plotted; None: the open motion is."""
        return None if self._source.value == MOTION else self._history

    def update(self) -> None:
        """Update the plots."""
        at, now = self._at(), time.monotonic()
        if at is not None:
            self.show(self._time, round(at, 3))
        if not self._data.curves:
            return
        shown = self._view()
        is_new = shown is None or shown != self._shown
        if is_new and now >= self._next and not self._lane.is_busy:
            self._shown, self._next = shown, now + PERIOD
            history, data = self._plotted, self._data
            if history is None:
                sources = data.of_motions(self._motion.motions)
            else:
                sources = data.of_history(history.shown, history.length)
            compute = partial(data.compute, data.curves, sources)
            self._lane.do(compute, self._arrived)
        elif at != self._marked:
            self._draw()

    def _at(self) -> float | None:
        """Return the time that is shown, in [s]; None: the present."""
        history = self._plotted
        if history is None:
            player = self._motion.player
            return None if player is None else player.time
        shown = history.shown
        return None if shown is None or shown.state is None else shown.state.time

    def _view(self) -> object:
        """Return the plotted view; None: the present, which is always another one."""
        curves, history = self._data.curves, self._plotted
        if history is None:
            return curves, self._motion.opened
        shown = history.shown
        if shown is None:
            return None
        return curves, shown.robot, shown.run, shown.end, history.length

    def _arrived(self, answer: Answer) -> None:
        """Draw new lines, or say why there are none; pause before the next ones."""
        pause = AGAIN if answer.problem else SHARE * answer.seconds
        self._next = max(self._next, time.monotonic() + pause)
        unknown = LEGEND if answer.data else NOTHING
        self._legend.content = plain(answer.problem) or unknown
        if answer.problem:
            self._shown = None
        self._data.numbers = answer
        end = self._data.end
        if end is not None and self._at() is None:
            self.show(self._time, round(end, 3))
        self._draw()

    def _draw(self) -> None:
        """Hand the lines to the plots, with a mark at the shown time."""
        self._marked = self._at()
        for unit, curves in self._data.by_unit().items():
            self._plots[unit].data = self._data.columns(curves, self._marked)

    def _go(self) -> None:
        """Show the time that was entered."""
        at = float(self._time.value)
        if not math.isfinite(at):
            return
        history = self._plotted
        if history is None:
            self._motion.jump(at)
            if self._history is not None:
                self._history.live()  # it would not be seen
        else:
            chosen = self._robots[self._whose.value]
            curves = self._data.curves
            history.go_to(curves[0].robot if curves else chosen, at)
