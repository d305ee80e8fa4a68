"""Pictures of a scene: smooth edges, a floor, a shadow; or outlines alone."""

from __future__ import annotations

import numpy as np

from .backdrop import backdrop, blur
from .camera import Camera
from .crop import Crop
from .scene import NOTHING, Scene

SUPERSAMPLING = 3
"""Pixels drawn for one pixel of the picture, in each direction."""

LAMP = np.radians([-38.0, 50.0])
"""Where the lamp is: about z from the camera, and above the floor, in [rad]."""

LAMP_PIXELS = 400
"""Side of the picture that the lamp takes of the robots to find their shadow."""

SHADOW_BLUR = 2
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
        camera, width, height, floor, (lamp, _shadow_mask(scene, lamp))
    )
    crop = scene.crop(camera, width, height)
    fine = SUPERSAMPLING * width, SUPERSAMPLING * height, _supersampled(crop)
    colors, robots = scene.render(camera, *fine, lamp.axes[2])
    seen = (robots != NOTHING)[..., np.newaxis]
    clear = 1.0 - _downsampled(seen)
    behind[crop] = behind[crop] * clear + _downsampled(colors * seen)
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
    crop = scene.crop(camera, width, height)
    robots = np.full((height, width), NOTHING)
    robots[crop] = scene.render(camera, width, height, crop)[1]
    return robots


def _supersampled(crop: Crop) -> Crop:
    """Return a crop of the supersampled picture."""
    rows, columns = (
        slice(SUPERSAMPLING * w.start, SUPERSAMPLING * w.stop) for w in crop
    )
    return rows, columns


def _downsampled(pixels: np.ndarray) -> np.ndarray:
    """Return the mean of the rendered pixels that become one."""
    height, width, parts = pixels.shape
    fine = pixels.reshape(
        height // SUPERSAMPLING,
        SUPERSAMPLING,
        width // SUPERSAMPLING,
        SUPERSAMPLING,
        parts,
    )
    return fine.mean(axis=(1, 3), dtype=np.float32)


def _lamp(camera: Camera, aspect: float) -> Camera:
    """Place the lamp on one side of the camera, so that it sees all that this sees.

    Args:
        camera: Where the picture is taken from.
        aspect: Height of the picture over its width.
    """
    width = 1.5 * camera.width * max(1.0, aspect)
    return Camera(camera.target, camera.yaw + LAMP[0], LAMP[1], width)


def _shadow_mask(scene: Scene, lamp: Camera) -> np.ndarray:
    """Return how much of the lamp's light robots block, from 0 to 1."""
    size = LAMP_PIXELS, LAMP_PIXELS
    return blur((silhouette(scene, lamp, *size) != NOTHING).astype(float), SHADOW_BLUR)
