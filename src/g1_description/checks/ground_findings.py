"""What is wrong with a robot on its floor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from g1_description.checks.ground import GroundFrames
from g1_description.checks.verdict import Fault, runs
from g1_description.robot.dynamics import GRAVITY

FREE_FALL = 0.5
"""Share of gravity from which on a robot in the air falls, instead of floating."""

SHORTEST_FLIGHT = 0.1
"""A robot in the air for a shorter time is not judged, in [s]: its acceleration cannot
be told from noise."""


def ground_faults(
    names: Sequence[str],
    frames: GroundFrames,
    slides: np.ndarray,
    airborne: np.ndarray,
) -> list[Fault]:
    """Find what is wrong with a robot on its floor.

    Args:
        names: Of the links with outlines.
        frames: How it stands at each sample.
        slides: How fast links slide that touch the floor, shape (n, n_links).
        airborne: What ``float_heights`` returned, shape (n,).

    Returns:
        Depths of links in the floor, heights and speeds of those that bear, and the
        height of a robot that floats.
    """
    faults = []
    is_low = frames.bears | ~np.isnan(slides)
    for column in np.flatnonzero(is_low.any(axis=0)):
        link, heights = (names[column],), frames.heights[:, column]
        points = frames.lowest[:, column]
        text = f"{link[0]} is {{worst:.4g}} m deep in the floor at {{time:.3f}} s"
        faults.append(Fault("penetration", link, -heights, "m", text, points))
        text = f"{link[0]} slides on the floor with {{worst:.4g}} m/s at {{time:.3f}} s"
        faults.append(Fault("skating", link, slides[:, column], "m/s", text, points))
        high = np.where(frames.bears[:, column], heights, np.nan)
        text = f"{link[0]} bears {{worst:.4g}} m above the floor at {{time:.3f}} s"
        faults.append(Fault("floating", link, high, "m", text, points))
    text = "the robot floats {worst:.4g} m above the floor at {time:.3f} s"
    lowest = np.argmin(frames.heights, axis=1)
    points = frames.lowest[np.arange(len(lowest)), lowest]
    faults.append(Fault("floating", (), airborne, "m", text, points))
    return faults


def float_heights(
    heights: np.ndarray,
    center_heights: np.ndarray,
    times: np.ndarray,
    bearing_height: float,
) -> np.ndarray:
    """Find how high a robot floats, which is in the air and does not fall.

    Args:
        heights: Of its lowest point above the floor in [m], shape (n,).
        center_heights: Of its centre of mass in [m], shape (n,).
        times: Of the samples in [s], shape (n,).
        bearing_height: Up to which it bears, in [m].

    Returns:
        The heights; NaN where it bears or falls, shape (n,).
    """
    floats = np.full(len(times), np.nan)
    in_air = heights > bearing_height
    if len(times) == 1:
        return np.where(in_air, heights, np.nan)
    for first, last in runs(in_air):
        rows = slice(first, last + 1)
        if times[last] - times[first] >= SHORTEST_FLIGHT and last - first > 1:
            elapsed = times[rows] - times[first]
            curve = np.polyfit(elapsed, center_heights[rows], 2)[0]
            if 2.0 * curve > -FREE_FALL * GRAVITY:
                floats[rows] = heights[rows]
    return floats
