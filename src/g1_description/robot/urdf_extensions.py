"""What a URDF holds for Gazebo besides the robot: its ``<gazebo>`` elements.

They mean what libsdformat 9, from 9.9.1 on, makes of them for Gazebo 11; of several
words on one thing the last counts. What is wrong or not simulated is left out by name.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from lxml import etree

from g1_description.errors import DescriptionError
from g1_description.files.xml import local_name
from g1_description.robot.xml_values import friction
from g1_description.text import listed

_KEPT = {"disableFixedJointLumping": "revolute", "preserveFixedJoint": "fixed"}
"""What fixed joints are that are not lumped; where both are said, the latter."""

_OF_MODEL = ("static",)
_OF_LINK = ("turnGravityOff", "gravity", "mu1")
_OF_JOINT = tuple(_KEPT)

_SILENT = ("material", "visual", "plugin", "sensor", "canonicalBody", "maxContacts")
"""Not worth a word, so many files have them."""

_OFF = ("selfCollide", "dampingFactor", "laserRetro", "provideFeedback")
"""What says nothing where it is false or zero."""

_FLAGS = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}


@dataclass
class Extensions:
    """What the ``<gazebo>`` elements of a robot say."""

    static: bool = False
    """Whether the model never moves by itself, nor its joints."""

    gravity: dict[str, bool] = field(default_factory=dict)
    """Whether gravity pulls the links of which that is said."""

    friction: dict[str, float] = field(default_factory=dict)
    """Coefficients of friction of the links of which that is said."""

    kept: dict[str, str] = field(default_factory=dict)
    """What the fixed joints are that are not lumped, fixed or revolute."""

    left_out: tuple[str, ...] = ()
    """A message for each thing that is wrong, and one for all that is not simulated."""


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
                    wrong.append(f"{tag}{of} is left out: {error}".rstrip("."))
    if unknown:
        fault = "<gazebo> refers to what is no link or joint"
        wrong.append(f"{fault}: {listed(unknown)}")
    if unread:
        fault = "of the <gazebo> elements these are not simulated"
        wrong.append(f"{fault}: {listed(unread)}")
    found.left_out = tuple(wrong)
    return found


def _read(found: Extensions, tag: str, name: str, word: str) -> None:
    """Take over what an element says of the model, a link or a joint.

    Raises:
        DescriptionError: If it says nothing that can be meant.
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
    """Read a word that says true or false."""
    if word.lower() not in _FLAGS:
        raise DescriptionError(f"The {tag} is '{word[:40]}', neither true nor false.")
    return _FLAGS[word.lower()]


def _says_nothing(tag: str, word: str, mu1: str | None) -> bool:
    """Return whether it is no loss that an element is not read.

    Args:
        tag: The element's.
        word: What it says.
        mu1: What the ``mu1`` beside it says, None where there is none.
    """
    if tag == "mu2":  # friction is the same both ways
        return word == mu1
    is_off = not word.strip("0.") or _FLAGS.get(word.lower()) is False
    return tag in _SILENT or (tag in _OFF and is_off)


def _word(element: etree._Element) -> str:
    """Give what an element says, as its value or as its text."""
    return (element.get("value") or element.text or "").strip()
