"""Where a picture is taken from, and where in it a point of the world is seen."""

from __future__ import annotations

import math
from dataclasses import dataclass

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
            height: Likewise.

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
        pitch: Likewise.
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
