"""What a URDF tells Gazebo beside the robot: its ``<gazebo>`` elements.

They mean what libsdformat 9, from 9.6 on, makes of them for Gazebo 11; of several
words on one thing the last counts.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from lxml import etree

_FLAGS = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}

_KEPT = {"disableFixedJointLumping": "revolute", "preserveFixedJoint": "fixed"}
"""What fixed joints are that are not lumped; where both are said, the latter."""


@dataclass
class Extensions:
    """What the ``<gazebo>`` elements of a robot say."""

    static: bool = False
    """Whether the model never moves by itself, nor its joints."""

    gravity: dict[str, bool] = field(default_factory=dict)
    """Whether gravity pulls the links of which that is said."""

    kept: dict[str, str] = field(default_factory=dict)
    """What the fixed joints are that are not lumped, fixed or revolute."""


def read_extensions(robot: etree._Element) -> Extensions:
    """Read the ``<gazebo>`` elements of a robot.

    Args:
        robot: The robot element, with all its children.
    """
    found = Extensions()
    for block in robot.findall("gazebo"):
        name = block.get("reference", "")
        for element in block:
            if not name and element.tag == "static":
                found.static = _flag(element)
            elif element.tag in ("turnGravityOff", "gravity"):
                found.gravity[name] = _flag(element) == (element.tag == "gravity")
            elif element.tag in _KEPT and _flag(element):
                kind = _KEPT[element.tag]
                found.kept[name] = "fixed" if found.kept.get(name) == "fixed" else kind
    return found


def _flag(element: etree._Element) -> bool:
    """Read a word that says true or false."""
    return _FLAGS.get(_word(element).lower(), False)


def _word(element: etree._Element) -> str:
    """Give what an element says, as its value or as its text."""
    return (element.get("value") or element.text or "").strip()
