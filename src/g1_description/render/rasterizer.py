"""Triangles drawn into pixels with a depth buffer, in numpy: no GPU and no screen."""

from __future__ import annotations

import numpy as np

NOTHING = -1
"""The number of a pixel without a triangle."""

BATCH = 400_000
"""Pixels of the boxes around triangles that are drawn at once; limits memory."""

EDGE = 1e-6
"""Distance from an edge that still counts as inside, in pixels."""

THIN = 1e-6
"""Twice the area, in pixels, up to which a triangle has no slope and is left out."""


def touching(corners: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """Find the triangles that may cover the centre of a pixel.

    Args:
        corners: Column, row, and reciprocal of the distance from the eye (axis 0) of
            the corners (axis 1) of triangles in front of the eye, shape (3, 3, n). The
            centre of the first pixel is at column and row 0.
        rows: Height of the picture, in pixels.
        columns: Its width, in pixels.

    Returns:
        Their numbers, shape (m,).
    """
    x, y, _ = corners
    left, right = _pixels(x.min(axis=0), x.max(axis=0), columns)
    top, bottom = _pixels(y.min(axis=0), y.max(axis=0), rows)
    is_wide = np.abs(_areas(x, y)) > THIN
    return np.flatnonzero((left <= right) & (top <= bottom) & is_wide)


def nearest(corners: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """Find the nearest triangle at the centre of each pixel, from either side.

    Args:
        corners: Those of triangles found by ``touching``, shape (3, 3, n).
        rows: As for ``touching``.
        columns: As for ``touching``.

    Returns:
        Numbers of triangles, ``NOTHING`` for none, shape (rows, columns).
    """
    x, y, _ = corners
    left, right = _pixels(x.min(axis=0), x.max(axis=0), columns)
    top, bottom = _pixels(y.min(axis=0), y.max(axis=0), rows)
    depth = np.zeros(rows * columns)
    found = np.full(rows * columns, NOTHING)
    pixels = np.cumsum((right - left + 1) * (bottom - top + 1))
    ends = np.flatnonzero(np.diff(pixels // BATCH)) + 1
    for part in np.split(np.arange(len(pixels)), ends):
        number, row = _listed(top[part], bottom[part])
        run, column, near = _covered(corners[:, :, part], number, row, columns)
        pixel, triangle = row[run] * columns + column, part[number[run]]
        while len(pixel):  # of several at a pixel, the last stays for a while
            is_nearer = near > depth[pixel]
            pixel, triangle = pixel[is_nearer], triangle[is_nearer]
            near = near[is_nearer]
            depth[pixel], found[pixel] = near, triangle
    return found.reshape(rows, columns)


def weights(corners: np.ndarray, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Compute how much each corner counts at a point of a triangle.

    Args:
        corners: Those of one triangle per point, as for ``touching``, shape (3, 3, n).
        row: Row of each point, shape (n,).
        column: Column of each point, shape (n,).

    Returns:
        Barycentric coordinates on the triangle in space times a positive number, shape
        (3, n).
    """
    x, y = corners[0] - column, corners[1] - row
    following, last = [1, 2, 0], [2, 0, 1]
    parts = (x[following] * y[last] - x[last] * y[following]) * corners[2]
    return parts * np.sign(_areas(x, y))


def _areas(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Compute twice the signed areas of triangles by corner, shape (3, n)."""
    return (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])


def _pixels(
    low: np.ndarray, high: np.ndarray, size: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the first and the last pixel of a picture whose centre is in a range."""
    first = np.clip(np.ceil(low - EDGE), 0, size).astype(int)
    return first, np.clip(np.floor(high + EDGE), -1, size - 1).astype(int)


def _listed(first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """List the integers of ranges: the number of a range, and one of its integers."""
    counts = np.maximum(last - first + 1, 0)
    number = np.repeat(np.arange(len(counts)), counts)
    begins = first - (np.cumsum(counts) - counts)
    return number, np.arange(len(number)) + begins[number]


def _covered(
    corners: np.ndarray, number: np.ndarray, row: np.ndarray, columns: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find the pixels of triangles in rows: index of the row, column, and nearness."""
    x, y, z = corners
    area = _areas(x, y)
    # Nearness is linear in a picture.
    across = ((z[1] - z[0]) * (y[2] - y[0]) - (z[2] - z[0]) * (y[1] - y[0])) / area
    down = ((x[1] - x[0]) * (z[2] - z[0]) - (x[2] - x[0]) * (z[1] - z[0])) / area
    # On an edge along a row, the row just inside is complete.
    low, high = y.min(axis=0) + EDGE, y.max(axis=0) - EDGE
    level = np.clip(row, low[number], high[number])
    left, right = np.full(len(row), np.inf), np.full(len(row), -np.inf)
    for a, b in ((0, 1), (1, 2), (2, 0)):
        begin, end = y[a, number] - level, y[b, number] - level
        crosses = (begin * end <= 0.0) & (begin != end)
        length = np.where(crosses, begin - end, 1.0)
        at = (x[b, number] * begin - x[a, number] * end) / length
        left = np.where(crosses, np.minimum(left, at), left)
        right = np.where(crosses, np.maximum(right, at), right)
    run, column = _listed(*_pixels(left, right, columns))
    base = (z[0] - across * x[0] - down * y[0])[number] + down[number] * row
    return run, column, base[run] + across[number][run] * column
