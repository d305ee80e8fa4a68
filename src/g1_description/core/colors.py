"""The colours of a robot's visual shapes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np


def color_of(
    material: Any | None, colors: Mapping[str, Any | None]
) -> tuple[float, ...] | None:
    """Find the colour of a shape's material.

    A wrong colour hinders nobody from moving the robot, so it is no error.

    Args:
        material: Material that a visual element has or names, if any.
        colors: Colours of the robot's own materials by name.

    Returns:
        Red, green, blue, opacity from 0 to 1; None where the file tells no numbers.
    """
    if material is None:
        return None
    color = material.color or colors.get(material.name)
    rgba = np.array(color.rgba if color is not None else [], dtype=float)
    if rgba.shape != (4,) or not np.isfinite(rgba).all():
        return None
    return tuple(np.clip(rgba, 0.0, 1.0).tolist())
