"""An SDF document made whole: read as XML, with the models it includes in their place.

The ground plane and the sun are always there to be included, and so is the world
that has nothing but them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from lxml import etree

from .errors import DescriptionError
from .sdf_text import text_of
from .xml import parse_xml

VERSIONS = ("1.4", "1.5", "1.6", "1.7", "1.8", "1.9")

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
_BUILT_IN = {
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
"""The world a simulator begins with where no other is asked for."""


def whole_document(
    text: str, find_model: Callable[[str], str | None]
) -> tuple[etree._Element, tuple[str, ...]]:
    """Read a document and put what it includes where it is included.

    Args:
        text: SDF as XML text.
        find_model: Gives the SDF text behind a URI, None if there is none.

    Returns:
        The root element without includes, and a clause for each part of an include
        that has no effect.

    Raises:
        DescriptionError: If a document is not SDF, or includes itself.
    """
    root = _document("SDF", text)
    left_out: list[str] = []
    waiting: list[tuple[etree._Element, tuple[str, ...]]] = []
    waiting.extend((include, ()) for include in _includes(root))
    for include, chain in waiting:
        uri = _uri(include, chain)
        found = find_model(uri)
        found = _BUILT_IN.get(uri) if found is None else found
        if found is None:
            left_out.append(f"include of {uri}, which is not found")
            include.getparent().remove(include)
            continue
        element = _overridden(_entity(uri, found), include, uri, left_out)
        include.getparent().replace(include, element)
        waiting.extend((inner, (*chain, uri)) for inner in _includes(element))
        if len(waiting) > _MOST_INCLUDES:
            raise DescriptionError(
                f"The SDF includes more than {_MOST_INCLUDES} models, one in another."
            )
    return root, tuple(left_out)


def _document(what: str, text: str) -> etree._Element:
    """Read one document, as the latest version would say the same."""
    root = parse_xml(what, text)
    if root.tag != "sdf":
        raise DescriptionError(f"The {what} has the root element {root.tag}, not sdf.")
    if not len(root):
        raise DescriptionError(f"The {what} is empty: it has no model, light or world.")
    version = root.get("version", "")
    if version not in VERSIONS:
        raise DescriptionError(
            f"The {what} is of version '{version}'; can be read: {', '.join(VERSIONS)}."
        )
    if version == "1.4":  # where an axis is always in the model's frame
        for axis in root.iterfind(".//joint/axis"):
            etree.SubElement(axis, "use_parent_model_frame").text = "true"
    return root


def _includes(element: etree._Element) -> Iterator[etree._Element]:
    """Find the includes of an element that are no plugin's own."""
    for include in element.iter("include"):
        if include.getparent().tag in ("sdf", "world", "model"):
            yield include


def _uri(include: etree._Element, chain: tuple[str, ...]) -> str:
    """Give the URI of an include, checked to lead out of those around it."""
    uri = text_of(include, "uri")
    if not uri:
        raise DescriptionError("An include of the SDF has no uri.")
    if uri in chain:
        raise DescriptionError(f"{uri} includes itself, by {' and '.join(chain)}.")
    if len(chain) >= _DEEPEST_INCLUDE:
        raise DescriptionError(
            f"{chain[0]} includes models more than {_DEEPEST_INCLUDE} deep."
        )
    if include.get("merge", "").lower() in ("true", "1"):
        raise DescriptionError(
            f"The include of {uri} is to be merged, which is unknown."
        )
    return uri


def _entity(uri: str, text: str) -> etree._Element:
    """Give the model or light that a document holds."""
    for element in _document(f"SDF behind {uri}", text):
        if element.tag in ("model", "light"):
            return element
    raise DescriptionError(f"The SDF behind {uri} has no model or light to include.")


def _overridden(
    entity: etree._Element, include: etree._Element, uri: str, left_out: list[str]
) -> etree._Element:
    """Give an included model or light what its include says about it."""
    for child in list(include):
        if child.tag == "name":
            entity.set("name", text_of(include, "name") or entity.get("name", ""))
        elif child.tag in ("pose", "static"):
            for old in entity.findall(child.tag):
                entity.remove(old)
            entity.append(child)
        elif child.tag == "plugin":
            entity.append(child)
        elif child.tag != "uri":
            left_out.append(f"{child.tag} of the include of {uri}")
    return entity
