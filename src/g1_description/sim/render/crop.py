"""The part of a picture that is drawn, and how OpenGL gets it."""

from __future__ import annotations

from typing import Tuple

import numpy as np

from .camera import Camera

Crop = Tuple[slice, slice]
"""Rows and columns of a picture, none left out in between."""

NEAREST = 0.05
"""How near the eye something can be seen, in distances of the target."""


def crop_around(points: np.ndarray, camera: Camera, width: int, height: int) -> Crop:
    """Find the part of a picture that points are seen in.

    Args:
        points: In the world, in [m], shape (n, 3).
        camera: Where the picture is taken from.
        width: Of the picture, in pixels.
        height: Likewise.

    Returns:
        All pixels between the points and one more on each side; the whole picture
        where a point is beside the eye or behind it.
    """
    if not len(points):
        return slice(0, 0), slice(0, 0)
    back = (points - camera.target) @ camera.axes[2]
    if (back > (1.0 - NEAREST) * camera.range).any():
        return slice(0, height), slice(0, width)
    right, up = camera.seen(points).T * width
    return _covering(height / 2 - up, height), _covering(width / 2 + right, width)


def _covering(places: np.ndarray, size: int) -> slice:
    """Give the pixels that hold all places, of those that there are."""
    ends = np.array([np.floor(places.min()) - 1, np.ceil(places.max()) + 1])
    first, last = np.clip(ends, 0, size).astype(int)
    return slice(int(first), int(last))


def matrices(
    camera: Camera, width: int, height: int, crop: Crop
) -> tuple[tuple[float, ...], ...]:
    """Write a camera as OpenGL's view and projection matrix, column by column.

    PyBullet's renderer has no parallel projection, but one from far away. It takes
    the lower left corner of a pixel for its middle.

    Args:
        camera: The camera.
        width: Of the whole picture, in pixels.
        height: Likewise.
        crop: The part of it that is drawn, not empty.
    """
    view = np.eye(4)
    view[:3, :3] = camera.axes
    view[:3, 3] = -camera.axes @ camera.target - [0.0, 0.0, camera.range]
    depth = min((1.0 - NEAREST) * camera.range, 20.0 * camera.width)
    near, far = camera.range - depth, camera.range + depth
    rows, columns = crop
    pixel = camera.width / width / camera.range
    ends = np.array([columns.start, columns.stop, -rows.stop, -rows.start])
    middle = np.array([width, width, -height, -height]) / 2
    left, right, bottom, top = (ends - middle + 0.5) * pixel
    projection = np.zeros((4, 4))
    projection[0, [0, 2]] = np.array([2.0, right + left]) / (right - left)
    projection[1, [1, 2]] = np.array([2.0, top + bottom]) / (top - bottom)
    projection[2, 2:] = np.array([far + near, 2.0 * far * near]) / (near - far)
    projection[3, 2] = -1.0
    return tuple(view.T.ravel().tolist()), tuple(projection.T.ravel().tolist())
