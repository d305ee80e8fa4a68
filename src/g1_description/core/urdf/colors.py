"""The colours of a robot's visual shapes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from lxml import etree


def named_colors(robot: etree._Element) -> dict[str, tuple[float, ...] | None]:
    """Read the colours of a robot's own materials by name."""
    return {
        material.get("name", ""): _color(material)
        for material in robot.findall("material")
    }


def visual_colors(
    link: etree._Element, named: Mapping[str, tuple[float, ...] | None]
) -> Iterator[tuple[float, ...] | None]:
    """Read the colours of a link's visual shapes.

    A wrong colour hinders nobody from moving the robot, so it is no error.

    Args:
        link: The link element.
        named: Colours of the robot's own materials by name.

    Yields:
        Red, green, blue, opacity from 0 to 1 for each visual element; None where the
        file has no numbers.
    """
    for visual in link.findall("visual"):
        material = visual.find("material")
        if material is None:
            yield None
        else:
            yield _color(material) or named.get(material.get("name", ""))


def _color(material: etree._Element) -> tuple[float, ...] | None:
    """Read the colour of a material; None where it has no numbers."""
    color = material.find("color")
    text = "" if color is None else color.get("rgba", "")
    try:
        rgba = np.array(text.split(), dtype=float)
    except ValueError:
        return None
    if rgba.shape != (4,) or not np.isfinite(rgba).all():
        return None
    return tuple(np.clip(rgba, 0.0, 1.0).tolist())
