"""Sizes of the shapes of SDF."""

from __future__ import annotations

from lxml import etree

from g1_description.errors import DescriptionError
from g1_description.robot.xml_values import text_of, unit, vector

_SIZES = {
    "box": {"size": [1.0, 1.0, 1.0]},
    "sphere": {"radius": [1.0]},
    "cylinder": {"radius": [1.0], "length": [1.0]},
    "capsule": {"radius": [0.5], "length": [1.0]},
}
"""Kinds of shapes, the elements of their sizes, and their defaults."""


def read_size(geometry: etree._Element, owner: str) -> tuple[float, ...] | None:
    """Read the size of a shape; None if it is not supported."""
    kind = geometry.tag
    if kind == "plane":
        normal = vector(geometry, "normal", [0.0, 0.0, 1.0], owner)
        return tuple(unit(f"normal of {owner}", normal).tolist())
    if kind == "mesh":
        if not text_of(geometry, "uri"):
            raise DescriptionError(f"The mesh of {owner} has no uri.")
        return tuple(vector(geometry, "scale", [1.0, 1.0, 1.0], owner).tolist())
    if kind not in _SIZES:
        return None
    return tuple(
        value
        for tag, default in _SIZES[kind].items()
        for value in vector(geometry, tag, default, owner, 0.0).tolist()
    )
