"""Distances from outlines and sections: the fields that bodies are cut out of."""

import numpy as np
from scipy.optimize import brentq
from scipy.special import gamma

SHARPEST = 20.0
"""Exponent of the superellipse that counts as a rectangle."""


def outline_distance(rings, points):
    """Tell how far points are from an outline.

    Args:
        rings: Corners of closed polygons in [m], shapes (n, 2); what lies inside an odd
            number of them is inside.
        points: Shape (m, 2), in [m].

    Returns:
        Distances in [m], negative inside, shape (m,).
    """
    squared = np.full(len(points), np.inf)
    inside = np.zeros(len(points), dtype=bool)
    for ring in rings:
        corners = np.asarray(ring, dtype=float)
        for start, end in zip(corners, np.roll(corners, -1, axis=0)):
            squared = np.minimum(squared, _squared_distance(points, start, end))
            inside ^= _crosses(points, start, end)
    return np.where(inside, -1.0, 1.0) * np.sqrt(squared)


def _squared_distance(points, start, end):
    """Tell how far points are from an edge, squared."""
    edge = end - start
    along = np.clip((points - start) @ edge / (edge @ edge), 0.0, 1.0)
    return ((points - start - along[:, np.newaxis] * edge) ** 2).sum(axis=1)


def _crosses(points, start, end):
    """Tell for which points a ray along the first axis crosses an edge."""
    spans = (start[1] <= points[:, 1]) != (end[1] <= points[:, 1])
    if not spans.any():
        return spans
    share = (points[:, 1] - start[1]) / (end[1] - start[1])
    return spans & (points[:, 0] < start[0] + share * (end[0] - start[0]))


def loft_distance(sections, station, a, b):
    """Tell how far points are from a loft of superellipses, along rays from its middle.

    Args:
        sections: Station, centre a and b, half width a and b, all in [m], and the share
            of its rectangle that each section fills, shape (n, 6).
        station: Where along the loft, shape (k, 1, 1), in [m].
        a: Across the loft, shape (1, m, n), in [m].
        b: The other way across.

    Returns:
        Distances in [m], negative inside, shape (k, m, n). The first and the last
        section go on for ever.
    """
    sections = np.asarray(sections, dtype=float)
    inverse = [1.0 / exponent(fill) for fill in sections[:, 5]]
    columns = [*sections[:, 1:5].T, np.array(inverse)]
    middle_a, middle_b, half_a, half_b, inverse = (
        np.interp(station, sections[:, 0], column) for column in columns
    )
    way = np.hypot(a - middle_a, b - middle_b)
    powers = (np.abs(a - middle_a) / half_a) ** (1.0 / inverse)
    powers = powers + (np.abs(b - middle_b) / half_b) ** (1.0 / inverse)
    scale = np.maximum(powers**inverse, 1e-9)  # 1 on the section's edge
    return np.where(way > 1e-9, way * (1.0 - 1.0 / scale), -np.minimum(half_a, half_b))


def exponent(fill):
    """Find the superellipse that fills a share of its rectangle.

    |x|^n + |y|^n <= 1 has the area 4 gamma(1 + 1/n)^2 / gamma(1 + 2/n).

    Args:
        fill: From 0.5, a rhombus, to 1, a rectangle; pi / 4 is an ellipse.

    Returns:
        Its exponent n.
    """

    def too_full(n):
        return gamma(1.0 + 1.0 / n) ** 2 / gamma(1.0 + 2.0 / n) - fill

    if too_full(1.0) >= 0.0:
        return 1.0
    return brentq(too_full, 1.0, SHARPEST) if too_full(SHARPEST) > 0.0 else SHARPEST
