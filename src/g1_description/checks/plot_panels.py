"""The panels of a picture of a motion, one function each."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from g1_description.checks.measured import Measured
from g1_description.checks.verdict import FAILED, WARNING, Finding, Verdict
from g1_description.robot.description import Joint

MAX_BINS = 1200
"""Number of bins of a long series: a picture has no more columns of pixels."""

LEAST_WIDTH = 0.003
"""Least width of a marked time, as a fraction of the panel's."""


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


BLUE, GREEN, PURPLE, GREY = "#0072B2", "#009E73", "#CC79A7", "#777777"
LIMITS = "#EBEBEB"
COLORS = {FAILED: "#D55E00", WARNING: "#E8C000"}
"""Colour-blind safe, by Okabe and Ito; the yellow is darker."""

SHADE = 0.45
"""Opacity of a marked time."""

HALF = 0.42
"""Half the height of a strip between the limits of its joint; strips are 1 apart."""

MOST_BEYOND = 1.35
"""A joint is drawn up to this multiple of its limits."""

MAX_LABEL = 52
"""Longest label of a row, in characters."""

MAX_ROWS = 14
"""Largest number of findings with a row of their own."""


def shade(
    axes: Axes,
    verdict: Verdict,
    checks: Sequence[str],
    times: np.ndarray,
) -> None:
    """Mark the times of findings over the whole height; failures on top.

    Args:
        axes: Axes of the panel.
        verdict: Its findings are shown.
        checks: Names of the checks.
        times: Times of the motion in [s], shape (n,).
    """
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


def joint_strips(
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


def strips_legend(axes: Axes) -> None:
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


def findings_panel(axes: Axes, verdict: Verdict, times: np.ndarray) -> None:
    """Draw when each finding exceeds its threshold, a row for each."""
    shown = verdict.findings[:MAX_ROWS]
    for row, finding in enumerate(shown):
        spans = bars(finding.intervals, times)
        color = COLORS[finding.severity]
        axes.broken_barh(spans, (row - 0.38, 0.76), color=color, linewidth=0.0)
    names = [_label(finding) for finding in shown]
    more = len(verdict.findings) - len(shown)
    if more:
        names.append(f"and {more} more")
    axes.set_yticks(range(len(names)))
    axes.set_yticklabels(names)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.grid(axis="x", color="#DDDDDD", lw=0.6)
    axes.set_axisbelow(True)


SLIDING = ("skating", "drift")
"""Checks whose findings are drawn over the contacts."""


def contacts_panel(axes: Axes, measured: Measured, verdict: Verdict) -> None:
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


def heights_panel(axes: Axes, measured: Measured, verdict: Verdict) -> None:
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


def margins_panel(axes: Axes, measured: Measured) -> None:
    """Draw the margins to the support polygon."""
    assert measured.balance is not None
    lines = (
        ("zero-moment point", measured.balance.zmp_margin, PURPLE, 0.8),
        ("centre of mass", measured.balance.center_margin, BLUE, 1.2),
    )
    for label, margin, color, width in lines:
        x, y = thinned(measured.times, margin)
        axes.plot(x, y, color=color, lw=width, label=label)
    axes.axhline(0.0, color="black", lw=0.6)
    axes.set_ylim(*_range(axes, -0.4, 0.15, span=0.05))
    _line_legend(axes)


def depth_panel(axes: Axes, measured: Measured) -> None:
    """Draw the depth of the deepest self-collision."""
    x, y = thinned(measured.times, 1000.0 * measured.depth)
    axes.fill_between(x, 0.0, y, color=BLUE, alpha=0.6, linewidth=0.0)
    axes.plot(x, y, color=BLUE, lw=0.8)
    axes.set_ylim(0.0, max(5.0, 1.1 * float(y.max())))


def _label(finding: Finding) -> str:
    """Name a finding, with at most ``MAX_LABEL`` characters."""
    text = f"{finding.check}  {finding.name.replace('_link', '')}".strip()
    return text if len(text) <= MAX_LABEL else f"{text[: MAX_LABEL - 3]}..."


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
