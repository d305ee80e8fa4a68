"""The camera of a picture: projection and framing."""

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
"""Distance that stands for infinity, in widths of the picture."""

LENS = 0.25
"""Half of a picture's height over the distance of a perspective camera."""


@dataclass(frozen=True)
class Camera:
    """A camera that looks at a point, with z upwards in the picture."""

    target: np.ndarray
    """Point in the middle of the picture, in the world, in [m], shape (3,)."""

    yaw: float
    """Direction from the target to the camera, from +x about z, in [rad]: 0 shows the
    front of a robot, pi/2 its left."""

    pitch: float
    """Elevation of the camera above the target, from -pi/2 to pi/2 in [rad]."""

    width: float
    """Width of the picture at the target, in [m]."""

    distance: float = math.inf
    """From the target, in [m]; infinite for an orthographic picture."""

    @property
    def axes(self) -> np.ndarray:
        """Axes to the right, upwards and towards the eye, as rows.

        Returns:
            Rotation from the world to the camera, shape (3, 3).
        """
        sin, cos = math.sin(self.yaw), math.cos(self.yaw)
        right = np.array([-sin, cos, 0.0])
        back = np.array([cos, sin, math.tan(self.pitch)]) * math.cos(self.pitch)
        return np.array([right, np.cross(back, right), back])

    @property
    def range(self) -> float:
        """Distance of the eye from the target, in [m], always finite."""
        return min(self.distance, FAR * self.width)

    def seen(self, points: np.ndarray) -> np.ndarray:
        """Project points to the picture.

        Args:
            points: In the world, in [m], shape (n, 3).

        Returns:
            To the right of and above the middle, in widths, shape (n, 2).
        """
        right, up, back = self.axes @ (points - self.target).T
        scale = self.range / (self.range - back) / self.width
        return np.stack([right * scale, up * scale], axis=-1)

    def rays(self, width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
        """Compute the rays through the centres of the pixels.

        Args:
            width: Width of the picture, in pixels.
            height: Height of the picture, in pixels.

        Returns:
            The eye in the world, shape (3,), and vectors to the plane through the
            target in the world, shape (height, width, 3).
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
        margin: Fraction of width and height that is left free on each side.

    Returns:
        A perspective camera.
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
"""A range of rows and columns of a picture."""

NEAREST = 0.05
"""Distance of the near plane from the eye, relative to that of the target."""


def crop_around(points: np.ndarray, camera: Camera, width: int, height: int) -> Crop:
    """Find the part of a picture that contains points.

    Args:
        points: In the world, in [m], shape (n, 3).
        camera: Where the picture is taken from.
        width: Width of the picture, in pixels.
        height: Height of the picture, in pixels.

    Returns:
        All pixels between the points and one more on each side; the whole picture if a
        point is near the eye or behind it.
    """
    if not len(points):
        return slice(0, 0), slice(0, 0)
    back = (points - camera.target) @ camera.axes[2]
    if (back > (1.0 - NEAREST) * camera.range).any():
        return slice(0, height), slice(0, width)
    right, up = camera.seen(points).T * width
    return _covering(height / 2 - up, height), _covering(width / 2 + right, width)


def _covering(places: np.ndarray, size: int) -> slice:
    """Return the range of existing pixels that contains all positions."""
    ends = np.array([np.floor(places.min()) - 1, np.ceil(places.max()) + 1])
    first, last = np.clip(ends, 0, size).astype(int)
    return slice(int(first), int(last))
