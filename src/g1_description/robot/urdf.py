"""URDF text in, robot description out.

This is the only module that reads URDF, with urdf_parser_py.
"""

from __future__ import annotations

import copy
import logging
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from lxml import etree
from urdf_parser_py import urdf
from urdf_parser_py.xml_reflection import core as xml_reflection

from g1_description.bounds import checked, position_limits
from g1_description.errors import DescriptionError
from g1_description.files.xml import check_size, parse_xml, part_at_fault
from g1_description.robot.description import (
    MOVABLE,
    Description,
    Inertial,
    Joint,
    Link,
    Shape,
)
from g1_description.robot.rotation import axes_to_rpy, from_rpy, rotate, to_axes
from g1_description.robot.tree import one_root
from g1_description.robot.urdf_extensions import Extensions, read_extensions
from g1_description.robot.xml_values import numbers, unit
from g1_description.text import listed


def _color(material: etree._Element) -> tuple[float, ...] | None:
    """Read the colour of a material; None if it is not given or invalid."""
    color = material.find("color")
    text = "" if color is None else color.get("rgba", "")
    try:
        rgba = np.array(text.split(), dtype=float)
    except ValueError:
        return None
    if rgba.shape != (4,) or not np.isfinite(rgba).all():
        return None
    return tuple(np.clip(rgba, 0.0, 1.0).tolist())


_MANY = ("link", "joint", "visual", "collision")
"""Elements that may occur several times. Of others, the first is used."""

_SHAPE = ("origin", "geometry")
_PARTS = {
    "robot": ("link", "joint"),
    "link": ("inertial", "visual", "collision"),
    "inertial": ("origin", "mass", "inertia"),
    "visual": _SHAPE,
    "collision": _SHAPE,
    "joint": (
        "origin",
        "parent",
        "child",
        "axis",
        "limit",
        "dynamics",
        "mimic",
        "safety_controller",
        "calibration",
    ),
}
"""Children of elements that urdfdom reads."""

_ATTRIBUTES = {
    "robot": ("name", "version"),
    "link": ("name",),
    "joint": ("name", "type", "dont_collapse"),
    "visual": ("name",),
    "collision": ("name",),
    "origin": ("xyz", "rpy"),
    "mass": ("value",),
    "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
    "box": ("size",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
    "sphere": ("radius",),
    "mesh": ("filename", "scale"),
    "parent": ("link",),
    "child": ("link",),
    "axis": ("xyz",),
    "limit": ("lower", "upper", "effort", "velocity"),
    "dynamics": ("damping", "friction"),
    "mimic": ("joint", "multiplier", "offset"),
    "safety_controller": (
        "k_position",
        "k_velocity",
        "soft_lower_limit",
        "soft_upper_limit",
    ),
    "calibration": ("rising", "falling", "reference_position"),
}
"""Attributes of elements that urdfdom reads, and one of Isaac's for fixed joints."""

_WITHOUT_AXIS = ("fixed", "floating")
"""Types of joints without an axis."""


def _keep_parts(robot: etree._Element) -> tuple[str, ...]:
    """Remove everything but links and joints from a robot element.

    Materials are removed, too. Return a message on attributes that have no effect.
    """
    unread = []
    waiting = [robot]
    for element in waiting:
        known = _ATTRIBUTES.get(element.tag, ())
        for key in [key for key in element.attrib if key not in known]:
            del element.attrib[key]
            if ":" not in key:  # else from another format; its prefix may be undeclared
                unread.append(f"{key} of {_owner(element)}")
        for child in _surplus(element):
            element.remove(child)
        waiting.extend(element)
    robot.attrib.pop("version", None)
    robot.set("name", robot.get("name", ""))
    return (f"unsupported attributes: {listed(unread)}",) if unread else ()


def _surplus(element: etree._Element) -> list[etree._Element]:
    """List the children of an element that are not read."""
    if element.tag == "geometry":
        return list(element)[1:]
    parts = _PARTS.get(element.tag, ())
    if element.tag == "joint" and element.get("type") in _WITHOUT_AXIS:
        parts = tuple(part for part in parts if part != "axis")
    seen: set[str] = set()
    surplus = []
    for child in element:
        if child.tag not in parts or (child.tag in seen and child.tag not in _MANY):
            surplus.append(child)
        seen.add(child.tag)
    return surplus


# Not all are ParseErrors.
UNREADABLE = Exception
"""Errors of urdf_parser_py on invalid URDF."""

IT_IS_XACRO = (
    "This looks like unexpanded xacro: run xacro on it, or name the file .xacro."
)
"""Hint on a description that looks like xacro."""


class _Capsule(urdf.Cylinder):
    """A capsule, of URDF 1.1."""


_GEOMETRY = xml_reflection.value_types["urdf.geometric"].factory.typeMap
"""Classes of shapes by their tags."""

_GEOMETRY["capsule"] = _Capsule

_LOGGER = logging.getLogger(__name__)
# Unknown elements are not printed to stderr.
xml_reflection.on_error = _LOGGER.debug


def parse_urdf(text: str) -> Description:
    """Read a robot description.

    Args:
        text: URDF as XML text.

    Returns:
        The robot: one tree with unit axes and ordered limits, infinite where those of
        the file are not ordered. Its name is empty if the file has none. Versions 1.0
        and 1.1 are known; others are read as the latter.

    Raises:
        DescriptionError: If the text is too large, not XML, not URDF, or not one tree.
    """
    check_size("The robot description", len(text))
    try:
        found = _description(parse_xml("robot description", text))
        return replace(found, urdf=text)
    except DescriptionError as error:
        if not _is_xacro(text):
            raise
        raise DescriptionError(f"{error} {IT_IS_XACRO}") from error


def _is_xacro(text: str) -> bool:
    """Return whether a document is XML with unexpanded xacro.

    Plugins may contain ``${``.
    """
    with suppress(DescriptionError):
        root = parse_xml("robot description", text)
        return any(
            element.prefix == "xacro"
            or element.tag.startswith("xacro:")  # the prefix is not declared
            or any("${" in value for value in element.attrib.values())
            for element in root.xpath("//*[not(ancestor-or-self::gazebo)]")
        )
    return False


def _description(element: etree._Element) -> Description:
    """Read a robot description; errors are those of ``parse_urdf``."""
    if element.tag != "robot":
        raise DescriptionError(
            f"The robot description is not URDF: the root element is <{element.tag}>, "
            "not <robot>."
        )
    named = {m.get("name", ""): _color(m) for m in element.findall("material")}
    extensions = read_extensions(element)
    shapes = _remove_unsupported_shapes(element)
    colors = [
        [
            None if m is None else _color(m) or named.get(m.get("name", ""))
            for m in (visual.find("material") for visual in link.findall("visual"))
        ]
        for link in element.findall("link")
    ]
    _write_rpy(element)
    attributes = _keep_parts(element)
    try:
        robot = urdf.URDF.from_xml_string(etree.tostring(element, encoding="utf-8"))
    except UNREADABLE as error:
        sentence = " ".join(str(error).split())
        place = "" if "ParseError" in sentence else part_at_fault(element, _is_urdf)
        raise DescriptionError(
            f"The robot description is not URDF: {place}{sentence}."
        ) from error
    links = tuple(
        _link(link, found, extensions) for link, found in zip(robot.links, colors)
    )
    joints = tuple(_joint(joint, extensions) for joint in robot.joints)
    return Description(
        name=robot.name,
        root=one_root(robot.name, links, joints),
        links=links,
        joints=joints,
        static=extensions.static,
        unread=(*shapes, *attributes),
        left_out=extensions.left_out,
    )


def _shapes(robot: etree._Element) -> Iterator[tuple[etree._Element, etree._Element]]:
    """Yield each visual and collision that has a geometry, and the shape in that."""
    for tag in ("visual", "collision"):
        for element in robot.findall(f"link/{tag}"):
            shape = element.find("geometry/*")
            if shape is not None:
                yield element, shape


def _remove_unsupported_shapes(robot: etree._Element) -> tuple[str, ...]:
    """Remove visuals and collisions of unknown shapes; return a message on them."""
    removed = []
    for element, shape in [*_shapes(robot)]:
        if shape.tag not in _GEOMETRY:
            link = element.getparent()
            removed.append(f"{shape.tag} in {element.tag} of {_owner(link)}")
            link.remove(element)
    return (f"unsupported shapes: {listed(removed)}",) if removed else ()


def _owner(element: etree._Element) -> str:
    """Name the link or joint of an element, else the robot."""
    for part in (element, *element.iterancestors()):
        if part.tag in ("link", "joint"):
            return f"{part.tag} {part.get('name', '')}"
    return "the robot"


def _write_rpy(robot: etree._Element) -> None:
    """Replace ``quat_xyzw`` of URDF 1.1 by ``rpy``, unless that is given, too."""
    for path in ("link/*/origin", "joint/origin"):
        for origin in robot.iterfind(path):
            if "quat_xyzw" not in origin.attrib or "rpy" in origin.attrib:
                continue
            label = f"quat_xyzw of {_owner(origin)}"
            values = numbers(label, origin.attrib.pop("quat_xyzw"), 4, least=4)
            quaternion = unit(label, checked(f"the {label}", values))
            origin.set("rpy", _row(axes_to_rpy(to_axes(quaternion))))


def _row(values: np.ndarray) -> str:
    """Write numbers that are read back to the last bit."""
    return " ".join(map(repr, values.tolist()))


def as_version_1_0(text: str) -> str:
    """Return a URDF, as XML text that ``parse_urdf`` reads, as version 1.0."""
    robot = parse_xml("robot description", text, keep_comments=True)
    make_version_1_0(robot)
    return etree.tostring(robot, encoding="unicode")


def make_version_1_0(robot: etree._Element) -> None:
    """Rewrite a robot for readers of URDF 1.0, such as those of ROS 1.

    ``quat_xyzw`` becomes ``rpy``, and a capsule a cylinder and two spheres. Unsupported
    shapes are removed, as urdfdom reads no shape after them. Everything else is
    unchanged.

    Args:
        robot: The robot element of a URDF that ``parse_urdf`` reads.
    """
    if robot.get("version"):
        robot.set("version", "1.0")
    _remove_unsupported_shapes(robot)
    _write_rpy(robot)
    for origin in robot.iter("origin"):  # with rpy it has no effect
        origin.attrib.pop("quat_xyzw", None)
    for element, shape in [*_shapes(robot)]:
        if shape.tag == "capsule":
            _split(element, shape)


def _split(element: etree._Element, capsule: etree._Element) -> None:
    """Turn the capsule of a visual or collision into a cylinder and two spheres."""
    origin = element.find("origin")
    origin = etree.Element("origin") if origin is None else origin
    xyz, rpy = (
        np.array(origin.get(key, "0 0 0").split(), dtype=float)
        for key in ("xyz", "rpy")
    )
    radius, length = capsule.get("radius", ""), float(capsule.get("length", ""))
    for height in (-length / 2, length / 2):
        end = copy.deepcopy(element)
        end.attrib.clear()  # a name would be there twice
        for old in end.findall("origin"):
            end.remove(old)
        place = xyz + rotate(from_rpy(rpy), np.array([0.0, 0.0, height]))
        end.insert(0, etree.Element("origin", xyz=_row(place)))
        ball = etree.Element("sphere", radius=radius)
        end.find("geometry").replace(end.find("geometry/*"), ball)
        element.addnext(end)
    capsule.tag = "cylinder"


def _is_urdf(robot: etree._Element) -> bool:
    """Return whether a robot element can be read."""
    try:
        urdf.URDF.from_xml_string(etree.tostring(robot, encoding="utf-8"))
    except UNREADABLE:
        return False
    return True


def _pose(owner: str, origin: urdf.Pose | None) -> np.ndarray:
    """Read an origin element; missing parts are the identity."""
    xyz = (origin.xyz if origin is not None else None) or [0.0, 0.0, 0.0]
    rpy = (origin.rpy if origin is not None else None) or [0.0, 0.0, 0.0]
    numbers = checked(f"an origin of {owner}", [*xyz, *rpy])
    return np.concatenate([numbers[:3], from_rpy(numbers[3:])])


def _link(
    link: urdf.Link, colors: Sequence[tuple[float, ...] | None], extensions: Extensions
) -> Link:
    """Read a link element, with the colours of its visual shapes."""
    return Link(
        name=link.name,
        inertial=_inertial(link),
        visuals=tuple(
            replace(_shape(link.name, visual), color=color)
            for visual, color in zip(link.visuals, colors)
        ),
        collisions=tuple(
            replace(
                _shape(link.name, shape), friction=extensions.friction.get(link.name)
            )
            for shape in link.collisions
        ),
        gravity=extensions.gravity.get(link.name),
    )


def _inertial(link: urdf.Link) -> Inertial | None:
    """Read an inertial element, with the tensor turned to the link's axes."""
    element = link.inertial
    if element is None:
        return None
    if element.inertia is None:
        raise DescriptionError(f"<inertial> of link {link.name} has no <inertia>.")
    values = element.inertia
    tensor = np.array(
        [
            [values.ixx, values.ixy, values.ixz],
            [values.ixy, values.iyy, values.iyz],
            [values.ixz, values.iyz, values.izz],
        ]
    )
    checked(f"the inertia of link {link.name}", tensor.ravel().tolist())
    checked(f"the mass of link {link.name}", [element.mass], least=0.0)
    pose = _pose(f"link {link.name}", element.origin)
    axes = to_axes(pose[3:])
    return Inertial(float(element.mass), pose[:3], axes @ tensor @ axes.T)


def _shape(link: str, element: urdf.Visual | urdf.Collision) -> Shape:
    """Read a visual or collision element."""
    geometry = element.geometry
    name = getattr(element, "name", None) or ""
    pose = _pose(f"link {link}", element.origin)
    if isinstance(geometry, urdf.Mesh):
        scale = checked(f"a mesh of link {link}", geometry.scale or [1.0, 1.0, 1.0])
        return Shape("mesh", tuple(scale), pose, geometry.filename, name)
    if isinstance(geometry, urdf.Box):
        kind, size = "box", geometry.size
    elif isinstance(geometry, urdf.Cylinder):
        kind = "capsule" if isinstance(geometry, _Capsule) else "cylinder"
        size = [geometry.radius, geometry.length]
    elif isinstance(geometry, urdf.Sphere):
        kind, size = "sphere", [geometry.radius]
    else:
        raise DescriptionError(f"A shape of link {link} has no known geometry.")
    sizes = tuple(checked(f"a {kind} of link {link}", size, 0.0))
    return Shape(kind, sizes, pose, name=name)


def _joint(joint: urdf.Joint, extensions: Extensions) -> Joint:
    """Read a joint element."""
    axis = np.array(joint.axis or [1.0, 0.0, 0.0], dtype=float)
    length = np.linalg.norm(axis)
    if joint.type in MOVABLE and not 0.0 < length < np.inf:
        raise DescriptionError(
            f"The axis of joint {joint.name} must not be zero (got {joint.axis})."
        )
    limit, dynamics = joint.limit, joint.dynamics
    if limit is None and joint.type in ("revolute", "prismatic"):
        raise DescriptionError(
            f"Joint {joint.name} is {joint.type} and must have a <limit>."
        )
    if limit is not None:
        bounds = [limit.effort, limit.velocity]
        checked(f"the limit of joint {joint.name}", bounds, least=0.0)
    if dynamics is not None:
        numbers = [dynamics.damping or 0.0, dynamics.friction or 0.0]
        checked(f"the dynamics of joint {joint.name}", numbers)
    lower, upper, remark = -np.inf, np.inf, ""
    if limit is not None and joint.type in ("revolute", "prismatic"):
        bounds = [float(limit.lower or 0.0), float(limit.upper or 0.0)]
        lower, upper, remark = position_limits(f"joint {joint.name}", *bounds)
    turns_on = joint.type == "revolute" and np.isinf([lower, upper]).all()
    return Joint(
        name=joint.name,
        kind="continuous" if turns_on else joint.type,
        parent=joint.parent,
        child=joint.child,
        pose=_pose(f"joint {joint.name}", joint.origin),
        axis=axis / length if length > 0.0 else axis,
        lower=lower,
        upper=upper,
        effort=float(limit.effort) if limit is not None else np.inf,
        velocity=float(limit.velocity) if limit is not None else np.inf,
        damping=float(dynamics.damping or 0.0) if dynamics is not None else 0.0,
        friction=float(dynamics.friction or 0.0) if dynamics is not None else 0.0,
        kept_as=extensions.kept.get(joint.name, "") if joint.type == "fixed" else "",
        remark=remark,
    )
