"""A picture of a motion: its measurements, and the times of its findings."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Callable

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from g1_description.checks import plot_panels
from g1_description.checks.measured import Measured
from g1_description.checks.verdict import Verdict
from g1_description.robot.description import Joint

WIDTH = 16.0
"""Width of the picture in inches, of 100 pixels."""

STRIP, ROW = 0.38, 0.19
"""Heights of a joint's strip, and of a row of findings or contacts, in inches."""

MAX_STRIPS = 10
"""Strips in a column."""

LINES = 1.25
"""Height of a panel with lines, in inches."""

LEFT = 0.215
"""Left edge of the panels, as a fraction of the width."""

HEAD = 0.95
"""Height of the title and the legend below it, in inches."""

GAP = 0.42
"""Between panels, in inches."""

COLORS = 128
"""Size of the palette: enough for smooth lines, at a third of the file size."""

STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.6,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "path.simplify": True,
}

Panel = Callable[[Axes], None]


def motion_plot(name: str, verdict: Verdict, joints: Sequence[Joint]) -> bytes:
    """Draw a motion.

    Args:
        name: Name of its file.
        verdict: With its measurements.
        joints: Movable joints of the robot.

    Returns:
        The picture as PNG; the same for the same arguments.
    """
    measured = verdict.measured
    assert measured is not None
    moved = [joint for joint in joints if joint.name in measured.joint_names]
    # Independent of the user's matplotlibrc.
    with matplotlib.rc_context({**matplotlib.rcParamsDefault, **STYLE}):
        return _png(_figure(name, verdict, measured, moved))


def _figure(
    name: str, verdict: Verdict, measured: Measured, joints: Sequence[Joint]
) -> Figure:
    """Lay the panels out, from top to bottom."""
    n_strips = -(-len(joints) // max(-(-len(joints) // MAX_STRIPS), 1))
    firsts = range(0, len(joints), max(n_strips, 1))
    columns = [joints[first : first + n_strips] for first in firsts]
    below = _panels(verdict, measured)
    heights = [STRIP * n_strips, *(height for _, height, _ in below)]
    total = HEAD + sum(heights) + GAP * len(heights)
    figure = Figure(figsize=(WIDTH, total), dpi=100)
    FigureCanvasAgg(figure)
    _title(figure, name, verdict, total)
    top = total - HEAD
    if columns:
        _joints(figure, (top, total), columns, measured, verdict)
    top -= heights[0] + GAP
    for title, height, draw in below:
        place = (LEFT, (top - height) / total, 0.98 - LEFT, height / total)
        axes = figure.add_axes(place, title=title)
        draw(axes)
        _time_axis(axes, measured.times)
        top -= height + GAP
    figure.axes[-1].set_xlabel("time [s]", fontsize=8, labelpad=1.0)
    return figure


def _joints(
    figure: Figure,
    place: tuple[float, float],
    columns: Sequence[Sequence[Joint]],
    measured: Measured,
    verdict: Verdict,
) -> None:
    """Draw the strips of joints."""
    top, total = place
    width = 1.0 / len(columns)
    for number, joints in enumerate(columns):
        height = STRIP * len(joints)
        axes = figure.add_axes(
            (
                number * width + 0.1,
                (top - height) / total,
                width - 0.135,
                height / total,
            )
        )
        plot_panels.joint_strips(axes, joints, measured, verdict)
        _time_axis(axes, measured.times)
        if not number:
            plot_panels.strips_legend(axes)


def _title(figure: Figure, name: str, verdict: Verdict, total: float) -> None:
    """Name the motion and the result."""
    color = plot_panels.COLORS.get(verdict.severity, plot_panels.GREEN)
    y = 1.0 - 0.3 / total
    figure.text(0.012, y, Path(name).name, fontsize=13, weight="bold", va="center")
    figure.text(
        0.985,
        y,
        f"{verdict.robot}: {verdict.severity}",
        fontsize=12,
        weight="bold",
        va="center",
        ha="right",
        bbox={"facecolor": color, "alpha": 0.55, "edgecolor": "none", "pad": 4.0},
    )


def _panels(verdict: Verdict, measured: Measured) -> list[tuple[str, float, Panel]]:
    """List titles, heights in inches and functions of the panels to draw."""
    times = measured.times
    found: list[tuple[str, float, Panel]] = []

    def add(title: str, height: float, draw: Panel, *checks: str) -> None:
        def whole(axes: Axes) -> None:
            draw(axes)
            plot_panels.shade(axes, verdict, checks, times)

        found.append((title, height, whole))

    n_findings = min(len(verdict.findings), plot_panels.MAX_ROWS + 1)
    if n_findings:
        add(
            "findings",
            ROW * n_findings,
            lambda axes: plot_panels.findings_panel(axes, verdict, times),
        )
    if measured.heights is not None:
        add(
            "links in contact with the floor; marked: sliding",
            ROW * max(len(verdict.floor_contacts), 1),
            lambda axes: plot_panels.contacts_panel(axes, measured, verdict),
        )
        add(
            "height of their lowest points above the floor [m]",
            LINES,
            lambda axes: plot_panels.heights_panel(axes, measured, verdict),
            "penetration",
            "floating",
        )
    if measured.balance is not None:
        add(
            "balance: distance inside the support polygon [m], negative outside",
            LINES,
            lambda axes: plot_panels.margins_panel(axes, measured),
            "center_of_mass",
            "zero_moment_point",
        )
    if "self_collision" in verdict.checked:
        add(
            "depth of the deepest self-collision [mm]",
            0.75 * LINES,
            lambda axes: plot_panels.depth_panel(axes, measured),
            "self_collision",
        )
    return found


def _time_axis(axes: Axes, times: np.ndarray) -> None:
    """Let the axes show the whole motion."""
    first, last = float(times[0]), float(times[-1])
    pad = 0.5 if last == first else 0.0
    axes.set_xlim(first - pad, last + pad)
    axes.tick_params(length=2.5, width=0.6)


def _png(figure: Figure) -> bytes:
    """Write a picture."""
    canvas = figure.canvas
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())[..., :3]
    image = Image.fromarray(pixels).quantize(COLORS, dither=Image.Dither.NONE)
    content = io.BytesIO()
    image.save(content, "PNG", optimize=True)
    return content.getvalue()
