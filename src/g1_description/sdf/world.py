"""Reading SDF worlds: models, lights, physics and saved state.

Supports versions 1.3 to 1.9, with the meaning of Gazebo 11.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import TypeVar

import numpy as np
from lxml import etree

from g1_description.errors import DescriptionError, NoSuchModelError
from g1_description.robot.assembly import SCOPE, WORLD
from g1_description.robot.joint_angles import measure, measured_joints
from g1_description.robot.transform import compose, inverse
from g1_description.robot.xml_values import name_of, optional, pose_of, text_of, vector
from g1_description.sdf.document import EMPTY_WORLD, whole_document
from g1_description.sdf.frames import Frames, Scope
from g1_description.sdf.link import Light, read_light
from g1_description.sdf.model import SdfModel, read_model_element
from g1_description.sdf.unsupported import unread

_PLACES = {
    "time_step": ("", "max_step_size"),
    "max_update_rate": ("", "real_time_update_rate"),
    "max_contacts": ("", "max_contacts"),
    "sor_pgs_precon_iters": ("ode/solver", "precon_iters"),
    "sor_pgs_iters": ("ode/solver", "iters"),
    "sor_pgs_w": ("ode/solver", "sor"),
    "cfm": ("ode/constraints", "cfm"),
    "erp": ("ode/constraints", "erp"),
    "contact_surface_layer": ("ode/constraints", "contact_surface_layer"),
    "contact_max_correcting_vel": ("ode/constraints", "contact_max_correcting_vel"),
}
"""Element of each number, by its name in ``get_physics_properties``."""


def read_physics(holder: etree._Element) -> dict[str, float]:
    """Read the physics of a world.

    Args:
        holder: The world.

    Returns:
        The given numbers by their names in ``get_physics_properties``: the time step in
        [s], the rate in steps per second of real time, and those of ODE.

    Raises:
        DescriptionError: If one is not a number, or is negative.
    """
    every = holder.findall("physics")
    usual = (one for one in every if one.get("default", "").lower() in ("true", "1"))
    physics = next(usual, every[0] if every else None)
    found = {}
    for name, (path, tag) in _PLACES.items():
        parent = physics.find(path) if path and physics is not None else physics
        value = optional(parent, tag, "the physics")
        if value is not None:
            found[name] = value
    return found


@dataclass(frozen=True)
class SavedState:
    """Time of saving, and poses of models, links and lights."""

    time: float | None = None
    """Simulated time in [s]; None if it is not given."""

    models: dict[str, np.ndarray] = field(default_factory=dict)
    """Poses in the world by name, shape (7,), as the others."""

    links: dict[str, dict[str, np.ndarray]] = field(default_factory=dict)
    """By names of model and link; links of nested models have their prefix."""

    lights: dict[str, np.ndarray] = field(default_factory=dict)

    def then(self, later: SavedState) -> SavedState:
        """Return this state updated by a later one."""
        return SavedState(
            time=self.time if later.time is None else later.time,
            models={**self.models, **later.models},
            links={**self.links, **later.links},
            lights={**self.lights, **later.lights},
        )


def read_state(element: etree._Element) -> SavedState:
    """Read a state element of a world.

    Raises:
        DescriptionError: If a pose or the time is invalid, or a name is missing.
    """
    time = None
    if text_of(element, "sim_time"):
        seconds, nanoseconds = vector(element, "sim_time", [0, 0], "the state", 0.0)
        time = float(seconds + 1e-9 * nanoseconds)
    models = element.findall("model")
    return SavedState(
        time=time,
        models=_poses(models),
        links={name_of(model): _links(model, "") for model in models},
        lights=_poses(element.findall("light")),
    )


def _links(model: etree._Element, prefix: str) -> dict[str, np.ndarray]:
    """Read where the links of a model, and of those inside it, are in the world."""
    found = _poses(model.findall("link"), prefix)
    for inner in model.findall("model"):
        found.update(_links(inner, f"{prefix}{name_of(inner)}{SCOPE}"))
    return found


def _poses(
    elements: Iterable[etree._Element], prefix: str = ""
) -> dict[str, np.ndarray]:
    """Read where things are in the world, by name, if they are given."""
    found = {}
    for element in elements:
        name = prefix + name_of(element)
        if element.find("pose") is not None:
            found[name], _ = pose_of(element, f"the state of {name}")
    return found


def in_state(model: SdfModel, state: SavedState) -> SdfModel:
    """Apply a saved state to a model: its roots, and its joints inside their limits.

    Args:
        model: As in the file.
        state: The world's state; may be partial.
    """
    links = state.links.get(model.name, {})
    assembly = model.assembly
    description = assembly.description
    pose = state.models.get(model.name, model.pose)
    # The link of the model frame moves with joints, so the pose follows from the root.
    if description.root == WORLD:
        pose = model.pose
    elif description.root in links:
        pose = compose(links[description.root], inverse(assembly.root_pose))
    poses = {**links, WORLD: pose}
    roots = [
        compose(inverse(pose), links[root]) if root in links else placed
        for root, placed in zip(description.roots, assembly.root_poses)
    ]
    positions = dict(assembly.positions)
    for tree in description.trees:
        known = {name: poses[name] for name in poses if name in tree.link_names}
        joints = measured_joints(tree, [*known])
        if joints.names:
            still = np.zeros((len(known), 6))
            measured, _, _ = measure(np.array([*known.values()]), still, joints)
            limits = {j.name: (j.lower, j.upper) for j in tree.movable_joints}
            for name, position in zip(joints.names, measured):
                positions[name] = float(np.clip(position, *limits[name]))
    moved = replace(assembly, root_poses=np.array(roots), positions=positions)
    return replace(model, pose=pose, assembly=moved)


__all__ = ["EMPTY_WORLD", "Light", "Sdf", "SdfModel", "read_sdf"]

_Read = TypeVar("_Read")


@dataclass(frozen=True)
class Sdf:
    """The content of an SDF document."""

    models: tuple[SdfModel, ...]
    lights: tuple[Light, ...]
    gravity: tuple[float, ...] | None
    """In the world, in [m/s^2]; None if not given."""

    physics: Mapping[str, float]
    """The physics, as by ``read_physics``."""

    time: float
    """Initial simulated time in [s]: that of the saved state."""

    left_out: tuple[str, ...]
    """Messages on unsupported elements outside of models, and on ignored models and
    lights."""

    refused: tuple[str, ...] = ()
    """Errors of invalid models and lights."""


def no_model(uri: str) -> str:
    """Find no model at all.

    Raises:
        NoSuchModelError: Always.
    """
    raise NoSuchModelError("There is no such model.")


def read_sdf(text: str, find_model: Callable[[str], str] = no_model) -> Sdf:
    """Read an SDF document.

    Args:
        text: SDF as XML text.
        find_model: Returns the SDF text of an include's URI, such as ``model://NAME``;
            raises NoSuchModelError if there is none. Ground plane and sun are built in.

    Returns:
        The models and lights of its world, or those outside of a world; in the order of
        the file.

    Raises:
        DescriptionError: If it is not SDF, empty or invalid. In a world, invalid
            models, lights and frames are ignored.
    """
    root, left_out = whole_document(text, find_model)
    world = root.find("world")
    holder = root if world is None else world
    models, lights = holder.findall("model"), holder.findall("light")
    left_out += [*_surplus(root), *unread(root)]
    if world is not None:
        left_out += unread(world)
    else:
        models = models[:1]
        if not models and not lights:
            found = f": {', '.join(left_out)}" if left_out else ""
            raise DescriptionError(f"The SDF has no model, light or world{found}.")
    refused: list[str] = []
    lists = None if world is None else left_out, refused
    scope = Scope("", Frames("the world", WORLD))
    models = _read_each(models, lambda model: _placed(model, WORLD, scope), *lists)
    frames = holder.findall("frame")
    _read_each(
        frames, lambda f: _placed(f, f.get("attached_to") or WORLD, scope), *lists
    )
    named: dict[str, Light] = {}
    for messages in _read_each(lights, lambda el: _add_light(el, scope, named), *lists):
        left_out += messages
    states = _read_each(holder.findall("state"), read_state, *lists)
    state = reduce(SavedState.then, states, SavedState())
    read = _read_each(
        models, lambda m: read_model_element(m, scope.frames.pose(name_of(m))), *lists
    )
    return Sdf(
        models=tuple(in_state(model, state) for model in read),
        lights=tuple(
            replace(light, pose=state.lights.get(light.name, light.pose))
            for light in named.values()
        ),
        time=state.time or 0.0,
        gravity=tuple(vector(holder, "gravity", [0.0, 0.0, 0.0], "the world").tolist())
        if text_of(holder, "gravity")
        else None,
        physics=read_physics(holder),
        left_out=tuple(dict.fromkeys(left_out)),
        refused=tuple(refused),
    )


def _surplus(root: etree._Element) -> list[str]:
    """Report models, lights and worlds after the first, which are ignored."""
    has_world = root.find("world") is not None
    surplus = [*root.findall("world")[1:], *root.findall("model")[not has_world :]]
    surplus += root.findall("light") if has_world else []
    first = "world" if has_world else "model"
    return [
        f"{element.tag} {element.get('name')} is ignored: only the first {first} of a "
        "file is read"
        for element in surplus
    ]


def _read_each(
    elements: Iterable[etree._Element],
    read: Callable[[etree._Element], _Read],
    left_out: list[str] | None,
    refused: list[str],
) -> list[_Read]:
    """Read elements; add messages on invalid ones, or raise them without a list."""
    found = []
    for element in elements:
        try:
            found.append(read(element))
        except DescriptionError as error:
            if left_out is None:
                raise
            thing = f"{element.tag} {element.get('name', '')}".rstrip()
            left_out.append(f"{thing} is ignored: {error}".rstrip("."))
            if element.tag != "frame":
                refused.append(str(error))
    return found


def _placed(element: etree._Element, frame: str, scope: Scope) -> etree._Element:
    """Add the frame of a model or frame element to the world; return the element."""
    scope.add(name_of(element), element, frame)
    return element


def _add_light(
    element: etree._Element, scope: Scope, lights: dict[str, Light]
) -> tuple[str, ...]:
    """Read a light and add it to the others; return messages on ignored elements."""
    light = read_light(element, scope)
    if light.name in lights:
        raise DescriptionError(f"There are two lights called {light.name}.")
    lights[light.name] = light
    return unread(element)
