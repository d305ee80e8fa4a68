"""Visuals of an SDF link: shapes and colours as Gazebo draws them.

They never change a simulation: an invalid visual is ignored with a message.
"""

from __future__ import annotations

from lxml import etree

from g1_description.bounds import checked
from g1_description.errors import DescriptionError
from g1_description.robot.description import Shape
from g1_description.robot.xml_values import name_of, number, numbers, text_of
from g1_description.sdf.frames import Scope
from g1_description.sdf.geometry import read_size

MATERIALS = {
    "Black": (0.0, 0.0, 0.0),
    "Blue": (0.0, 0.0, 1.0),
    "Bricks": (0.6, 0.35, 0.27),
    "CeilingTiled": (0.8, 0.8, 0.78),
    "DarkGrey": (0.175, 0.175, 0.175),
    "DarkYellow": (0.7, 0.7, 0.0),
    "FlatBlack": (0.1, 0.1, 0.1),
    "Gold": (0.8, 0.65, 0.12),
    "Green": (0.0, 1.0, 0.0),
    "Grey": (0.7, 0.7, 0.7),
    "Indigo": (0.33, 0.0, 0.5),
    "Orange": (1.0, 0.51, 0.047),
    "PaintedWall": (0.85, 0.83, 0.78),
    "Purple": (1.0, 0.0, 1.0),
    "Red": (1.0, 0.0, 0.0),
    "RedBright": (0.87, 0.26, 0.07),
    "Residential": (0.35, 0.35, 0.35),
    "Road": (0.3, 0.3, 0.3),
    "SkyBlue": (0.13, 0.44, 0.7),
    "Turquoise": (0.0, 1.0, 1.0),
    "White": (1.0, 1.0, 1.0),
    "Wood": (0.65, 0.46, 0.28),
    "WoodFloor": (0.6, 0.42, 0.26),
    "WoodPallet": (0.7, 0.55, 0.37),
    "Yellow": (1.0, 1.0, 0.0),
    "ZincYellow": (0.97, 0.95, 0.21),
}
"""Colours of Gazebo's own materials; of those with an image, about its mean."""

SUFFIXES = {"Glow": 1.0, "TransparentOverlay": 0.5, "Transparent": 0.5}
"""Ends of names of variants of a material, and their opacities."""

UNCOLORED = (0.7, 0.7, 0.7, 1.0)
"""Gazebo's colour of shapes without material."""


def read_visuals(
    link: etree._Element, name: str, scope: Scope
) -> tuple[tuple[Shape, ...], tuple[str, ...]]:
    """Read the visuals of a link.

    Args:
        link: The link.
        name: Its full name.
        scope: The model that holds it.

    Returns:
        The visible shapes, and messages on ignored visuals.
    """
    shapes, ignored = [], []
    for element in link.findall("visual"):
        own = element.get("name", "")
        try:
            shape = _visual(element, f"visual {own} of link {name}", name, scope)
        except DescriptionError as error:
            ignored.append(f"visual {own} of link {name} is ignored: {error}"[:-1])
        else:
            shapes += [shape] if shape else []
    return tuple(shapes), tuple(ignored)


def _visual(
    element: etree._Element, owner: str, link: str, scope: Scope
) -> Shape | None:
    """Read a visual; None if nothing of it is visible."""
    geometry = next(element.iterfind("geometry/*"), None)
    if geometry is None or geometry.tag == "empty":
        return None
    size = read_size(geometry, owner)
    if size is None:
        raise DescriptionError(f"Its shape {geometry.tag} is not supported.")
    if geometry.find("submesh") is not None:
        raise DescriptionError("A submesh is not supported.")
    color = _color(element.find("material"), owner)
    opacity = 1.0 - min(number(element, "transparency", 0.0, owner, 0.0), 1.0)
    if opacity < 1.0 and (color or geometry.tag != "mesh"):
        *mix, alpha = color or UNCOLORED
        color = *mix, alpha * opacity
    if opacity == 0.0:
        return None
    pose = scope.pose_in(link, element, owner)
    uri = text_of(geometry, "uri")
    return Shape(geometry.tag, size, pose, uri, name_of(element), color=color)


def _color(material: etree._Element | None, owner: str) -> tuple[float, ...] | None:
    """Read the colour of a material: what it is lit with counts most."""
    if material is None:
        return None
    diffuse, ambient = text_of(material, "diffuse"), text_of(material, "ambient")
    script = text_of(material.find("script"), "name") or text_of(material, "script")
    named = None if diffuse else _named(script)
    if named or not (diffuse or ambient):
        return named
    found = numbers(f"color of {owner}", diffuse or ambient, 4, least=3)
    label = f"the color of {owner}"
    return tuple(min(part, 1.0) for part in checked(label, [*found, 1.0][:4], 0.0))


def _named(script: str) -> tuple[float, ...] | None:
    """Find the colour of one of Gazebo's own materials."""
    prefix, _, name = script.rpartition("/")
    if prefix != "Gazebo":
        return None
    opacity = 1.0
    for suffix, own in SUFFIXES.items():
        if name.endswith(suffix):
            name, opacity = name[: -len(suffix)], own
            break
    return (*MATERIALS[name], opacity) if name in MATERIALS else None
