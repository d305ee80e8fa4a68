"""SDF text in, models and lights out: all that is known about a world.

This module and those whose names begin like its own are the only ones that read
SDF: versions 1.4 to 1.9, with the meaning that Gazebo 11 gives them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from lxml import etree

from .assembly import WORLD
from .errors import DescriptionError
from .sdf_frames import Frames, Scope
from .sdf_light import Light, read_light
from .sdf_model import SdfModel, read_model
from .sdf_text import name_of, optional, text_of, vector
from .sdf_unread import unread
from .sdf_world import EMPTY_WORLD, whole_document

__all__ = ["EMPTY_WORLD", "Light", "Sdf", "SdfModel", "read_sdf"]


@dataclass(frozen=True)
class Sdf:
    """What an SDF document holds."""

    models: tuple[SdfModel, ...]
    lights: tuple[Light, ...]
    gravity: tuple[float, ...] | None
    """In the world, in [m/s^2]; None where the file does not say."""

    time_step: float | None
    """In [s]; None where the file does not say."""

    max_update_rate: float | None
    """Physics steps in a second of real time; None where the file does not say."""

    left_out: tuple[str, ...]
    """A clause for each thing outside of the models that is not simulated."""


def read_sdf(
    text: str, find_model: Callable[[str], str | None] = lambda uri: None
) -> Sdf:
    """Read an SDF document.

    Args:
        text: SDF as XML text.
        find_model: Gives the SDF text behind the URI of an include, such as
            ``model://NAME``, None if there is none. The ground plane and the sun
            are there even so.

    Returns:
        The models and lights of its world, or those outside of one; in the order
        of the file.

    Raises:
        DescriptionError: If it is not SDF, holds nothing, or something in it is
            wrong.
    """
    root, missing = whole_document(text, find_model)
    world = root.find("world")
    holder = root if world is None else world
    models, lights = holder.findall("model"), holder.findall("light")
    left_out = [*missing, *_surplus(root), *unread(root), *unread(holder)]
    left_out += [clause for light in lights for clause in unread(light)]
    if world is None:
        models = models[:1]
        if not models and not lights:
            found = f", only {', '.join(left_out)}" if left_out else ""
            raise DescriptionError(f"The SDF has no model, light or world{found}.")
    scope = _scope(holder, models, lights)
    physics = _physics(holder)
    return Sdf(
        models=tuple(
            read_model(model, scope.frames.pose(name_of(model))) for model in models
        ),
        lights=tuple(read_light(light, scope) for light in lights),
        gravity=_gravity(holder),
        time_step=optional(physics, "max_step_size", "the physics"),
        max_update_rate=optional(physics, "real_time_update_rate", "the physics"),
        left_out=tuple(dict.fromkeys(left_out)),
    )


def _surplus(root: etree._Element) -> list[str]:
    """Name the models and lights that are one too many, and worlds but the first."""
    has_world = root.find("world") is not None
    surplus = [*root.findall("world")[1:], *root.findall("model")[not has_world :]]
    surplus += root.findall("light") if has_world else []
    return [f"{element.tag} {element.get('name')} of the file" for element in surplus]


def _scope(
    holder: etree._Element, models: list[etree._Element], lights: list[etree._Element]
) -> Scope:
    """Gather the frames of the world, and check that there are no two of a name."""
    scope = Scope("", Frames("the world", WORLD))
    for model in models:
        scope.add(name_of(model), model, WORLD)
    for frame in holder.findall("frame"):
        scope.add(name_of(frame), frame, frame.get("attached_to") or WORLD)
    names = [name_of(light) for light in lights]
    for name in names:
        if names.count(name) > 1:
            raise DescriptionError(f"There are two lights of the name {name}.")
    return scope


def _physics(holder: etree._Element) -> etree._Element | None:
    """Find the physics that count: those that say so, else the first."""
    all_physics = holder.findall("physics")
    for physics in all_physics:
        if physics.get("default", "").lower() in ("true", "1"):
            return physics
    return all_physics[0] if all_physics else None


def _gravity(holder: etree._Element) -> tuple[float, ...] | None:
    """Read a world's gravity, in [m/s^2]."""
    if not text_of(holder, "gravity"):
        return None
    return tuple(vector(holder, "gravity", [0.0, 0.0, 0.0], "the world").tolist())
