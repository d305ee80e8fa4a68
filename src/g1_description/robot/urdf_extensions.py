"""The ``<gazebo>`` elements of a URDF.

They have the meaning of libsdformat 9, from 9.9.1 on, for Gazebo 11; of several values,
the last applies. Invalid and unsupported elements are ignored and reported.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from lxml import etree

from g1_description.errors import DescriptionError
from g1_description.files.xml import local_name
from g1_description.robot.xml_values import friction
from g1_description.text import listed

_KEPT = {"disableFixedJointLumping": "revolute", "preserveFixedJoint": "fixed"}
"""Types of fixed joints that are not lumped, by tag; of both tags, the latter
applies."""

_OF_MODEL = ("static",)
_OF_LINK = ("turnGravityOff", "gravity", "mu1")
_OF_JOINT = tuple(_KEPT)

_SILENT = ("material", "visual", "plugin", "sensor", "canonicalBody", "maxContacts")
"""Elements that are ignored without a message, as many files have them."""

_OFF = ("selfCollide", "dampingFactor", "laserRetro", "provideFeedback")
"""Elements without effect if they are false or zero."""

_FLAGS = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}


@dataclass
class Extensions:
    """Content of the ``<gazebo>`` elements of a robot."""

    static: bool = False
    """Whether the model never moves by itself, nor its joints."""

    gravity: dict[str, bool] = field(default_factory=dict)
    """Whether gravity acts on a link, if given."""

    friction: dict[str, float] = field(default_factory=dict)
    """Coefficients of friction of links, if given."""

    kept: dict[str, str] = field(default_factory=dict)
    """Types of fixed joints that are not lumped, fixed or revolute."""

    left_out: tuple[str, ...] = ()
    """Messages on invalid elements, and one on all unsupported elements."""


def read_extensions(robot: etree._Element) -> Extensions:
    """Read the ``<gazebo>`` elements of a robot.

    Args:
        robot: The robot element, with all its children.
    """
    found = Extensions()
    links = {link.get("name") for link in robot.findall("link")}
    joints = {joint.get("name") for joint in robot.findall("joint")}
    known = links | joints
    wrong, unknown, unread = [], [], []
    for block in robot.findall("gazebo"):
        name = block.get("reference", "")
        readable = (
            *(_OF_MODEL if not name else ()),
            *(_OF_LINK if name in links else ()),
            *(_OF_JOINT if name in joints else ()),
        )
        mu1 = block.find("mu1")
        beside = None if mu1 is None else _word(mu1)
        for element in block:
            tag = local_name(element)
            if _says_nothing(tag, _word(element), beside):
                continue
            if name and name not in known:
                unknown.append(name)
            elif tag not in readable:
                unread.append(tag)
            else:
                try:
                    _read(found, tag, name, _word(element))
                except DescriptionError as error:
                    of = f" of {name}" if name else ""
                    wrong.append(f"{tag}{of} is ignored: {error}".rstrip("."))
    if unknown:
        fault = "<gazebo> refers to an unknown link or joint"
        wrong.append(f"{fault}: {listed(unknown)}")
    if unread:
        fault = "unsupported <gazebo> elements"
        wrong.append(f"{fault}: {listed(unread)}")
    found.left_out = tuple(wrong)
    return found


def _read(found: Extensions, tag: str, name: str, word: str) -> None:
    """Read an element of the model, a link or a joint.

    Raises:
        DescriptionError: If its value is invalid.
    """
    if tag == "mu1":
        found.friction[name] = friction("mu1", word)
    elif tag == "static":
        found.static = _flag(tag, word)
    elif tag in ("turnGravityOff", "gravity"):
        found.gravity[name] = _flag(tag, word) == (tag == "gravity")
    elif tag in _KEPT and _flag(tag, word):
        is_fixed = found.kept.get(name) == "fixed"
        found.kept[name] = "fixed" if is_fixed else _KEPT[tag]


def _flag(tag: str, word: str) -> bool:
    """Read a boolean."""
    if word.lower() not in _FLAGS:
        raise DescriptionError(f"{tag} must be true or false (got '{word[:40]}').")
    return _FLAGS[word.lower()]


def _says_nothing(tag: str, word: str, mu1: str | None) -> bool:
    """Return whether an element has no effect.

    Args:
        tag: The element's.
        word: Its value.
        mu1: Value of ``mu1`` next to it, None if missing.
    """
    if tag == "mu2":  # friction is isotropic
        return word == mu1
    is_off = not word.strip("0.") or _FLAGS.get(word.lower()) is False
    return tag in _SILENT or (tag in _OFF and is_off)


def _word(element: etree._Element) -> str:
    """Return an element's value, from its attribute or text."""
    return (element.get("value") or element.text or "").strip()
