"""Where a picture is taken from, and where in it a point of the world is seen."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Tuple

import numpy as np

VIEWS = {
    "front": (0.0, 0.0),
    "side": (-math.pi / 2, 0.0),
    "back": (math.pi, 0.0),
    "iso": (math.radians(35.0), math.radians(18.0)),
}
"""Yaw and pitch of the views that have a name, in [rad]."""

FAR = 1000.0
"""Distance that is as good as infinite, in widths of the picture."""

LENS = 0.25
"""Half of a picture's height over the distance, where the camera is not far."""


@dataclass(frozen=True)
class Camera:
    """A camera that looks at a point, with z upwards in the picture."""

    target: np.ndarray
    """Point in the middle of the picture, in the world, in [m], shape (3,)."""

    yaw: float
    """Where it stands, seen from the target: from +x about z, in [rad]. 0 sees the
    front of a robot, whose left is on the picture's right; pi/2 sees its left."""

    pitch: float
    """How far it is above the target, from -pi/2 to pi/2 in [rad]."""

    width: float
    """What the width of the picture spans at the target, in [m]."""

    distance: float = math.inf
    """From the target, in [m]; infinite for an orthographic picture."""

    @property
    def axes(self) -> np.ndarray:
        """Axes along the picture's right, its top and towards the eye, as rows.

        Returns:
            Rotation from the world to the camera, shape (3, 3).
        """
        sin, cos = math.sin(self.yaw), math.cos(self.yaw)
        right = np.array([-sin, cos, 0.0])
        back = np.array([cos, sin, math.tan(self.pitch)]) * math.cos(self.pitch)
        return np.array([right, np.cross(back, right), back])

    @property
    def range(self) -> float:
        """Distance of the eye from the target, in [m], finite always."""
        return min(self.distance, FAR * self.width)

    def seen(self, points: np.ndarray) -> np.ndarray:
        """Find where points are in the picture.

        Args:
            points: In the world, in [m], shape (n, 3).

        Returns:
            To the right of and above the middle, in widths, shape (n, 2).
        """
        right, up, back = self.axes @ (points - self.target).T
        scale = self.range / (self.range - back) / self.width
        return np.stack([right * scale, up * scale], axis=-1)

    def rays(self, width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
        """Find the lines of sight through the middles of the pixels.

        Args:
            width: Of the picture, in pixels.
            height: Of the same, in pixels.

        Returns:
            The eye in the world, shape (3,), and directions in the world, as long as
            the way to the plane through the target, shape (height, width, 3).
        """
        right, up, back = self.axes
        pixel = self.width / width
        columns = (np.arange(width) + 0.5 - width / 2) * pixel
        rows = (height / 2 - np.arange(height) - 0.5) * pixel
        across = columns[np.newaxis, :, np.newaxis] * right
        return (
            self.target + self.range * back,
            across + rows[:, np.newaxis, np.newaxis] * up - self.range * back,
        )


def framing(
    points: np.ndarray,
    yaw: float,
    pitch: float,
    aspect: float,
    margin: float = 0.06,
) -> Camera:
    """Place a camera so that points fill its picture.

    Args:
        points: In the world, in [m], shape (n, 3).
        yaw: As ``Camera`` has it, in [rad].
        pitch: As ``Camera`` has it, in [rad].
        aspect: Width of the picture over its height.
        margin: Share of width and height that is left free on each side.

    Returns:
        A camera near enough to show perspective.
    """
    target = (points.min(axis=0) + points.max(axis=0)) / 2
    axes = Camera(target, yaw, pitch, 1.0).axes
    right, up, back = axes @ (points - target).T
    target = target + (right.max() + right.min()) / 2 * axes[0]
    target = target + (up.max() + up.min()) / 2 * axes[1]
    right, up, back = axes @ (points - target).T
    reach = np.maximum(np.abs(right) / aspect, np.abs(up))
    slope = LENS * (1.0 - 2.0 * margin)
    distance = float((back + reach / slope).max())
    return Camera(target, yaw, pitch, 2.0 * distance * LENS * aspect, distance)


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
        height: Of the same, in pixels.

    Returns:
        All pixels between the points and one more on each side; the whole picture
        where a point is next to the eye or behind it.
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
        height: Of the same, in pixels.
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
