"""The parts of a URDF that describe links and joints; urdfdom takes what else it has.

urdf_parser_py wants to understand a whole file: a transmission of another form, a
material without a name or a texture without a file would make it refuse the robot.
"""

from __future__ import annotations

from lxml import etree

_MANY = ("link", "joint", "visual", "collision")
"""Elements that may stand beside others of their kind. Of the rest the first counts."""

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
"""What urdfdom reads in an element."""

_WITHOUT_AXIS = ("fixed", "floating")
"""Types of joints whose axis means nothing."""


def keep_parts(robot: etree._Element) -> None:
    """Take out of a robot element all that does not describe links and joints.

    Args:
        robot: The element; materials are taken out too.
    """
    name = robot.get("name", "")
    robot.attrib.clear()
    robot.set("name", name)
    waiting = [robot]
    for element in waiting:
        for key in [key for key in element.attrib if ":" in key]:
            del element.attrib[key]  # of another format; its prefix may be unknown
        for child in _surplus(element):
            element.remove(child)
        waiting.extend(element)


def _surplus(element: etree._Element) -> list[etree._Element]:
    """List the children of an element that do not count."""
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
