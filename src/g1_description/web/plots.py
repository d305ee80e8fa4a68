"""Plots of chosen joints: measured and commanded positions."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from g1_description.motion.motion import Motion
from g1_description.robot.state import RobotState
from g1_description.web.controls import label_of
from g1_description.web.robot import Player, ShownRobot
from g1_description.web.ui_loop import UiLoop

if TYPE_CHECKING:
    from viser import GuiApi, GuiUplotHandle


SECONDS = 10.0
"""How much of the past is shown, in [s]."""

PERIOD = 0.2
"""Time between two pictures of a plot, in [s]."""

MAX_POINTS = 2000
"""Of a plot."""

MAX_JOINTS = 6

LEAST_ROOM = 0.02
"""Above and below the lines, in [rad] or [m]."""

LAST, WHOLE = "last 10 s", "whole motion"

COLORS = ("#d64541", "#1f77b4", "#2ca02c", "#ff7f0e", "#9467bd", "#17becf")


class PlotPanel:
    """One plot, and the joints that are in it."""

    def __init__(self, gui: GuiApi, ui: UiLoop, robots: list[ShownRobot]) -> None:
        """Add the panel.

        Args:
            gui: Where to.
            ui: Does what a person wants.
            robots: Whose joints can be chosen.
        """
        self._gui = gui
        self._choices = {
            self._choice(robot, joint.name, len(robots) > 1): (robot, joint.name)
            for robot in robots
            for joint in robot.description.movable_joints
        }
        self._chosen: list[str] = []
        self._past: deque[tuple[float, dict[ShownRobot, tuple]]] = deque(
            maxlen=MAX_POINTS
        )
        self._drawn = 0.0
        self.motions: Mapping[ShownRobot, Motion] = {}
        """What each robot plays."""
        self._joint = gui.add_dropdown("Joint", [*self._choices] or ["none"])
        add, clear = gui.add_button("Add"), gui.add_button("Clear")
        self._span = gui.add_dropdown("Shows", [LAST, WHOLE])
        gui.add_markdown("*Solid: measured. Dashed: commanded, where it is known.*")
        self._folder = gui.add_folder(None)
        self._plot: GuiUplotHandle | None = None
        self._recorded: dict[str, list[tuple[float, float]]] = {}
        ui.on(add, self._add)
        ui.on(clear, self._clear)
        ui.on(self._span, self._make)

    @staticmethod
    def _choice(robot: ShownRobot, joint: str, with_robot: bool) -> str:
        """Name a joint in the list."""
        return f"{robot.name}: {label_of(joint)}" if with_robot else label_of(joint)

    def _add(self) -> None:
        """Add the joint that is chosen."""
        name = self._joint.value
        if name in self._choices and name not in self._chosen:
            self._chosen = [*self._chosen, name][-MAX_JOINTS:]
            self._make()

    def _clear(self) -> None:
        """Leave no joint in the plot."""
        self._chosen = []
        self._make()

    def _make(self) -> None:
        """Recreate the plot, with a pair of lines per joint."""
        if self._plot is not None:
            self._plot.remove()
            self._plot = None
        if not self._chosen:
            return
        series: list[Any] = [{"label": "s"}]
        for name, color in zip(self._chosen, COLORS):
            series.append({"label": name, "stroke": color, "width": 1.5})
            series.append(
                {"label": "commanded", "stroke": color, "width": 1.0, "dash": [5, 4]}
            )
        axis = {"show": True}
        with self._folder:
            self._plot = self._gui.add_uplot(
                self._data(None),
                tuple(series),
                scales=_scales(()),
                axes=(axis, {"label": "rad, m", "size": 56}),
                aspect=1.1,
            )

    def add(
        self,
        states: Mapping[ShownRobot, RobotState],
        player: Player | None,
    ) -> None:
        """Extend the lines.

        Args:
            states: Of each robot.
            player: What plays a motion.
        """
        now = time.monotonic()
        at = {
            robot: (state.positions_by_name, state.commanded)
            for robot, state in states.items()
        }
        self._past.append((now, at))
        if player is not None and self._chosen:
            self._record(player.time, at)
        if self._plot is not None and now > self._drawn + PERIOD:
            self._drawn = now
            self._plot.data = data = self._data(player)
            scales = _scales(data[1:])
            if scales != self._plot.scales:
                self._plot.scales = scales

    def _record(self, at: float, states: Mapping[ShownRobot, tuple]) -> None:
        """Keep where chosen joints were at a time of the motion."""
        for name in self._chosen:
            robot, joint = self._choices[name]
            if robot in states and joint in states[robot][0]:
                line = self._recorded.setdefault(name, [])
                line.append((at, states[robot][0][joint]))
                del line[: -4 * MAX_POINTS]

    def forget(self) -> None:
        """Begin again, as there is another motion."""
        self._recorded.clear()

    def _data(self, player: Player | None) -> tuple[np.ndarray, ...]:
        """Return the times and the lines."""
        if self._span.value == WHOLE:
            return self._whole()
        now = time.monotonic()
        past = [(t - now, at) for t, at in self._past if t > now - SECONDS]
        times = np.array([t for t, _ in past] or [-SECONDS, 0.0])
        lines = [times]
        for name in self._chosen:
            robot, joint = self._choices[name]
            for which in (0, 1):
                line = [at.get(robot, ({}, {}))[which].get(joint) for _, at in past]
                lines.append(np.array(line or [np.nan] * 2, dtype=float))
        return tuple(lines)

    def _whole(self) -> tuple[np.ndarray, ...]:
        """Return the lines over the whole motion."""
        trajectories = {r: m for r, m in self.motions.items()}
        all_times = [t.times for t in trajectories.values()] or [np.array([0.0, 1.0])]
        times = np.unique(np.concatenate(all_times))
        times = times[:: max(1, len(times) // MAX_POINTS)]
        lines = [times]
        for name in self._chosen:
            robot, joint = self._choices[name]
            lines.append(_at(times, sorted(self._recorded.get(name, []))))
            motion = trajectories.get(robot)
            line = np.full(len(times), np.nan)
            if motion is not None and joint in motion.joint_names:
                column = motion.positions[:, motion.joint_names.index(joint)]
                line = np.interp(times, motion.times, column, np.nan, np.nan)
            lines.append(line)
        return tuple(lines)


def _scales(lines: Sequence[np.ndarray]) -> dict[str, Any]:
    """Choose what the axes show: uPlot's own choice for a constant is 0 to 100."""
    known = np.concatenate([[], *lines])
    known = known[np.isfinite(known)]
    if not known.size:
        known = np.zeros(1)
    room = max(0.1 * float(np.ptp(known)), LEAST_ROOM)
    below, above = float(known.min()) - room, float(known.max()) + room
    return {"x": {"time": False}, "y": {"range": (round(below, 2), round(above, 2))}}


def _at(times: np.ndarray, points: list[tuple[float, float]]) -> np.ndarray:
    """Interpolate points at times, NaN beyond them."""
    if not points:
        return np.full(len(times), np.nan)
    known, values = np.array(points).T
    return np.interp(times, known, values, np.nan, np.nan)
