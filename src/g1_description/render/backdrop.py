"""The background of pictures: air, and a floor with a grid and shadows."""

from __future__ import annotations

import numpy as np

from g1_description.render.camera import Camera

AIR = np.array([[0.99, 0.99, 0.995], [0.91, 0.925, 0.94]])
"""Colours of the top and the bottom of a picture, from 0 to 1."""

CELL = 0.25
"""Width of a cell of the grid, in [m]."""

LINE = 0.004
"""Width of a line of the grid, in [m]."""

LINES_DARKEN, SHADOW_DARKENS = 0.13, 0.42
"""Darkening of the floor by lines and shadows."""


def backdrop(
    camera: Camera,
    width: int,
    height: int,
    floor: float,
    shadow: tuple[Camera, np.ndarray],
) -> np.ndarray:
    """Draw the background and the floor.

    Args:
        camera: The camera.
        width: Width of the picture, in pixels.
        height: Height of the picture, in pixels.
        floor: Height of the floor in the world, in [m].
        shadow: Camera at the lamp, and the blocked fraction of its light in each of its
            pixels, from 0 to 1, shape (n, m).

    Returns:
        Colours from 0 to 1, shape (height, width, 3).
    """
    blend = np.linspace(0.0, 1.0, height)[:, np.newaxis, np.newaxis]
    air = AIR[0] + (AIR[1] - AIR[0]) * blend + np.zeros((1, width, 1))
    eye, rays = camera.rays(width, height)
    with np.errstate(divide="ignore", invalid="ignore"):
        way = (floor - eye[2]) / rays[..., 2]
        is_floor = (way > 0.0) & (way < 20.0)
    points = eye + np.where(is_floor, way, 1.0)[..., np.newaxis] * rays
    darker = LINES_DARKEN * _grid(points, is_floor)
    darker = 1.0 - (1.0 - darker) * (1.0 - SHADOW_DARKENS * _shadow_at(points, *shadow))
    across = np.linalg.norm(points[..., :2] - camera.target[:2], axis=-1)
    fade = np.where(is_floor, np.exp(-((across / camera.width) ** 2)), 0.0)
    return air * (1.0 - fade * darker)[..., np.newaxis]


def _grid(points: np.ndarray, is_floor: np.ndarray) -> np.ndarray:
    """Compute the fraction of each pixel that grid lines cover."""
    clear = np.ones(points.shape[:2])
    for axis in (0, 1):
        values = points[..., axis]
        pixel = np.hypot(*np.gradient(values)) + 1e-9
        off = np.abs(values - CELL * np.round(values / CELL))
        line = np.maximum(LINE, pixel)
        covered = np.clip(0.5 + (line / 2 - off) / pixel, 0.0, 1.0) * LINE / line
        clear *= 1.0 - np.where(pixel < CELL / 2, covered, 0.0)
    return np.where(is_floor, 1.0 - clear, 0.0)


def _shadow_at(points: np.ndarray, lamp: Camera, shadow_mask: np.ndarray) -> np.ndarray:
    """Compute the fraction of the lamp's light that robots block.

    Args:
        points: In the world, in [m], shape (height, width, 3).
        lamp: Camera at the lamp.
        shadow_mask: Blocked fraction in each of its pixels, shape (n, m).
    """
    n, m = shadow_mask.shape
    seen = lamp.seen(points.reshape(-1, 3)) * m
    column, row = seen[:, 0] + m / 2 - 0.5, n / 2 - 0.5 - seen[:, 1]
    inside = (column >= 0) & (column < m - 1) & (row >= 0) & (row < n - 1)
    column, row = np.where(inside, column, 0.0), np.where(inside, row, 0.0)
    i, j = row.astype(int), column.astype(int)
    down, right = row - i, column - j
    top = shadow_mask[i, j] * (1 - right) + shadow_mask[i, j + 1] * right
    bottom = shadow_mask[i + 1, j] * (1 - right) + shadow_mask[i + 1, j + 1] * right
    fractions = np.where(inside, top * (1 - down) + bottom * down, 0.0)
    return fractions.reshape(points.shape[:2])


def blur(fractions: np.ndarray, reach: int) -> np.ndarray:
    """Blur a picture with a box filter, three times.

    Args:
        fractions: Shape (n, m).
        reach: Half of the square's side, in pixels.

    Returns:
        Shape (n, m); pixels outside count as 0.
    """
    side = 2 * reach + 1
    for _ in range(3):
        for _ in ("down", "across"):
            sums = np.cumsum(np.pad(fractions, ((reach + 1, reach), (0, 0))), axis=0)
            fractions = ((sums[side:] - sums[:-side]) / side).T
    return fractions
