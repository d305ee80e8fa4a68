"""Balance: the support polygon, and the margins of the robot's weight inside it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Sequence, Tuple

import numpy as np

from g1_description.checks.intervals import without_short

STILL_TIME = 0.2
"""Shortest standstill in which the centre of mass is checked, in [s]."""

LEAST_FORCE = 0.1
"""Fraction of its weight below which a robot has no zero-moment point."""


@dataclass(frozen=True, eq=False)
class Balance:
    """Where the weight of a robot acts, at each of some samples."""

    center: np.ndarray
    """Centre of mass in the map, in [m], shape (n, 3)."""

    center_margin: np.ndarray
    """Distance of the centre of mass inside the support polygon in [m], shape (n,)."""

    is_still: np.ndarray
    """Where the robot is still, shape (n,)."""


Corners = Sequence[Tuple[float, float]]
"""Corners of a convex polygon, counter-clockwise, in [m]. Plain numbers: numpy takes
five times as long for the six corners of two feet."""


def support_polygon(points: np.ndarray) -> Corners:
    """Find the convex hull of points in a plane.

    Andrew's monotone chain, 1979.

    Args:
        points: In [m], shape (n, 2), n > 0.

    Returns:
        Its corners; one or two where all points are at one place or on one line.
    """
    ordered = sorted({(x, y) for x, y in points.tolist()})
    if len(ordered) < 3:
        return ordered
    lower, upper = _chain(ordered), _chain(ordered[::-1])
    return lower[:-1] + upper[:-1]


def _chain(ordered: Corners) -> list[tuple[float, float]]:
    """Keep the points of one side of a hull."""
    kept: list[tuple[float, float]] = []
    for x, y in ordered:
        while len(kept) > 1:
            (x0, y0), (x1, y1) = kept[-2:]
            if (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) > 0.0:
                break
            kept.pop()
        kept.append((x, y))
    return kept


def support_margin(polygon: Corners, x: float, y: float) -> float:
    """Compute the distance of a point inside a polygon.

    Args:
        polygon: Its corners.
        x: X of the point, in [m].
        y: Y of the point, in [m].

    Returns:
        Distance to its border in [m], negative outside.
    """
    nearest, is_inside = math.inf, len(polygon) > 2
    (x0, y0) = polygon[-1]
    for x1, y1 in polygon:
        edge_x, edge_y, to_x, to_y = x1 - x0, y1 - y0, x - x0, y - y0
        square = edge_x * edge_x + edge_y * edge_y
        along = (to_x * edge_x + to_y * edge_y) / square if square > 0.0 else 0.0
        along = min(max(along, 0.0), 1.0)
        distance = math.hypot(to_x - along * edge_x, to_y - along * edge_y)
        nearest = min(nearest, distance)
        is_inside = is_inside and edge_x * to_y - edge_y * to_x >= 0.0
        x0, y0 = x1, y1
    return nearest if is_inside else -nearest


def nearest_point(polygon: Corners, x: float, y: float) -> np.ndarray:
    """Find the point of a polygon's border that is nearest to another one, in [m]."""
    ends = np.array(polygon)
    along, to = np.roll(ends, -1, axis=0) - ends, np.array([x, y]) - ends
    square = np.maximum((along**2).sum(axis=1), 1e-12)
    part = np.clip((to * along).sum(axis=1) / square, 0.0, 1.0)
    places = ends + part[:, np.newaxis] * along
    return np.asarray(places[np.hypot(*(places - [x, y]).T).argmin()])


def margins(support: Sequence[np.ndarray], points: np.ndarray) -> np.ndarray:
    """Compute the distances of points inside the support polygon.

    Args:
        support: Points of contact, shape (k, 2) per sample.
        points: In the map, in [m], shape (n, 2).

    Returns:
        In [m], negative outside, shape (n,); NaN where nothing supports the robot.
    """
    found = np.full(len(support), np.nan)
    for row, (corners, (x, y)) in enumerate(zip(support, points.tolist())):
        if len(corners):
            found[row] = support_margin(support_polygon(corners), x, y)
    return found


def zero_moment_point(wrench: np.ndarray, weight: float, floor: float) -> np.ndarray:
    """Find where the floor must support a robot that moves.

    Source: Vukobratovic and Borovac, Zero-Moment Point, 2004: the point of the floor
    about which the wrench of gravity and inertia has no horizontal moment.

    Args:
        wrench: External wrench besides gravity: force, and moment about the map's
            origin, in [N] and [N m], shape (6,).
        weight: Weight of the robot in [N].
        floor: Height of the floor in [m].

    Returns:
        Along the map's x and y, in [m], shape (2,); NaN where the floor supports next
        to nothing.
    """
    force, moment = wrench[:3], wrench[3:]
    up = force[2] if force[2] > LEAST_FORCE * weight else np.nan
    x = (floor * force[0] - moment[1]) / up
    y = (floor * force[1] + moment[0]) / up
    return np.stack([x, y])


def long_still(times: np.ndarray, is_still: np.ndarray) -> np.ndarray:
    """Ignore moments of standstill, as at the turn of a movement.

    Args:
        times: Times of the samples in [s], shape (n,).
        is_still: Where the robot is still, shape (n,).
    """
    return without_short(times, is_still, STILL_TIME)
