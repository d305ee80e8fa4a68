"""Links of an SDF model: inertials, collisions and visuals; and lights."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from lxml import etree

from g1_description.bounds import checked
from g1_description.errors import DescriptionError
from g1_description.robot.assembly import WORLD
from g1_description.robot.description import Inertial, Link, Shape
from g1_description.robot.rotation import to_axes
from g1_description.robot.xml_values import (
    flag,
    friction,
    name_of,
    number,
    numbers,
    optional,
    text_of,
    vector,
)
from g1_description.sdf.frames import Scope
from g1_description.sdf.geometry import read_size
from g1_description.sdf.visuals import read_visuals

PREFIX = {"g1": "urn:g1_description"}
MAY_TOUCH = f"{{{PREFIX['g1']}}}may_touch"
"""Element of a link with the name of what may touch it; Gazebo ignores it."""

_TENSOR = {"ixx": 1.0, "ixy": 0.0, "ixz": 0.0, "iyy": 1.0, "iyz": 0.0, "izz": 1.0}


def read_link(element: etree._Element, scope: Scope) -> tuple[Link, tuple[str, ...]]:
    """Read a link element.

    Args:
        element: The link.
        scope: The model that holds it.

    Returns:
        The link, and messages on ignored visuals.

    Raises:
        DescriptionError: If a number, a name or a frame is invalid.
    """
    name = scope.full(name_of(element))
    visuals, ignored = read_visuals(element, name, scope)
    link = Link(
        name=name,
        inertial=_inertial(element.find("inertial"), name, scope),
        visuals=visuals,
        collisions=tuple(_shapes(element, name, scope)),
        gravity=flag(element, "gravity", True, f"link {name}"),
    )
    return link, ignored


def touching(element: etree._Element) -> frozenset[str]:
    """Return the names of what may touch a link."""
    return frozenset(each.text or "" for each in element.findall(MAY_TOUCH))


def drop_wrong_inertial(element: etree._Element, scope: Scope) -> str:
    """Remove an invalid inertial from a static link.

    Args:
        element: The link.
        scope: The model that holds it.

    Returns:
        A message with the reason; empty if it is valid.
    """
    name = scope.full(name_of(element))
    inertial = element.find("inertial")
    try:
        _inertial(inertial, name, scope)
    except DescriptionError as error:
        element.remove(inertial)
        return f"inertial of link {name} is ignored: {error}".rstrip(".")
    return ""


def _inertial(element: etree._Element | None, link: str, scope: Scope) -> Inertial:
    """Read an inertial element, with the tensor turned to the link's axes."""
    if element is None:
        return Inertial(1.0, np.zeros(3), np.eye(3))
    owner = f"link {link}"
    tensor = element.find("inertia")
    xx, xy, xz, yy, yz, zz = (
        number(tensor, tag, default, owner) for tag, default in _TENSOR.items()
    )
    checked(f"the inertia of {owner}", [xx, yy, zz], 0.0)
    mass = number(element, "mass", 1.0, owner, 0.0)
    pose = scope.pose_in(link, element, f"inertial of {owner}")
    axes = to_axes(pose[3:])
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Inertial(mass, pose[:3], axes @ inertia @ axes.T)


def _shapes(link: etree._Element, name: str, scope: Scope) -> Iterator[Shape]:
    """Read the supported collisions of a link."""
    for element in link.findall("collision"):
        owner = f"collision {name_of(element)} of link {name}"
        mu = text_of(element.find("surface/friction/ode"), "mu")
        bounce = element.find("surface/bounce")
        restitution = optional(bounce, "restitution_coefficient", owner)
        pose = scope.pose_in(name, element, owner)
        for geometry in element.iterfind("geometry/*"):
            size = read_size(geometry, owner)
            if size is not None:
                yield Shape(
                    kind=geometry.tag,
                    size=size,
                    pose=pose,
                    filename=text_of(geometry, "uri"),
                    name=name_of(element),
                    friction=friction(f"mu of {owner}", mu) if mu else None,
                    restitution=restitution,
                )
                break


_LIGHTS = ("point", "directional", "spot")


@dataclass(frozen=True)
class Light:
    """A light; only stored."""

    name: str
    kind: str
    """One of point, directional, spot."""

    pose: np.ndarray
    """In the world, shape (7,)."""

    cast_shadows: bool
    diffuse: tuple[float, ...]
    """Red, green, blue, alpha."""

    specular: tuple[float, ...]
    """Red, green, blue, alpha."""

    attenuation_range: float
    """In [m]."""

    attenuation_constant: float
    attenuation_linear: float
    attenuation_quadratic: float
    direction: tuple[float, ...]
    """Direction of a directional or spot light, in its own frame."""


def read_light(element: etree._Element, scope: Scope) -> Light:
    """Read a light element.

    Args:
        element: The light.
        scope: The world that holds it.

    Raises:
        DescriptionError: If its kind is unknown, or a number is invalid.
    """
    name, kind = name_of(element), element.get("type", "point")
    owner = f"light {name}"
    if kind not in _LIGHTS:
        raise DescriptionError(
            f"Unknown type '{kind}' of light {name}. Known types: {', '.join(_LIGHTS)}."
        )
    attenuation = element.find("attenuation")
    return Light(
        name=name,
        kind=kind,
        pose=scope.pose_in(WORLD, element, owner),
        cast_shadows=flag(element, "cast_shadows", False, owner),
        diffuse=_color(element, "diffuse", (1.0, 1.0, 1.0, 1.0)),
        specular=_color(element, "specular", (0.1, 0.1, 0.1, 1.0)),
        attenuation_range=number(attenuation, "range", 10.0, owner),
        attenuation_constant=number(attenuation, "constant", 1.0, owner),
        attenuation_linear=number(attenuation, "linear", 1.0, owner),
        attenuation_quadratic=number(attenuation, "quadratic", 0.0, owner),
        direction=tuple(vector(element, "direction", [0, 0, -1], owner).tolist()),
    )


def _color(
    light: etree._Element, tag: str, default: tuple[float, ...]
) -> tuple[float, ...]:
    """Read a colour: red, green, blue and optionally alpha, by default 1."""
    text, label = text_of(light, tag), f"{tag} of light {name_of(light)}"
    values = numbers(label, text, 4, least=3) if text else default
    return tuple(checked(f"the {label}", [*values, 1.0][:4]).tolist())
