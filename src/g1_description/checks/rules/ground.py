"""The robot and its floor: penetration, floating, skating, drift and balance."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from g1_description.checks.ground_samples import GroundSamples, drifts
from g1_description.checks.intervals import runs
from g1_description.checks.measured import Measured
from g1_description.checks.rule import Rule
from g1_description.checks.rules.forces import unknown_forces
from g1_description.checks.rules.jumps import near_jumps
from g1_description.checks.thresholds import Level
from g1_description.checks.verdict import BY_TIME, Finding

MOVING = 0.1
"""A link that drifts moves where it is faster than this fraction of its fastest."""


OUTSIDE = "{worst:.4g} m outside the support polygon{when}"


def slides(measured: Measured) -> np.ndarray:
    """Compute the speeds of sliding links in [m/s], NaN for others, shape (n, k)."""
    is_unknown = measured.once(near_jumps).body
    ground, samples = measured.robot.ground, _ground(measured)
    speeds = ground.sliding(samples, measured.times, is_unknown)
    return np.where(samples.collides, np.nan, speeds)


def _ground(measured: Measured) -> GroundSamples:
    """Return the measurements of the ground."""
    assert measured.ground is not None
    return measured.ground


def _below(measured: Measured, column: int | np.ndarray, sizes: np.ndarray) -> str:
    """Name what is below a link where a size is the largest.

    Args:
        measured: The motion.
        column: Column of ``ground_links``, or that of each time, shape (n,).
        sizes: Sizes at all times, shape (n,).
    """
    below, around = _ground(measured).below, measured.surroundings
    if below is None or around is None or np.isnan(sizes).all():
        return "the floor"
    at = int(np.nanargmax(sizes))
    row = below[at, np.broadcast_to(column, len(sizes))[at]]
    return "the floor" if row < 0 else around.surfaces.names[row]


def _penetrations(rule: Rule, measured: Measured) -> Iterator[Finding | None]:
    """Find links in the floor."""
    samples = _ground(measured)
    is_low = samples.in_contact | ~np.isnan(measured.once(slides))
    for column in np.flatnonzero(is_low.any(axis=0)).tolist():
        link, points = measured.ground_links[column], samples.lowest[:, column]
        is_floor = ~samples.collides[:, column]
        sizes = np.where(is_floor, -samples.heights[:, column], np.nan)
        floor = _below(measured, column, sizes)
        text = f"{link} penetrates {floor} by {{worst:.4g}} m{{when}}"
        yield rule.compared(measured, (link,), sizes, text, points=points)


def _skating(rule: Rule, measured: Measured) -> Iterator[Finding | None]:
    """Find links that slide on the floor."""
    lowest, speeds = _ground(measured).lowest, measured.once(slides)
    for column in rule.columns(measured, speeds):
        link, points = measured.ground_links[column], lowest[:, column]
        floor = _below(measured, column, speeds[:, column])
        text = f"{link} slides on {floor} at {{worst:.4g}} m/s{{when}}"
        yield rule.compared(measured, (link,), speeds[:, column], text, points=points)


def _drifts(rule: Rule, measured: Measured) -> Iterator[Finding | None]:
    """Find links that do not stay where they touched the floor.

    Findings of ``skating`` do not count.
    """
    samples, speeds = _ground(measured), measured.once(slides)
    is_slow = ~SKATING.exceeds(speeds, SKATING.lowest(measured.robot.thresholds))
    is_slow[:-1] &= is_slow[1:]
    touches = ~np.isnan(speeds)
    sizes = drifts(samples.steps * is_slow[..., np.newaxis], touches)
    for column in rule.columns(measured, sizes):
        link, points = measured.ground_links[column], samples.lowest[:, column]
        whole = np.full(len(sizes), np.nan)  # of a contact, while the link moves
        for first, last in runs(touches[:, column]):
            rows = slice(first, last + 1)
            speed = speeds[rows, column]
            is_moving = speed > MOVING * speed.max()
            whole[rows] = np.where(is_moving, sizes[rows, column].max(), np.nan)
        floor = _below(measured, column, sizes[:, column])
        text = f"{link} drifts {{worst:.4g}} m while it touches {floor}{{when}}"
        yield rule.compared(
            measured, (link,), sizes[:, column], text, points=points, spans=whole
        )


def _floating(rule: Rule, measured: Measured) -> Iterator[Finding | None]:
    """Find links that support the robot above the floor, and a robot in the air."""
    samples = _ground(measured)
    heights = np.where(samples.in_contact, samples.heights, np.nan)
    for column in rule.columns(measured, heights):
        link, points = measured.ground_links[column], samples.lowest[:, column]
        floor = _below(measured, column, heights[:, column])
        text = f"{link} hovers {{worst:.4g}} m above {floor} as a support{{when}}"
        yield rule.compared(measured, (link,), heights[:, column], text, points=points)
    lowest = np.argmin(samples.heights, axis=1)
    points = samples.lowest[np.arange(len(lowest)), lowest]
    sizes = _float_heights(measured)
    floor = _below(measured, lowest, sizes)
    text = f"the robot floats {{worst:.4g}} m above {floor}{{when}}"
    yield rule.compared(measured, (), sizes, text, points=points)


def _float_heights(measured: Measured) -> np.ndarray:
    """Compute the height of a robot in the air where its forces are unknown.

    Returns:
        Height of the lowest point in [m], NaN where the robot stands, shape (n,).
    """
    heights = _ground(measured).heights.min(axis=1)
    floats = heights > measured.robot.thresholds.support_height
    why = unknown_forces(measured.robot, measured.motion)
    floats &= len(heights) == 1 or bool(why)
    return np.where(floats, heights, np.nan)


def _center_of_mass(rule: Rule, measured: Measured) -> Iterator[Finding | None]:
    """Find the centre of mass outside, while the robot is still."""
    balance = measured.balance
    assert balance is not None
    below = balance.center.copy()
    below[:, 2] = measured.floor
    sizes = np.where(balance.is_still, -balance.center_margin, np.nan)
    text = f"centre of mass {OUTSIDE}"
    yield rule.compared(measured, (), sizes, text, points=below)


PENETRATION = Rule(
    name="penetration",
    grouping=BY_TIME,
    about="links that penetrate the floor",
    level=Level(0.006, 0.01),
    limit="m, depth in the floor; more than the 5 mm of some retargeters",
    unit="m",
    find=_penetrations,
    needs=("ground",),
    requires="base",
    namespace="floor",
    label="{subject} in the floor",
)
FLOATING = Rule(
    name="floating",
    about="links that support the robot without touching the floor; a robot in "
    "the air whose forces are unknown",
    level=Level(0.015, 0.03),
    limit="m above the floor",
    unit="m",
    find=_floating,
    needs=("ground",),
    requires="base",
    only_at_rest=True,
    namespace="floor",
    label="{subject} above the floor",
)
SKATING = Rule(
    name="skating",
    grouping=BY_TIME,
    about="links that slide while they touch the floor",
    level=Level(0.08, 0.15),
    limit="m/s along the floor",
    unit="m/s",
    find=_skating,
    needs=("ground",),
    requires="base",
)
DRIFT = Rule(
    name="drift",
    grouping=BY_TIME,
    about="links that slip during one contact, more slowly than `skating` finds",
    level=Level(0.02, 0.05),
    limit="m along the floor, in one contact",
    unit="m",
    find=_drifts,
    needs=("ground",),
    requires="base",
    is_live=False,
)
CENTER_OF_MASS = Rule(
    name="center_of_mass",
    about="the centre of mass outside the support polygon, while the robot is still",
    level=Level(None, 0.0),
    limit="m outside the support polygon, while still",
    unit="m",
    find=_center_of_mass,
    needs=("ground", "balance"),
    requires="base",
    only_at_rest=True,
)
