"""Lines of the page's plots: which there are, and their numbers."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Callable, Dict, NamedTuple, Optional

import numpy as np

from g1_description.errors import G1DescriptionError
from g1_description.motion.history_chunks import Stretch, joined
from g1_description.motion.motion import Motion
from g1_description.web.quantities import (
    Quantities,
    Quantity,
    label_of,
    motion_stretch,
)
from g1_description.web.robot import ShownRobot
from g1_description.web.timeline import Timeline

if TYPE_CHECKING:
    from g1_description.ros.history import HistoryClient


MAX_POINTS = 700
"""Of a line: uPlot leaves out pixels with unknown values when there are more points
than four per pixel. The least and the largest values stay."""

MAX_CURVES = 6

LEAST_ROOM = 0.005
"""Above and below the lines, in their unit."""


class Curve(NamedTuple):
    """A line of a plot, with its commanded one."""

    robot: ShownRobot
    quantity: Quantity


Sources = Dict[ShownRobot, Callable[[], Optional[Stretch]]]
"""Functions that get the states of robots; they may block."""


class Answer(NamedTuple):
    """The numbers of curves."""

    data: Mapping[Curve, tuple[np.ndarray, np.ndarray, np.ndarray]]
    """Times in [s], measured and commanded values; without curves that are unknown."""

    problem: str
    """Why some are unknown; empty: they are not."""

    seconds: float
    """How long it took."""


class PlotData:
    """Curves of some robots, and their newest numbers."""

    def __init__(self, robots: Sequence[ShownRobot]) -> None:
        """Begin without curves."""
        self.quantities = {robot: Quantities(robot.description) for robot in robots}
        self.curves: tuple[Curve, ...] = ()
        """At most ``MAX_CURVES``."""
        self.numbers: Answer = Answer({}, "", 0.0)
        self._live: dict[ShownRobot, tuple[int, Stretch]] = {}
        """Lengths in [ns], and the last states of robots, as plotted last."""

    def add(self, curve: Curve) -> None:
        """Add a curve, unless it is there; of too many, the oldest one goes."""
        if curve not in self.curves:
            self.curves = (*self.curves, curve)[-MAX_CURVES:]

    def by_unit(self) -> dict[str, list[Curve]]:
        """Return the curves by their units."""
        found: dict[str, list[Curve]] = {}
        for curve in self.curves:
            unit = self.quantities[curve.robot].unit(curve.quantity)
            found.setdefault(unit, []).append(curve)
        return found

    def label(self, curve: Curve) -> str:
        """Name a curve, and its robot if there are several."""
        kind, subjects = curve.quantity
        text = f"{kind}, " + " to ".join(label_of(subject) for subject in subjects)
        is_one = len(self.quantities) == 1
        return text if is_one else f"{curve.robot.name}: {text}"

    # --- where the states come from ---

    def of_motions(self, motions: Mapping[ShownRobot, Motion]) -> Sources:
        """Return the sources of robots whose motions are plotted."""
        return {robot: partial(motion_stretch, one) for robot, one in motions.items()}

    def of_history(self, shown: Timeline | None, length: int) -> Sources:
        """Return the sources of robots that keep their past.

        Args:
            shown: The time line; robots that are not rewound have the same times. None:
                the present.
            length: In [ns].
        """
        found: Sources = {}
        for robot in self.quantities:
            if robot.history is None:
                continue
            if shown is None or shown.end is None:
                found[robot] = partial(self._present, robot, length)
            else:
                run = (shown.run or 0) if shown.robot is robot else 0
                span = shown.begin(length), shown.end, run
                found[robot] = partial(_states, robot.history, *span)
        return found

    def _present(self, robot: ShownRobot, length: int) -> Stretch | None:
        """Return the last states of a robot; only the new ones are requested."""
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

    # --- numbers ---

    def compute(self, curves: Sequence[Curve], sources: Sources) -> Answer:
        """Compute curves; it may block, and runs in a thread of its own."""
        begin, problem = time.monotonic(), ""
        data: dict[Curve, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        stretches: dict[ShownRobot, Stretch | None] = {}
        for curve in curves:
            robot = curve.robot
            try:
                if robot in sources and robot not in stretches:
                    stretches[robot] = None
                    stretches[robot] = sources[robot]()
                stretch = stretches.get(robot)
                if stretch is not None:
                    values = self.quantities[robot].lines(curve.quantity, stretch)
                    data[curve] = (1e-9 * stretch.stamps, *values)
            except G1DescriptionError as error:
                problem = str(error)
                self._live.pop(robot, None)
        return Answer(data, problem, time.monotonic() - begin)

    @property
    def end(self) -> float | None:
        """Time of the newest state in the numbers, in [s]; None: there is none."""
        ends = [times[-1] for times, _, _ in self.numbers.data.values()]
        return max(ends, default=None)

    def columns(
        self, curves: Sequence[Curve], at: float | None
    ) -> tuple[np.ndarray, ...]:
        """Return the columns of a plot.

        Args:
            curves: Its curves, of one unit.
            at: Time of the mark, in [s]; None: at the left, so that the axis has its
                limits.

        Returns:
            Common times, a column per line, NaN where it is unknown, and the mark, all
            of shape (n,).
        """
        data = self.numbers.data
        known = [data[curve][0] for curve in curves if curve in data]
        times = np.unique(np.concatenate(known)) if known else np.zeros(0)
        if len(times) < 2:
            times = np.array([0.0, 1.0])
        columns = []
        for curve in curves:
            unknown = np.full(len(times), np.nan)
            own, *both = data.get(curve, (times, unknown, unknown))
            for values in both if curve.quantity.is_commanded else both[:1]:
                columns.append(np.interp(times, own, values, np.nan, np.nan))
        times, columns = thinned(times, columns)
        mark, row = np.full(len(times), np.nan), 0
        if at is not None and times[0] <= at <= times[-1]:
            row = min(int(np.searchsorted(times, at)), len(times) - 2)
        mark[row : row + 2] = _limits(columns)
        return (times, *columns, mark)


def _states(history: HistoryClient, begin: int, end: int, run: int) -> Stretch:
    """Request all states of a range."""
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
    """Return the limits of the axis: uPlot would show 0 to 100 for a constant."""
    known = np.concatenate([[], *curves])
    known = known[np.isfinite(known)]
    if not known.size:
        known = np.zeros(1)
    room = max(0.05 * float(np.ptp(known)), LEAST_ROOM)
    return float(known.min()) - room, float(known.max()) + room
