"""Numbers, flags, names and poses out of the elements of an SDF document.

Whatever is missing or empty has SDF's default; numbers are read as C++'s streams
do it, which libsdformat uses; whatever is wrong is refused with the place where it
stands.
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
    """Give an element's name.

    Raises:
        DescriptionError: If it has none.
    """
    name = element.get("name", "")
    if not name:
        raise DescriptionError(f"A {element.tag} of the SDF has no name.")
    return name


def text_of(parent: etree._Element | None, tag: str) -> str:
    """Give the text of a child element, empty where there is none."""
    found = None if parent is None else parent.find(tag)
    return "" if found is None else (found.text or "").strip()


def flag(parent: etree._Element, tag: str, default: bool, owner: str) -> bool:
    """Read a child element that says true or false.

    Args:
        parent: Element that may have the child.
        tag: The child's tag.
        default: What counts where it is missing or empty.
        owner: Whose it is, for the sentence.

    Raises:
        DescriptionError: If it says anything else.
    """
    text = text_of(parent, tag).lower()
    if text and text not in _FLAGS:
        raise DescriptionError(
            f"The {tag} of {owner} is '{_short(text)}', neither true nor false."
        )
    return _FLAGS.get(text, default)


def numbers(what: str, text: str, count: int, least: int = 1) -> list[float]:
    """Read some numbers, which may still be NaN or infinite.

    Args:
        what: What they are, for the sentences.
        text: Numbers with white space between them; what follows the last one that
            is needed is passed over, such as a unit.
        count: How many are needed.
        least: How many there must be.

    Raises:
        DescriptionError: If they are too few, or no numbers.
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
        raise DescriptionError(
            f"The {what} is '{_short(text)}', which is not a number."
        )
    if len(values) < least:
        raise DescriptionError(
            f"The {what} is '{_short(text)}', which has {len(values)} numbers; "
            f"needed: {least}."
        )
    return values


def filled(values: list[float], count: int) -> list[float]:
    """Make as many numbers as are needed of too few, as Gazebo does.

    A pose of three is a position; all else becomes zero.
    """
    if len(values) == count:
        return values
    kept = values[:3] if count == _POSE and len(values) >= 3 else []
    return [*kept, *[0.0] * (count - len(kept))]


def read_as(what: str, text: str, count: int) -> str:
    """Say how a text is read that has more, or less, than the numbers needed.

    Args:
        what: What they are.
        text: As it stands in the file, not empty.
        count: How many are needed.

    Returns:
        A message, empty where the text is as it should be or is refused.
    """
    words = text.split()
    if len(words) == count and all(_NUMBER.fullmatch(word) for word in words):
        return ""
    try:
        values = filled(numbers(what, text, count), count)
    except DescriptionError:
        return ""
    meant = " ".join(f"{value:g}" for value in values)
    return f"{what} is '{_short(text)}' and is read as {meant}"


def vector(
    parent: etree._Element | None,
    tag: str,
    default: Sequence[float],
    owner: str,
    least: float = -MAX_VALUE,
) -> np.ndarray:
    """Read a child element with as many numbers as its default has.

    Args:
        parent: Element that may have the child; None has no children.
        tag: The child's tag.
        default: What counts where it is missing or empty.
        owner: Whose it is, for the sentences.
        least: Lower bound of each number.

    Returns:
        The numbers, shape (len(default),); zero where they are too few.

    Raises:
        DescriptionError: If they are no numbers, or out of bounds.
    """
    text, what, count = text_of(parent, tag), f"{tag} of {owner}", len(default)
    values = filled(numbers(what, text, count), count) if text else default
    return checked(f"the {what}", values, least)


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
    """Read a child element with one number from zero up; None where it is missing."""
    return number(parent, tag, 0.0, owner, 0.0) if text_of(parent, tag) else None


def friction(what: str, text: str) -> float:
    """Read a coefficient of friction: a negative one is infinite, as in Gazebo.

    Args:
        what: What it is, for the sentences.
        text: One number.

    Raises:
        DescriptionError: If it is no number.
    """
    mu = numbers(what, text, 1)[0]
    if mu < 0.0 or mu > MAX_VALUE:
        return np.inf
    return float(checked(f"the {what}", [mu])[0])


def unit(what: str, direction: np.ndarray) -> np.ndarray:
    """Scale a direction to unit length.

    Args:
        what: Whose it is, for the sentence.
        direction: Any vector, shape (n,).

    Raises:
        DescriptionError: If it is zero.
    """
    length = np.linalg.norm(direction)
    if length == 0.0:
        raise DescriptionError(f"The {what} is zero and so has no direction.")
    return direction / length


def pose_of(element: etree._Element, owner: str) -> tuple[np.ndarray, str]:
    """Read an element's pose.

    Args:
        element: A model, link, joint, frame, shape, inertial or light.
        owner: What it is called, for the sentences.

    Returns:
        The pose, shape (7,), and the name of the frame it is written in, empty
        where the file leaves that to the kind of element.

    Raises:
        DescriptionError: If it is no pose.
    """
    pose, what = element.find("pose"), f"pose of {owner}"
    if pose is None:
        return IDENTITY, ""
    frame = pose.get("relative_to") or pose.get("frame") or ""
    text = (pose.text or "").strip()
    if not text:
        return IDENTITY, frame
    if pose.get("rotation_format") == "quat_xyzw":
        values = checked(f"the {what}", numbers(what, text, 7, least=7))
        return np.concatenate([values[:3], unit(what, values[3:])]), frame
    values = checked(f"the {what}", filled(numbers(what, text, _POSE), _POSE))
    degrees = _FLAGS.get(pose.get("degrees", "").lower(), False)
    rpy = np.radians(values[3:]) if degrees else values[3:]
    return np.concatenate([values[:3], from_rpy(rpy)]), frame


def _short(text: str) -> str:
    """Cut a text to what fits into a sentence."""
    line = " ".join(text.split())
    return line if len(line) <= 40 else f"{line[:40]}..."
