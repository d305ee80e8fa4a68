"""Messages on unsupported elements of an SDF document.

Tables list the supported elements, and those that are ignored with their default value;
everything else is reported.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from lxml import etree

from g1_description.files.xml import local_name
from g1_description.robot.xml_values import read_as
from g1_description.sdf.link import MAY_TOUCH

_READ = {
    "sdf": "world model light",
    "world": "model light frame gravity physics state",
    "state": "model light sim_time real_time wall_time iterations",
    "physics": "max_step_size real_time_update_rate real_time_factor max_contacts ode",
    "solver": "type iters precon_iters sor",
    "constraints": "cfm erp contact_surface_layer contact_max_correcting_vel",
    "light": "pose cast_shadows diffuse specular attenuation direction",
    "attenuation": "range constant linear quadratic",
    "model": "static pose frame link joint model allow_auto_disable",
    "frame": "pose",
    "link": "pose gravity inertial collision",
    "inertial": "pose mass inertia",
    "inertia": "ixx ixy ixz iyy iyz izz",
    "collision": "pose geometry surface max_contacts",
    "geometry": "empty box sphere cylinder capsule plane mesh",
    "box": "size",
    "sphere": "radius",
    "cylinder": "radius length",
    "capsule": "radius length",
    "plane": "normal size",
    "mesh": "uri scale",
    "surface": "friction bounce",
    "friction": "ode",
    "ode": "mu mu2 solver constraints",
    "bounce": "restitution_coefficient",
    "joint": "pose parent child axis",
    "axis": "xyz limit dynamics use_parent_model_frame",
    "limit": "lower upper effort velocity",
    "dynamics": "damping friction",
}
_NUMBERS = {
    6: "pose",
    2: "sim_time",
    3: "xyz box/size normal scale direction world/gravity",
    1: "mass ixx ixy ixz iyy iyz izz radius length mu restitution_coefficient lower "
    "upper effort velocity damping dynamics/friction max_step_size "
    "real_time_update_rate range constant linear quadratic iters precon_iters sor cfm "
    "erp contact_surface_layer contact_max_correcting_vel physics/max_contacts",
}
"""Number of values of the supported elements, by tag or parent/tag."""

_COUNTS = {tag: count for count, tags in _NUMBERS.items() for tag in tags.split()}

_READ_IN = {tag: frozenset(children.split()) for tag, children in _READ.items()}

_DEFAULTS = {
    "cast_shadows": 1.0,
    "dissipation": 1.0,
    "enable_wind": 0.0,
    "fdir1": 0.0,
    "initial_position": 0.0,
    "intensity": 1.0,
    "kinematic": 0.0,
    "laser_retro": 0.0,
    "must_be_base_link": 0.0,
    "self_collide": 0.0,
    "slip1": 0.0,
    "slip2": 0.0,
    "spring_reference": 0.0,
    "spring_stiffness": 0.0,
    "stiffness": 1e8,
    "transparency": 0.0,
    "velocity_decay": 0.0,
}
"""Values of unsupported elements that have no effect."""


def unread(root: etree._Element) -> tuple[str, ...]:
    """List unsupported elements.

    Args:
        root: A document, a world, a model or a light. Models in a world are not
            examined.

    Returns:
        Distinct messages, such as "sensor of link head is not simulated".
    """
    messages: dict[str, None] = {}
    waiting = [(root, _owner(root, "", ""), "")]
    for element, owner, scope in waiting:
        if element.tag == "link":  # Gazebo accepts duplicate names
            shapes = element.findall("collision")
            counts = Counter(shape.get("name", "") for shape in shapes)
            for name, count in counts.items():
                if count > 1:
                    messages[f"{owner} has {count} collisions called {name}"] = None
        for child in element:
            tag = local_name(child)
            if tag in ("material", "visual") or child.tag == MAY_TOUCH:
                continue
            messages[_read_as(child, owner)] = None
            if child.tag not in _READ_IN.get(element.tag, ()):
                if not _says_nothing(child):
                    noun = f"light {child.get('name')}" if tag == "light" else tag
                    place = "in" if element.tag == "geometry" else "of"
                    messages[f"{noun} {place} {owner} is not simulated"] = None
            elif tag == "mu2" and child.text != element.findtext("mu"):
                messages[f"mu2 of {owner} is not simulated"] = None
            elif tag == "model" and element.tag == "model":
                inner = f"{scope}{child.get('name')}"
                waiting.append((child, f"model {inner}", f"{inner}::"))
            elif tag not in ("model", "light", "world"):
                waiting.append((child, _owner(child, scope, owner), scope))
    return tuple(filter(None, messages))


def _owner(element: etree._Element, scope: str, above: str) -> str:
    """Name the owner of the children of an element."""
    tag, name = element.tag, element.get("name", "")
    if tag in ("sdf", "world"):
        return "the file" if tag == "sdf" else "the world"
    if tag == "physics":
        return "the physics of the world"
    if tag in ("model", "light", "link", "joint", "frame"):
        return f"{tag} {scope}{name}"
    return f"{tag} {name} of {above}" if tag == "collision" else above


def _read_as(element: etree._Element, owner: str) -> str:
    """Describe how malformed numbers of an element are read."""
    tag, text = element.tag, (element.text or "").strip()
    place = f"{element.getparent().tag}/{tag}"
    count = _COUNTS.get(tag, _COUNTS.get(place))
    if not text or count is None or element.get("rotation_format") == "quat_xyzw":
        return ""
    return read_as(f"{tag} of {owner}", text, count)


def _says_nothing(element: etree._Element) -> bool:
    """Return whether an element has only default values."""
    default = _DEFAULTS.get(element.tag)
    return default is not None and all(
        value == default for leaf in element.iter() for value in _values(leaf)
    )


def _values(element: etree._Element) -> Iterator[float | None]:
    """Read an element's text as numbers, true as 1; None for other words."""
    for word in (element.text or "").lower().split():
        try:
            yield float({"true": "1", "false": "0"}.get(word, word))
        except ValueError:
            yield None
