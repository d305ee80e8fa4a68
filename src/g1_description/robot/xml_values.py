"""Reading numbers, flags, names and poses from elements of SDF.

Missing and empty values have SDF's defaults. Numbers are read as by C++ streams, which
libsdformat uses. Errors name the element.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from lxml import etree

from g1_description.bounds import MAX_VALUE, checked
from g1_description.errors import DescriptionError
from g1_description.robot.rotation import from_rpy
from g1_description.robot.transform import IDENTITY

_FLAGS = {"true": True, "1": True, "false": False, "0": False}
_NUMBER = re.compile(
    r"\s*(?!0x)[+-]?(?:(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?|inf(?:inity)?|nan)",
    re.ASCII | re.IGNORECASE,
)
_POSE = 6


def name_of(element: etree._Element) -> str:
    """Return an element's name.

    Raises:
        DescriptionError: If it has none.
    """
    name = element.get("name", "")
    if not name:
        raise DescriptionError(f"A {element.tag} in the SDF has no name.")
    return name


def text_of(parent: etree._Element | None, tag: str) -> str:
    """Return the text of a child element, empty if missing."""
    found = None if parent is None else parent.find(tag)
    return "" if found is None else (found.text or "").strip()


def flag(parent: etree._Element, tag: str, default: bool, owner: str) -> bool:
    """Read a boolean child element.

    Args:
        parent: Element that may have the child.
        tag: The child's tag.
        default: Value if it is missing or empty.
        owner: Its owner, for messages.

    Raises:
        DescriptionError: If it has another value.
    """
    text = text_of(parent, tag).lower()
    if text and text not in _FLAGS:
        raise DescriptionError(
            f"The {tag} of {owner} must be true or false (got '{_short(text)}')."
        )
    return _FLAGS.get(text, default)


def numbers(label: str, text: str, count: int, least: int = 1) -> list[float]:
    """Read some numbers, which may still be NaN or infinite.

    Args:
        label: Their meaning, for messages.
        text: Numbers separated by white space; text after the needed ones, such as a
            unit, is ignored.
        count: Number of needed numbers.
        least: Least number of numbers.

    Raises:
        DescriptionError: If they are too few, or not numbers.
    """
    values: list[float] = []
    end = 0
    while len(values) < count:
        found = _NUMBER.match(text, end)
        if found is None:
            break
        values.append(float(found[0]))
        end = found.end()
    if len(values) < count and text[end:].strip():
        raise DescriptionError(f"The {label} must be a number (got '{_short(text)}').")
    if len(values) < least:
        raise DescriptionError(
            f"The {label} must have {least} numbers (got '{_short(text)}')."
        )
    return values


def filled(values: list[float], count: int) -> list[float]:
    """Fill up missing numbers as Gazebo does.

    Three numbers of a pose are its position; everything else becomes zero.
    """
    if len(values) == count:
        return values
    kept = values[:3] if count == _POSE and len(values) >= 3 else []
    return [*kept, *[0.0] * (count - len(kept))]


def read_as(label: str, text: str, count: int) -> str:
    """Describe how a text is read if it does not have exactly the needed numbers.

    Args:
        label: Their meaning.
        text: Text in the file, not empty.
        count: Number of needed numbers.

    Returns:
        A message; empty if the text is exact or an error.
    """
    words = text.split()
    if len(words) == count and all(_NUMBER.fullmatch(word) for word in words):
        return ""
    try:
        values = filled(numbers(label, text, count), count)
    except DescriptionError:
        return ""
    meant = " ".join(f"{value:g}" for value in values)
    return f"{label} is '{_short(text)}' and is read as {meant}"


def vector(
    parent: etree._Element | None,
    tag: str,
    default: Sequence[float],
    owner: str,
    least: float = -MAX_VALUE,
) -> np.ndarray:
    """Read a child element with the same number of numbers as its default.

    Args:
        parent: Element that may have the child; None has no children.
        tag: The child's tag.
        default: Value if it is missing or empty.
        owner: Its owner, for messages.
        least: Lower bound of each number.

    Returns:
        The numbers, shape (len(default),); missing ones are zero.

    Raises:
        DescriptionError: If they are not numbers, or out of bounds.
    """
    text, label, count = text_of(parent, tag), f"{tag} of {owner}", len(default)
    values = filled(numbers(label, text, count), count) if text else default
    return checked(f"the {label}", values, least)


def number(
    parent: etree._Element | None,
    tag: str,
    default: float,
    owner: str,
    least: float = -MAX_VALUE,
) -> float:
    """Read a child element with one number, like ``vector``."""
    return float(vector(parent, tag, [default], owner, least)[0])


def optional(parent: etree._Element | None, tag: str, owner: str) -> float | None:
    """Read a child element with one number of at least zero; None if missing."""
    return number(parent, tag, 0.0, owner, 0.0) if text_of(parent, tag) else None


def friction(label: str, text: str) -> float:
    """Read a coefficient of friction: a negative one is infinite, as in Gazebo.

    Args:
        label: Its meaning, for messages.
        text: One number.

    Raises:
        DescriptionError: If it is not a number.
    """
    mu = numbers(label, text, 1)[0]
    if mu < 0.0 or mu > MAX_VALUE:
        return np.inf
    return float(checked(f"the {label}", [mu])[0])


def unit(label: str, direction: np.ndarray) -> np.ndarray:
    """Scale a direction to unit length.

    Args:
        label: Its meaning, for messages.
        direction: Any vector, shape (n,).

    Raises:
        DescriptionError: If it is zero.
    """
    length = np.linalg.norm(direction)
    if length == 0.0:
        raise DescriptionError(f"The {label} must not be zero.")
    return direction / length


def pose_of(element: etree._Element, owner: str) -> tuple[np.ndarray, str]:
    """Read an element's pose.

    Args:
        element: A model, link, joint, frame, shape, inertial or light.
        owner: Name of the element, for messages.

    Returns:
        The pose, shape (7,), and the name of its reference frame, empty for the default
        frame of the element.

    Raises:
        DescriptionError: If it is not a pose.
    """
    pose, label = element.find("pose"), f"pose of {owner}"
    if pose is None:
        return IDENTITY, ""
    frame = pose.get("relative_to") or pose.get("frame") or ""
    text = (pose.text or "").strip()
    if not text:
        return IDENTITY, frame
    if pose.get("rotation_format") == "quat_xyzw":
        values = checked(f"the {label}", numbers(label, text, 7, least=7))
        return np.concatenate([values[:3], unit(label, values[3:])]), frame
    values = checked(f"the {label}", filled(numbers(label, text, _POSE), _POSE))
    degrees = _FLAGS.get(pose.get("degrees", "").lower(), False)
    rpy = np.radians(values[3:]) if degrees else values[3:]
    return np.concatenate([values[:3], from_rpy(rpy)]), frame


def _short(text: str) -> str:
    """Shorten a text for a message."""
    line = " ".join(text.split())
    return line if len(line) <= 40 else f"{line[:40]}..."
