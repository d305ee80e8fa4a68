"""Reading an SDF document, with all includes resolved.

The ground plane, the sun and the empty world are built in.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from lxml import etree

from g1_description.errors import DescriptionError, NoSuchModelError
from g1_description.files.model_files import NEWEST, version_number
from g1_description.files.xml import parse_xml
from g1_description.robot.xml_values import text_of

_OLDEST = (1, 4)
_CONVERTED = (1, 3)
"""A version with other names of elements, which is converted."""

INCLUDED = "included_from"
"""Attribute of included elements: in Gazebo, an included model becomes part of the
model around it, but a nested model does not."""

_STAYING = ("pose", "frame", "link", "joint", "model")
"""Elements of an included model that do not apply to the model around it."""

_MOST_INCLUDES = 1000
_DEEPEST_INCLUDE = 20

_GROUND_PLANE = """
  <model name="ground_plane">
    <static>true</static>
    <link name="link">
      <collision name="collision">
        <geometry><plane><normal>0 0 1</normal></plane></geometry>
        <surface><friction><ode><mu>100</mu></ode></friction></surface>
      </collision>
    </link>
  </model>"""
_SUN = """
  <light name="sun" type="directional">
    <pose>0 0 10 0 0 0</pose>
    <cast_shadows>true</cast_shadows>
    <diffuse>0.8 0.8 0.8 1</diffuse>
    <specular>0.2 0.2 0.2 1</specular>
    <attenuation>
      <range>1000</range>
      <constant>0.9</constant>
      <linear>0.01</linear>
      <quadratic>0.001</quadratic>
    </attenuation>
    <direction>-0.5 0.1 -0.9</direction>
  </light>"""
BUILT_IN = {
    "model://ground_plane": f'<sdf version="1.7">{_GROUND_PLANE}</sdf>',
    "model://sun": f'<sdf version="1.7">{_SUN}</sdf>',
}

EMPTY_WORLD = f"""<sdf version="1.7"><world name="default">
  <gravity>0 0 -9.8</gravity>
  <physics type="ode">
    <max_step_size>0.001</max_step_size>
    <real_time_update_rate>1000</real_time_update_rate>
  </physics>{_GROUND_PLANE}{_SUN}
</world></sdf>
"""
"""The world a simulator starts with if no other is given."""


def whole_document(
    text: str, find_model: Callable[[str], str]
) -> tuple[etree._Element, list[str]]:
    """Read a document and resolve its includes.

    Args:
        text: SDF as XML text.
        find_model: Returns the SDF text of a URI; raises NoSuchModelError if there is
            none, another DescriptionError if it cannot be read.

    Returns:
        The root element without includes, and messages on ignored includes and on
        versions that are converted.

    Raises:
        DescriptionError: If the document is not SDF, or an include is invalid. In a
            world, invalid includes are ignored.
    """
    left_out: list[str] = []
    root = _document("SDF", text, left_out)
    is_world = root.find("world") is not None
    waiting: list[tuple[etree._Element, tuple[str, ...]]] = []
    waiting.extend((include, ()) for include in _includes(root))
    included: list[etree._Element] = []
    for include, chain in waiting:
        parent, element = include.getparent(), None
        try:
            element = _included(include, chain, find_model, left_out)
        except DescriptionError as error:
            if not is_world:
                raise
            uri = text_of(include, "uri") or "nothing"
            left_out.append(f"include of {uri} is ignored: {error}".rstrip("."))
        if element is None:
            parent.remove(include)
            continue
        parent.replace(include, element)
        included.append(element)
        inside = (*chain, text_of(include, "uri"))
        waiting.extend((inner, inside) for inner in _includes(element))
        if len(waiting) > _MOST_INCLUDES:
            raise DescriptionError(
                f"The SDF includes more than {_MOST_INCLUDES} models."
            )
    for element in reversed(included):  # the innermost first
        if element.tag == "model" and element.getparent().tag == "model":
            # As by libsdformat, where the first of several values applies.
            for child in list(element):
                if child.tag not in _STAYING:
                    element.addprevious(child)
    return root, left_out


def _document(label: str, text: str, left_out: list[str]) -> etree._Element:
    """Read one document, converted to the latest version."""
    root = parse_xml(label, text)
    if root.tag != "sdf":
        raise DescriptionError(
            f"The root element of the {label} must be sdf (got {root.tag})."
        )
    if not len(root):
        raise DescriptionError(f"The {label} has no model, light or world.")
    version = root.get("version", "")
    number = version_number(version)
    if number == _CONVERTED:
        left_out.append(f"{label} of version 1.3 is read as version 1.4")
    elif number is None or not _OLDEST <= number <= NEWEST:
        of = f"of version '{version}'" if version else "without version"
        left_out.append(f"{label} {of} is read as version {NEWEST[0]}.{NEWEST[1]}")
        return root
    _convert(root, number)
    return root


def _convert(root: etree._Element, version: tuple[int, int]) -> None:
    """Convert a document of an older version to the latest."""
    if version < (1, 4):
        for mesh in root.iter("mesh"):
            _move(mesh, "filename", mesh, "uri")
        for physics in root.iterfind("world/physics"):
            _move(physics, "update_rate", physics, "real_time_update_rate")
            _move(physics, "ode/solver/dt", physics, "max_step_size")
            _move(physics, "bullet/dt", physics, "max_step_size")
    if version < (1, 5):  # where an axis is always in the model's frame
        for axis in root.iterfind(".//joint/axis"):
            etree.SubElement(axis, "use_parent_model_frame").text = "true"
    if version < (1, 6):
        for world in root.iterfind("world"):
            _move(world, "physics/gravity", world, "gravity")


def _move(above: etree._Element, path: str, below: etree._Element, tag: str) -> None:
    """Move an element to another parent with a new tag, if it exists."""
    element = above.find(path)
    if element is not None:
        element.tag = tag
        below.append(element)


def _includes(element: etree._Element) -> Iterator[etree._Element]:
    """Find the includes of an element, except in plugins."""
    for include in element.iter("include"):
        if include.getparent().tag in ("sdf", "world", "model"):
            yield include


def _included(
    include: etree._Element,
    chain: tuple[str, ...],
    find_model: Callable[[str], str],
    left_out: list[str],
) -> etree._Element | None:
    """Read an included element; None if it is not found."""
    uri = _uri(include, chain)
    try:
        found = find_model(uri)
    except NoSuchModelError as error:
        if uri not in BUILT_IN:
            left_out.append(f"include of {uri} is ignored: {error}".rstrip("."))
            return None
        found = BUILT_IN[uri]
    for element in _document(f"SDF of {uri}", found, left_out):
        if element.tag in ("model", "light"):
            return _overridden(element, include, uri, left_out)
    raise DescriptionError(f"The SDF of {uri} has no model or light.")


def _uri(include: etree._Element, chain: tuple[str, ...]) -> str:
    """Return the URI of an include, checked against cycles."""
    uri = text_of(include, "uri")
    if not uri:
        raise DescriptionError("An include in the SDF has no uri.")
    if uri in chain:
        raise DescriptionError(f"{uri} includes itself, through {' and '.join(chain)}.")
    if len(chain) >= _DEEPEST_INCLUDE:
        raise DescriptionError(
            f"The includes of {chain[0]} are nested more than {_DEEPEST_INCLUDE} deep."
        )
    if include.get("merge", "").lower() in ("true", "1"):
        raise DescriptionError(
            f"The include of {uri} has merge, which is not supported."
        )
    return uri


def _overridden(
    entity: etree._Element, include: etree._Element, uri: str, left_out: list[str]
) -> etree._Element:
    """Apply the overrides of an include to its model or light."""
    entity.set(INCLUDED, uri)
    for child in list(include):
        if child.tag == "name":
            entity.set("name", text_of(include, "name") or entity.get("name", ""))
        elif child.tag in ("pose", "static"):
            for old in entity.findall(child.tag):
                entity.remove(old)
            entity.insert(0, child)
        elif child.tag == "plugin":
            entity.append(child)
        elif child.tag != "uri":
            left_out.append(f"{child.tag} of the include of {uri} is ignored")
    return entity
