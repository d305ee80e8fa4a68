"""A picture of a motion: its measurements, and the times of its findings."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Callable

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from PIL import Image

from g1_description.checks.measured import Measured
from g1_description.checks.rules.forces import forces
from g1_description.checks.verdict import FAILED, WARNING, Verdict
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

PALETTE = 128
"""Colours of the file: enough for smooth lines, at a third of its size."""

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

MAX_BINS = 1200
"""Number of bins of a long series: a picture has no more columns of pixels."""

LEAST_WIDTH = 0.003
"""Least width of a marked time, as a fraction of the panel's."""

BLUE, GREEN, PURPLE, GREY = "#0072B2", "#009E73", "#CC79A7", "#777777"
RED = "#D55E00"
LIMITS = "#EBEBEB"
COLORS = {FAILED: "#D55E00", WARNING: "#E8C000"}
"""Colour-blind safe, by Okabe and Ito; the yellow is darker."""

SHADE = 0.45
"""Opacity of a marked time."""

HALF = 0.42
"""Half the height of a strip between the limits of its joint; strips are 1 apart."""

MOST_BEYOND = 1.35
"""A joint is drawn up to this multiple of its limits."""

MOST_SHARE = 1.5
"""Friction and missing forces are drawn up to this."""

MAX_LABEL = 52
"""Longest label of a row, in characters."""

MAX_ROWS = 14
"""Largest number of findings with a row of their own."""

SLIDING = ("skating", "drift")
"""Checks whose findings are drawn over the contacts."""

Panel = Callable[[Axes, Measured, Verdict], None]


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
        canvas = FigureCanvasAgg(_figure(name, verdict, measured, moved))
        canvas.draw()
        pixels = np.asarray(canvas.buffer_rgba())[..., :3]
    image = Image.fromarray(pixels).quantize(PALETTE, dither=Image.Dither.NONE)
    content = io.BytesIO()
    image.save(content, "PNG", optimize=True)
    return content.getvalue()


def _figure(
    name: str, verdict: Verdict, measured: Measured, joints: Sequence[Joint]
) -> Figure:
    """Lay the panels out, from top to bottom."""
    n_strips = -(-len(joints) // max(-(-len(joints) // MAX_STRIPS), 1))
    firsts = range(0, len(joints), max(n_strips, 1))
    columns = [joints[first : first + n_strips] for first in firsts]
    below = _panels(verdict, measured)
    heights = [STRIP * n_strips, *(height for _, height, _, _ in below)]
    total = HEAD + sum(heights) + GAP * len(heights)
    figure = Figure(figsize=(WIDTH, total), dpi=100)
    _title(figure, name, verdict, total)
    top = total - HEAD
    width = 1.0 / max(len(columns), 1)
    for number, strips in enumerate(columns):
        height = STRIP * len(strips)
        left, bottom = number * width + 0.1, (top - height) / total
        axes = figure.add_axes((left, bottom, width - 0.135, height / total))
        _joint_strips(axes, strips, measured, verdict)
        _time_axis(axes, measured.times)
        if not number:
            _strips_legend(axes)
    top -= heights[0] + GAP
    for title, height, draw, checks in below:
        place = (LEFT, (top - height) / total, 0.98 - LEFT, height / total)
        axes = figure.add_axes(place, title=title)
        draw(axes, measured, verdict)
        _shade(axes, verdict, checks, measured.times)
        _time_axis(axes, measured.times)
        top -= height + GAP
    figure.axes[-1].set_xlabel("time [s]", fontsize=8, labelpad=1.0)
    return figure


def _title(figure: Figure, name: str, verdict: Verdict, total: float) -> None:
    """Name the motion and the result."""
    color = COLORS.get(verdict.severity, GREEN)
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


def _panels(
    verdict: Verdict, measured: Measured
) -> list[tuple[str, float, Panel, tuple[str, ...]]]:
    """List titles, heights in inches and functions of panels, and shaded checks."""
    n_findings = min(len(verdict.findings), MAX_ROWS + 1)
    is_on_floor = measured.heights is not None
    rows: tuple[tuple[bool, str, float, Panel, tuple[str, ...]], ...] = (
        (n_findings > 0, "findings", ROW * n_findings, _findings_panel, ()),
        (
            is_on_floor,
            "links in contact with the floor; marked: sliding",
            ROW * max(len(verdict.floor_contacts), 1),
            _contacts_panel,
            (),
        ),
        (
            is_on_floor,
            "height of their lowest points above the floor [m]",
            LINES,
            _heights_panel,
            ("penetration", "floating"),
        ),
        (
            measured.balance is not None,
            "balance: distance inside the support polygon [m], negative outside",
            LINES,
            _margins_panel,
            ("center_of_mass",),
        ),
        (
            "contact_forces" in verdict.checked,
            "vertical contact forces [N]",
            LINES,
            _forces_panel,
            ("contact_forces",),
        ),
        (
            "contact_forces" in verdict.checked,
            "friction needed; contact force that is missing, as a fraction of the "
            "weight",
            0.75 * LINES,
            _missing_panel,
            ("contact_forces",),
        ),
        (
            "self_collision" in verdict.checked,
            "depth of the deepest self-collision [mm]",
            0.75 * LINES,
            _depth_panel,
            ("self_collision",),
        ),
    )
    return [row[1:] for row in rows if row[0]]


def _time_axis(axes: Axes, times: np.ndarray) -> None:
    """Let the axes show the whole motion."""
    first, last = float(times[0]), float(times[-1])
    pad = 0.5 if last == first else 0.0
    axes.set_xlim(first - pad, last + pad)
    axes.tick_params(length=2.5, width=0.6)


def thinned(times: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Thin a long series to the resolution of a picture.

    Args:
        times: In [s], rising, shape (n,).
        values: Shape (n,); NaN where there is none.

    Returns:
        Times and values; of each bin of a long series the least and the largest one, so
        that peaks are kept.
    """
    if len(times) <= 4 * MAX_BINS:
        return times, values
    size = -(-len(times) // MAX_BINS)
    whole = len(times) // size * size
    bins = values[:whole].reshape(-1, size)
    low = np.fmin.reduce(bins, axis=1)
    high = np.fmax.reduce(bins, axis=1)
    starts = times[:whole].reshape(-1, size)[:, 0]
    found = np.stack([low, high], axis=1).ravel()
    return (
        np.append(np.repeat(starts, 2), times[whole:]),
        np.append(found, values[whole:]),
    )


def in_limits(joint: Joint, positions: np.ndarray) -> np.ndarray:
    """Scale positions so that the lower limit is at -1 and the upper one at 1.

    Args:
        joint: The joint; without limits its largest distance from zero is taken.
        positions: In [rad] or [m], shape (n,).
    """
    lower, upper = joint.lower, joint.upper
    if not (np.isfinite(lower) and np.isfinite(upper)):
        most = float(np.abs(positions).max()) or 1.0
        lower, upper = -most, most
    middle, half = (lower + upper) / 2.0, (upper - lower) / 2.0
    return (positions - middle) / (half or 1.0)


def bars(
    intervals: Iterable[Sequence[float]], times: np.ndarray
) -> list[tuple[float, float]]:
    """Return beginnings and widths of intervals, wide enough to be seen.

    Args:
        intervals: First and last times of each, in [s]; they may overlap.
        times: Times of the whole motion in [s], shape (n,).
    """
    least = LEAST_WIDTH * (float(times[-1] - times[0]) or 1.0)
    joined: list[list[float]] = []
    for first, last in sorted((float(first), float(last)) for first, last in intervals):
        lack = max(0.0, least - (last - first)) / 2.0
        if joined and first - lack <= joined[-1][1]:
            joined[-1][1] = max(joined[-1][1], last + lack)
        else:
            joined.append([first - lack, last + lack])
    return [(first, last - first) for first, last in joined]


def _shade(
    axes: Axes, verdict: Verdict, checks: Sequence[str], times: np.ndarray
) -> None:
    """Mark the times of findings of checks over the whole height; failures on top."""
    found = [f for f in verdict.findings if f.check in checks]
    for severity in (WARNING, FAILED):
        when = [i for f in found if f.severity == severity for i in f.intervals]
        axes.broken_barh(
            bars(when, times),
            (0.0, 1.0),
            transform=axes.get_xaxis_transform(),
            color=COLORS[severity],
            alpha=SHADE,
            linewidth=0.0,
            zorder=0.5,
        )


def _joint_strips(
    axes: Axes, joints: Sequence[Joint], measured: Measured, verdict: Verdict
) -> None:
    """Draw joints between their limits, a strip for each, and their speeds."""
    times = measured.times
    marker = "." if len(times) == 1 else ""
    for row, joint in enumerate(joints):
        column = measured.joint_names.index(joint.name)
        axes.axhspan(row - HALF, row + HALF, color=LIMITS, linewidth=0.0, zorder=0)
        for finding in reversed(verdict.findings):  # failures above warnings
            if finding.subject == (joint.name,):
                where = (row - 0.5, 1.0)
                color = COLORS[finding.severity]
                spans = bars(finding.intervals, times)
                axes.broken_barh(
                    spans, where, color=color, alpha=SHADE, linewidth=0.0, zorder=0.5
                )
        speed = np.zeros(len(times))
        if np.isfinite(joint.velocity) and joint.velocity > 0.0:
            speed = measured.velocities[:, column] / joint.velocity
        place = in_limits(joint, measured.positions[:, column])
        for values, color, width in ((speed, PURPLE, 0.8), (place, BLUE, 1.2)):
            known = np.clip(values, -MOST_BEYOND, MOST_BEYOND)
            x, y = thinned(times, known)
            axes.plot(x, row - HALF * y, marker=marker, color=color, lw=width)
        beyond = max(np.abs(place).max(), np.abs(speed).max()) > 1.0
        axes.text(
            1.01,
            row,
            f"{np.abs(place).max():.2f}\n{np.abs(speed).max():.2f}",
            transform=axes.get_yaxis_transform(),
            va="center",
            fontsize=6.5,
            color=COLORS[FAILED] if beyond else GREY,
        )
    axes.set_yticks(range(len(joints)))
    axes.set_yticklabels([joint.name.replace("_joint", "") for joint in joints])
    axes.set_ylim(len(joints) - 0.5, -0.5)  # the first one on top


def _strips_legend(axes: Axes) -> None:
    """Explain the strips of joints, above them."""
    handles = [
        Line2D([], [], color=BLUE, lw=1.2, label="position between its limits"),
        Line2D(
            [], [], color=PURPLE, lw=0.8, label="velocity as a fraction of its limit"
        ),
        Patch(color=LIMITS, label="limits"),
        Patch(color=COLORS[FAILED], alpha=SHADE, label="failed"),
        Patch(color=COLORS[WARNING], alpha=SHADE, label="warning"),
        Line2D([], [], lw=0, label="right: largest of both"),
    ]
    axes.legend(
        handles=handles,
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncol=len(handles),
        frameon=False,
        fontsize=8,
        borderaxespad=0.2,
    )


def _findings_panel(axes: Axes, measured: Measured, verdict: Verdict) -> None:
    """Draw when each finding exceeds its threshold, a row for each."""
    shown = verdict.findings[:MAX_ROWS]
    for row, finding in enumerate(shown):
        spans = bars(finding.intervals, measured.times)
        color = COLORS[finding.severity]
        axes.broken_barh(spans, (row - 0.38, 0.76), color=color, linewidth=0.0)
    names = [f"{f.check}  {f.name.replace('_link', '')}".strip() for f in shown]
    names = [n if len(n) <= MAX_LABEL else f"{n[: MAX_LABEL - 3]}..." for n in names]
    more = len(verdict.findings) - len(shown)
    if more:
        names.append(f"and {more} more")
    axes.set_yticks(range(len(names)))
    axes.set_yticklabels(names)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.grid(axis="x", color="#DDDDDD", lw=0.6)
    axes.set_axisbelow(True)


def _contacts_panel(axes: Axes, measured: Measured, verdict: Verdict) -> None:
    """Draw when links are in contact with the floor."""
    times = measured.times
    links = [*verdict.floor_contacts]
    for row, link in enumerate(links):
        spans = bars(verdict.floor_contacts[link], times)
        axes.broken_barh(spans, (row - 0.3, 0.6), color=GREEN, linewidth=0.0)
        for finding in verdict.findings:
            if finding.subject == (link,) and finding.check in SLIDING:
                spans = bars(finding.intervals, times)
                color = COLORS[finding.severity]
                axes.broken_barh(spans, (row - 0.45, 0.9), color=color, linewidth=0.0)
    axes.set_yticks(range(len(links)))
    axes.set_yticklabels([link.replace("_link", "") for link in links])
    axes.set_ylim(max(len(links), 1) - 0.5, -0.5)


def _heights_panel(axes: Axes, measured: Measured, verdict: Verdict) -> None:
    """Draw the heights of links that are ever in contact."""
    assert measured.heights is not None
    colors = (BLUE, PURPLE, GREEN, GREY)
    for number, link in enumerate([*verdict.floor_contacts][: len(colors)]):
        heights = measured.heights[:, measured.ground_links.index(link)]
        x, y = thinned(measured.times, np.where(np.isfinite(heights), heights, np.nan))
        axes.plot(x, y, color=colors[number], lw=1.0, label=link.replace("_link", ""))
    axes.axhline(0.0, color="black", lw=0.6)
    axes.set_ylim(*_range(axes, -0.02, 0.3, span=0.02))
    if verdict.floor_contacts:
        _line_legend(axes)


def _margins_panel(axes: Axes, measured: Measured, _: Verdict) -> None:
    """Draw the margins to the support polygon."""
    assert measured.balance is not None
    x, y = thinned(measured.times, measured.balance.center_margin)
    axes.plot(x, y, color=BLUE, lw=1.2, label="centre of mass")
    axes.axhline(0.0, color="black", lw=0.6)
    axes.set_ylim(*_range(axes, -0.4, 0.15, span=0.05))
    _line_legend(axes)


def _forces_panel(axes: Axes, measured: Measured, verdict: Verdict) -> None:
    """Draw vertical forces on links that are ever in contact."""
    found = measured.once(forces)
    colors = (BLUE, PURPLE, GREEN, GREY)
    for color, link in zip(colors, verdict.floor_contacts):
        x, y = thinned(found.times, found.forces[:, found.links.index(link), 2])
        axes.plot(x, y, color=color, lw=1.0, label=link.replace("_link", ""))
    axes.axhline(0.0, color="black", lw=0.6)
    if verdict.floor_contacts:
        _line_legend(axes)


def _missing_panel(axes: Axes, measured: Measured, _: Verdict) -> None:
    """Draw the friction that is needed, that of the links, and what is missing."""
    found = measured.once(forces)
    for values, color, style, label in (
        (found.available_friction, GREY, "--", "friction available"),
        (found.friction, BLUE, "-", "friction needed"),
        (found.missing_share, RED, "-", "missing"),
    ):
        x, y = thinned(found.times, np.where(np.isfinite(values), values, np.nan))
        axes.plot(x, y, color=color, ls=style, lw=1.0, label=label)
    axes.set_ylim(0.0, _range(axes, 0.0, MOST_SHARE, span=0.5)[1])
    _line_legend(axes)


def _depth_panel(axes: Axes, measured: Measured, _: Verdict) -> None:
    """Draw the depth of the deepest self-collision."""
    x, y = thinned(measured.times, 1000.0 * measured.depth)
    axes.fill_between(x, 0.0, y, color=BLUE, alpha=0.6, linewidth=0.0)
    axes.plot(x, y, color=BLUE, lw=0.8)
    axes.set_ylim(0.0, max(5.0, 1.1 * float(y.max())))


def _line_legend(axes: Axes) -> None:
    """Explain lines above a panel, at its right end."""
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncol=4,
        frameon=False,
        fontsize=8,
        borderaxespad=0.1,
    )


def _range(axes: Axes, least: float, most: float, span: float) -> tuple[float, float]:
    """Limit the y axis: outliers would flatten the rest, noise would fill the panel."""
    low, high = axes.get_ylim()
    more = max(0.0, (span - (high - low)) / 2.0)
    return max(low - more, least), min(high + more, most)
