"""Plots of what is chosen, over the time line of the robot or over the open motion."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import TYPE_CHECKING, Any, Mapping, NamedTuple, Tuple

import numpy as np

from g1_description.errors import G1DescriptionError, InvalidValueError
from g1_description.motion.history_chunks import Stretch, joined
from g1_description.web.controls import EditGuard, label_of
from g1_description.web.findings_panel import plain
from g1_description.web.history_panel import HistoryPanel
from g1_description.web.motion_panel import MotionPanel
from g1_description.web.quantities import (
    DISTANCE,
    KINDS,
    OF_JOINTS,
    Quantities,
    Quantity,
    motion_stretch,
)
from g1_description.web.robot import ShownRobot
from g1_description.web.ui_loop import UiLoop

if TYPE_CHECKING:
    from viser import GuiApi, GuiUplotHandle

    from g1_description.ros.history import HistoryClient


PERIOD = 0.5
"""Time between two pictures of a plot of a robot that is shown live, in [s]."""

TICK = 0.1
"""Time between two looks at what is shown, in [s]."""

SHARE = 4.0
"""Least pause after lines were computed, as a multiple of the time that it took."""

MAX_POINTS = 700
"""Of a line: uPlot leaves out pixels with unknown values when there are more points
than four per pixel. The least and the largest values stay."""

MAX_CURVES = 6

LEAST_ROOM = 0.005
"""Above and below the lines, in their unit."""

ROBOT, MOTION = "the robot", "the open motion"

COLORS = ("#d64541", "#1f77b4", "#2ca02c", "#ff7f0e", "#9467bd", "#17becf")

LEGEND = "*Solid: measured. Dashed: commanded.*"

NOTHING = "*Nothing is known: open a motion, or wait for a state of the robot.*"

AGAIN = 3.0
"""Pause after an error, in [s]."""

TIME = "Time in the plots"


class Curve(NamedTuple):
    """A line of a plot, with that of what is commanded."""

    robot: ShownRobot
    quantity: Quantity


Data = Mapping[Curve, Tuple[np.ndarray, np.ndarray, np.ndarray]]
"""Times in [s], measured and commanded values."""


class PlotPanel:
    """Plots, one per unit, and what is in them."""

    def __init__(
        self,
        gui: GuiApi,
        ui: UiLoop,
        robots: Sequence[ShownRobot],
        motion: MotionPanel,
        history: HistoryPanel | None,
    ) -> None:
        """Add the panel.

        Args:
            gui: Where to.
            ui: Runs the actions.
            robots: What can be plotted.
            motion: Has the open motions.
            history: Has the time line of the robots that run, if there is one.
        """
        self._gui, self._ui = gui, ui
        self._motion, self._history = motion, history
        self._robots = {robot.name: robot for robot in robots}
        self._quantities = {robot: Quantities(robot.description) for robot in robots}
        self._curves: list[Curve] = []
        self._plots: dict[str, GuiUplotHandle] = {}
        self._data: Data = {}
        self._pool = ThreadPoolExecutor(1)
        self._computing: Future[None] | None = None
        self._live: dict[ShownRobot, tuple[int, Stretch]] = {}
        """Lengths in [ns], and the last states of robots, as plotted last."""
        self._guard = EditGuard(1.0)
        self._looked = self._next = 0.0
        self._shown: object = None
        """What the newest data are of."""
        self._marked: float | None = None
        self._add()

    def _add(self) -> None:
        """Add the elements."""
        gui, ui = self._gui, self._ui
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
        self._told = gui.add_markdown(LEGEND)
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
        ui.on(self._source, self.refresh)
        ui.on(self._time, self._go)

    # --- what is plotted ---

    def _choose(self) -> None:
        """List the subjects of the chosen quantity."""
        robot, kind = self._robots[self._whose.value], self._kind.value
        names = self._quantities[robot].choices(kind) or ("none",)
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
        quantities = self._quantities[robot]
        subject = self._of.value
        if kind in OF_JOINTS:
            found = [n for n in quantities.choices(kind) if label_of(n) == subject]
            subject = found[0] if found else ""
        if not subject or subject not in quantities.choices(kind):
            raise InvalidValueError(f"{robot.name} has nothing to plot of that kind.")
        subjects: tuple[str, ...] = (subject,)
        if kind == DISTANCE:
            subjects = (subject, self._to.value)
            if subject == self._to.value:
                raise InvalidValueError("Choose two links, in Of and To.")
        curve = Curve(robot, Quantity(kind, subjects))
        if curve not in self._curves:
            self._curves = [*self._curves, curve][-MAX_CURVES:]
            self._make()

    def _clear(self) -> None:
        """Remove all curves."""
        self._curves = []
        self._make()

    def _make(self) -> None:
        """Recreate the plots."""
        for plot in self._plots.values():
            plot.remove()
        self._plots, by_unit = {}, self._by_unit()
        for unit, curves in by_unit.items():
            series: list[Any] = [{"label": "s"}]
            for curve in curves:
                color = COLORS[self._curves.index(curve)]
                name = self._label(curve)
                series.append({"label": name, "stroke": color, "width": 1.5})
                if curve.quantity.is_commanded:
                    dashed = {"stroke": color, "width": 1.0, "dash": [5, 4]}
                    series.append({"label": "commanded", **dashed})
            series.append({"label": "shown time", "stroke": "#888888", "width": 1.0})
            with self._folder:
                self._plots[unit] = self._gui.add_uplot(
                    self._columns(curves),
                    tuple(series),
                    scales={"x": {"time": False}},  # a change would zoom out
                    axes=({"show": True}, {"label": unit, "size": 56}),
                    padding=(10, 24, 0, 0),
                    cursor={"drag": {"x": False, "y": False}},  # type: ignore
                    aspect=1.1 if len(by_unit) == 1 else 1.6,
                )
        self.refresh()

    def _by_unit(self) -> dict[str, list[Curve]]:
        """Return the curves by their units."""
        found: dict[str, list[Curve]] = {}
        for curve in self._curves:
            unit = self._quantities[curve.robot].unit(curve.quantity)
            found.setdefault(unit, []).append(curve)
        return found

    def _label(self, curve: Curve) -> str:
        """Name a curve."""
        kind, subjects = curve.quantity
        words = " to ".join(label_of(subject) for subject in subjects)
        text = f"{kind}, {words}"
        return f"{curve.robot.name}: {text}" if len(self._robots) > 1 else text

    # --- drawing ---

    def refresh(self) -> None:
        """Compute the lines again, as there is another motion for example."""
        self._shown, self._next = None, 0.0

    @property
    def _plotted(self) -> HistoryPanel | None:
        """The history, if it is plotted; None: the open motion is."""
        return None if self._source.value == MOTION else self._history

    def follow(self) -> None:
        """Update the plots; called by the thread that draws."""
        now = time.monotonic()
        if now < self._looked + TICK:
            return
        self._looked = now
        at = self._at()
        if at is not None and not self._guard.is_held(self._time):
            self._guard.show(self._time, round(at, 3))
        if not self._curves:
            return
        shown = self._wanted()
        is_idle = self._computing is None or self._computing.done()
        if is_idle and now >= self._next and (shown is None or shown != self._shown):
            self._shown, self._next = shown, now + PERIOD
            curves = [*self._curves]
            act = partial(self._compute, curves, self._sources(curves))
            self._computing = self._pool.submit(self._ui.guarded, act)
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

    def _wanted(self) -> object:
        """Tell what is plotted; None: the present, which is always another one."""
        curves, history = tuple(self._curves), self._plotted
        if history is None:
            return curves, tuple(map(id, self._motion.motions.values()))
        shown = history.shown
        if shown is None:
            return None
        return curves, shown.robot, shown.run, shown.end, history.length

    def _sources(
        self, curves: Sequence[Curve]
    ) -> dict[ShownRobot, Callable[[], Stretch | None]]:
        """Return what has the states of each robot; it may block."""
        found: dict[ShownRobot, Callable[[], Stretch | None]] = {}
        history = self._plotted
        for robot in {curve.robot for curve in curves}:
            if history is None:
                motion = self._motion.motions.get(robot)
                if motion is not None:
                    found[robot] = partial(motion_stretch, motion)
            elif robot.history is not None:
                past, length = history.shown, history.length
                if past is None:
                    found[robot] = partial(self._present, robot, length)
                else:  # also of robots that are not rewound, at the same time
                    run = past.run if past.robot is robot else 0
                    span = max(past.end - length, 1), past.end, run
                    found[robot] = partial(_states, robot.history, *span)
        return found

    def _present(self, robot: ShownRobot, length: int) -> Stretch | None:
        """Return the last states of a robot; only the new ones are asked for."""
        newest, history = robot.state(), robot.history
        if newest is None or history is None:
            return None
        known, found = self._live.get(robot, (0, None))
        if (
            found is not None
            and length <= known
            and 0 <= newest.stamp - found.stamps[-1] < length
        ):
            last, run = int(found.stamps[-1]), found.run
            if newest.stamp > last:
                found = joined([found, _states(history, last + 1, newest.stamp, run)])
        else:
            found = history.whole(last=1e-9 * length).stretch
        found = found.rows(found.stamps >= found.stamps[-1] - length)
        self._live[robot] = length, found
        return found

    def _compute(
        self,
        curves: Sequence[Curve],
        sources: Mapping[ShownRobot, Callable[[], Stretch | None]],
    ) -> None:
        """Compute curves, in a thread of its own."""
        begin = time.monotonic()
        data: dict[Curve, Any] = {}
        stretches: dict[ShownRobot, Stretch | None] = {}
        problem = ""
        for curve in curves:
            robot = curve.robot
            try:
                if robot in sources and robot not in stretches:
                    stretches[robot] = None
                    stretches[robot] = sources[robot]()
                stretch = stretches.get(robot)
                if stretch is not None:
                    values = self._quantities[robot].lines(curve.quantity, stretch)
                    data[curve] = (1e-9 * stretch.stamps, *values)
            except G1DescriptionError as error:
                problem = str(error)
                self._live.pop(robot, None)
        pause = AGAIN if problem else SHARE * (time.monotonic() - begin)
        self._ui.post(self, partial(self._arrived, data, problem, pause))

    def _arrived(self, data: Data, problem: str, pause: float) -> None:
        """Draw new lines, or tell why there are none; pause before the next ones."""
        self._next = max(self._next, time.monotonic() + pause)
        text = plain(problem) or LEGEND
        if not data and not problem:
            text = NOTHING
        if self._told.content != text:
            self._told.content = text
        if problem:
            self._shown = None
        self._data = data
        ends = [times[-1] for times, _, _ in data.values()]
        if ends and self._at() is None and not self._guard.is_held(self._time):
            self._guard.show(self._time, round(max(ends), 3))
        self._draw()

    def _draw(self) -> None:
        """Hand the lines to the plots, with a mark at the shown time."""
        self._marked = self._at()
        for unit, curves in self._by_unit().items():
            self._plots[unit].data = self._columns(curves)

    def _columns(self, curves: Sequence[Curve]) -> tuple[np.ndarray, ...]:
        """Return common times, the columns of lines, and the mark."""
        known = [self._data[curve][0] for curve in curves if curve in self._data]
        times = np.unique(np.concatenate(known)) if known else np.zeros(0)
        if len(times) < 2:
            times = np.array([0.0, 1.0])
        columns = []
        for curve in curves:
            unknown = np.full(len(times), np.nan)
            own, *both = self._data.get(curve, (times, unknown, unknown))
            for values in both if curve.quantity.is_commanded else both[:1]:
                columns.append(np.interp(times, own, values, np.nan, np.nan))
        times, columns = thinned(times, columns)
        # Without a mark it is at the left, so that the axis has its limits.
        mark, row, at = np.full(len(times), np.nan), 0, self._marked
        if at is not None and times[0] <= at <= times[-1]:
            row = min(int(np.searchsorted(times, at)), len(times) - 2)
        mark[row : row + 2] = _limits(columns)
        return (times, *columns, mark)

    def _go(self) -> None:
        """Show the time that was entered."""
        at = float(self._time.value)
        self._guard.hold(self._time)
        if not math.isfinite(at):
            return
        history = self._plotted
        if history is None:
            self._motion.jump(at)
            if self._history is not None:
                self._history.live()  # it would not be seen
        else:
            chosen = self._robots[self._whose.value]
            first = self._curves[0].robot if self._curves else chosen
            history.go_to(first, at)


def _states(history: HistoryClient, begin: int, end: int, run: int) -> Stretch:
    """Ask for all states of a range."""
    return history.whole(begin, end, run).stretch


def thinned(
    times: np.ndarray, columns: Sequence[np.ndarray], most: int = MAX_POINTS
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Replace many points by the least and the largest of each few: peaks stay."""
    size = -(-2 * len(times) // most)
    if size <= 2:
        return times, [*columns]
    ends = np.minimum(np.arange(size, len(times) + size, size), len(times))
    first = ends - np.diff([0, *ends])
    kept = np.stack([first, ends - 1], axis=1).ravel()
    found = []
    for column in columns:
        low = np.fmin.reduceat(column, first)
        high = np.fmax.reduceat(column, first)
        rises = column[first] <= column[ends - 1]
        pairs = np.where(rises, [low, high], [high, low])
        found.append(pairs.T.ravel())
    return times[kept], found


def _limits(curves: Sequence[np.ndarray]) -> tuple[float, float]:
    """Return what the axis of values shows: uPlot shows 0 to 100 for a constant."""
    known = np.concatenate([[], *curves])
    known = known[np.isfinite(known)]
    if not known.size:
        known = np.zeros(1)
    room = max(0.05 * float(np.ptp(known)), LEAST_ROOM)
    return float(known.min()) - room, float(known.max()) + room
