"""Triangles drawn into pixels with a depth buffer, in numpy: no GPU and no screen."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

AMBIENT, DIFFUSE, SPECULAR = 0.72, 0.55, 0.06
"""Coefficients of ambient, diffuse and specular light."""

SMALLEST = 4
"""Side of the smallest squares in which triangles are drawn, in pixels."""

BATCH = 100_000
"""Pixels that are tested at once: their arrays fit into a cache."""

EDGE = 1e-9
"""Barycentric coordinate outside of an edge that still counts as on it."""


class Triangles(NamedTuple):
    """Triangles to be drawn."""

    corners: np.ndarray
    """Column, row and reciprocal of the distance from the eye, shape (n, 3, 3)."""

    normals: np.ndarray
    """At the corners, in the world, shape (n, 3, 3)."""

    colors: np.ndarray
    """From 0 to 255, shape (n, 3)."""

    owners: np.ndarray
    """Numbers that ``draw`` gives to pixels, shape (n,)."""


def draw(
    found: Triangles, rows: int, columns: int, light: np.ndarray, nothing: int
) -> tuple[np.ndarray, np.ndarray]:
    """Draw triangles; the nearest one counts, from either side.

    Args:
        found: The triangles, all in front of the eye.
        rows: Height of the picture, in pixels.
        columns: Its width; the centre of the first pixel is at column and row 0.
        light: Direction to the lamp in the world, shape (3,).
        nothing: The number of a pixel without a triangle.

    Returns:
        Colours as uint8, shape (rows, columns, 3), and numbers, shape (rows, columns).
    """
    depth = np.zeros(rows * columns)
    nearest = np.full(rows * columns, -1)
    planes = _planes(found.corners)
    for triangle, row, column, near in _covered(found.corners, planes, rows, columns):
        pixel = row * columns + column
        is_nearer = near > depth[pixel]
        triangle, pixel, near = triangle[is_nearer], pixel[is_nearer], near[is_nearer]
        order = np.argsort(near, kind="stable")  # of a pixel's triangles the last stays
        depth[pixel[order]] = near[order]
        nearest[pixel[order]] = triangle[order]
    seen = np.flatnonzero(nearest >= 0)
    colors = np.zeros((rows * columns, 3), np.uint8)
    owners = np.full(rows * columns, nothing)
    row, column = divmod(seen, columns)
    colors[seen] = _shaded(found, planes, nearest[seen], row, column, light)
    owners[seen] = found.owners[nearest[seen]]
    return colors.reshape(rows, columns, 3), owners.reshape(rows, columns)


def _planes(corners: np.ndarray) -> np.ndarray:
    """Compute what of pixels' barycentric coordinates belongs to column, row and 1.

    Returns:
        For each corner, shape (n, 3, 3); without area all are outside.
    """
    x, y = corners[:, :, 0], corners[:, :, 1]
    following, last = [1, 2, 0], [2, 0, 1]
    across, down = y[:, following] - y[:, last], x[:, last] - x[:, following]
    one = x[:, following] * y[:, last] - x[:, last] * y[:, following]
    planes = np.stack([across, down, one], axis=-1)
    area = one.sum(axis=1)
    planes[area == 0.0] = [0.0, 0.0, -1.0]
    return planes / np.where(area == 0.0, 1.0, area)[:, np.newaxis, np.newaxis]


def _covered(
    corners: np.ndarray, planes: np.ndarray, rows: int, columns: int
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """Yield pixels whose centres triangles cover: triangle, row, column, nearness.

    Triangles of about the same size are tested together, in squares around them.
    """
    limits = np.array([columns, rows]) - 1
    low = np.clip(np.ceil(corners[:, :, :2].min(axis=1)), 0, limits + 1).astype(int)
    high = np.clip(np.floor(corners[:, :, :2].max(axis=1)), -1, limits).astype(int)
    sides = high - low + 1
    # Nearness is linear in a picture.
    slopes = (planes * corners[:, :, 2:]).sum(axis=1)
    left = np.flatnonzero((sides > 0).all(axis=1))
    side = SMALLEST
    while len(left):
        fits = (sides[left] <= side).all(axis=1)
        some, left = left[fits], left[~fits]
        step = max(1, BATCH // side**2)
        for first in range(0, len(some), step):
            part = some[first : first + step]
            column = low[part, 0, np.newaxis] + np.arange(side)
            row = low[part, 1, np.newaxis] + np.arange(side)
            inside = (row <= high[part, 1, np.newaxis])[:, :, np.newaxis] & (
                column <= high[part, 0, np.newaxis]
            )[:, np.newaxis]
            for across, down, one in np.moveaxis(planes[part], 0, -1):
                begin = across * column.T + one
                inside &= (
                    begin.T[:, np.newaxis] + (down * row.T).T[:, :, np.newaxis] >= -EDGE
                )
            number, y, x = np.nonzero(inside)
            y, x = row[number, y], column[number, x]
            slope = slopes[part[number]]
            yield part[number], y, x, slope[:, 0] * x + slope[:, 1] * y + slope[:, 2]
        side *= 2


def _shaded(
    found: Triangles,
    planes: np.ndarray,
    triangle: np.ndarray,
    row: np.ndarray,
    column: np.ndarray,
    light: np.ndarray,
) -> np.ndarray:
    """Compute the colours of pixels, each of one triangle; shape (n, 3)."""
    # Anything but nearness is linear after a product with it.
    of_corners = planes * found.corners[:, :, 2:]
    of_normals = np.einsum("ncp,nck->npk", of_corners, found.normals)[triangle]
    normals = of_normals[:, 0] * column[:, np.newaxis]
    normals += of_normals[:, 1] * row[:, np.newaxis]
    normals += of_normals[:, 2]
    lengths = np.sqrt(np.einsum("nk,nk->n", normals, normals))
    bright = np.maximum(normals @ light / np.maximum(lengths, 1e-300), 0.0)
    intensity = AMBIENT + SPECULAR + DIFFUSE * bright
    return np.minimum(found.colors[triangle] * intensity[:, np.newaxis], 255.0)
