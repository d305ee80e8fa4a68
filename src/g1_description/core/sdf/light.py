"""Lights of an SDF document: they are not rendered, but clients can read them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from lxml import etree

from g1_description.core.bounds import checked
from g1_description.core.errors import DescriptionError
from g1_description.core.robot.assembly import WORLD

from .frames import Scope
from .values import flag, name_of, number, numbers, text_of, vector

_LIGHTS = ("point", "directional", "spot")


@dataclass(frozen=True)
class Light:
    """A light, which is kept as data."""

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
    """Where a directional or spot light shines, in its own frame."""


def read_light(element: etree._Element, scope: Scope) -> Light:
    """Read a light element.

    Args:
        element: The light.
        scope: The world that holds it.

    Raises:
        DescriptionError: If its kind is unknown, or a number is wrong.
    """
    name, kind = name_of(element), element.get("type", "point")
    owner = f"light {name}"
    if kind not in _LIGHTS:
        raise DescriptionError(
            f"Light {name} is of type '{kind}'; there are: {', '.join(_LIGHTS)}."
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
    """Read a color: red, green, blue and perhaps alpha, which else is 1."""
    text, what = text_of(light, tag), f"{tag} of light {name_of(light)}"
    values = numbers(what, text, 4, least=3) if text else default
    return tuple(checked(f"the {what}", [*values, 1.0][:4]).tolist())
