"""Pictures of a scene: smooth edges, a floor, a shadow; or outlines alone."""

from __future__ import annotations

import numpy as np

from .backdrop import backdrop, softened
from .camera import Camera
from .scene import NOTHING, Scene
from .window import Window

FINER = 3
"""Pixels drawn for one pixel of the picture, in each direction."""

LAMP = np.radians([-38.0, 50.0])
"""Where the lamp is: about z from the camera, and above the floor, in [rad]."""

LAMP_PIXELS = 400
"""Side of the picture that the lamp takes of the robots to find their shadow."""

SOFTNESS = 2
"""How far the edge of a shadow reaches, in pixels of that picture."""


def draw(
    scene: Scene, camera: Camera, width: int, height: int, floor: float = 0.0
) -> np.ndarray:
    """Draw a scene on a floor.

    The floor hides nothing: what is below it is seen.

    Args:
        scene: The robots.
        camera: Where from.
        width: Of the picture, in pixels.
        height: Likewise.
        floor: Its height in the world, in [m].

    Returns:
        Colours as uint8, shape (height, width, 3).
    """
    lamp = _lamp(camera, height / width)
    behind = 255.0 * backdrop(
        camera, width, height, floor, (lamp, _shadow(scene, lamp))
    )
    window = scene.window(camera, width, height)
    fine = FINER * width, FINER * height, _finer(window)
    colors, robots = scene.look(camera, *fine, lamp.axes[2])
    seen = (robots != NOTHING)[..., np.newaxis]
    clear = 1.0 - _coarser(seen)
    behind[window] = behind[window] * clear + _coarser(colors * seen)
    return np.clip(np.round(behind), 0, 255).astype(np.uint8)


def silhouette(scene: Scene, camera: Camera, width: int, height: int) -> np.ndarray:
    """Find which pixels show a robot.

    Args:
        scene: The robots.
        camera: Where from.
        width: Of the picture, in pixels.
        height: Likewise.

    Returns:
        The robot's number, ``NOTHING`` where there is none, shape (height, width).
    """
    window = scene.window(camera, width, height)
    robots = np.full((height, width), NOTHING)
    robots[window] = scene.look(camera, width, height, window)[1]
    return robots


def _finer(window: Window) -> Window:
    """Give the fine pixels of a window."""
    rows, columns = (slice(FINER * w.start, FINER * w.stop) for w in window)
    return rows, columns


def _coarser(pixels: np.ndarray) -> np.ndarray:
    """Take the mean of the fine pixels that become one."""
    height, width, parts = pixels.shape
    fine = pixels.reshape(height // FINER, FINER, width // FINER, FINER, parts)
    return fine.mean(axis=(1, 3), dtype=np.float32)


def _lamp(camera: Camera, aspect: float) -> Camera:
    """Place the lamp on one side of the camera, so that it sees all that this sees.

    Args:
        camera: Where the picture is taken from.
        aspect: Height of the picture over its width.
    """
    width = 1.5 * camera.width * max(1.0, aspect)
    return Camera(camera.target, camera.yaw + LAMP[0], LAMP[1], width)


def _shadow(scene: Scene, lamp: Camera) -> np.ndarray:
    """Find how much of the lamp's light is caught by robots, from 0 to 1."""
    size = LAMP_PIXELS, LAMP_PIXELS
    return softened((silhouette(scene, lamp, *size) != NOTHING).astype(float), SOFTNESS)
