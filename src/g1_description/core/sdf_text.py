"""Numbers, flags, names and poses out of the elements of an SDF document.

Whatever is missing or empty has SDF's default; whatever is wrong is refused with
the place where it stands.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from lxml import etree

from .bounds import checked
from .errors import LARGEST, DescriptionError
from .rotation import from_rpy
from .transform import IDENTITY

_FLAGS = {"true": True, "1": True, "false": False, "0": False}


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


def numbers(what: str, text: str, counts: Sequence[int]) -> list[float]:
    """Read some numbers, which may still be NaN or infinite.

    Args:
        what: What they are, for the sentences.
        text: Numbers with white space between them.
        counts: How many there may be.

    Raises:
        DescriptionError: If they are too many, too few, or no numbers.
    """
    try:
        values = [float(part.replace("_", "?")) for part in text.split()]
    except ValueError as error:
        raise DescriptionError(
            f"The {what} is '{_short(text)}', which is not a number."
        ) from error
    if len(values) not in counts:
        raise DescriptionError(
            f"The {what} is '{_short(text)}', which has {len(values)} numbers; "
            f"needed: {' or '.join(str(count) for count in counts)}."
        )
    return values


def vector(
    parent: etree._Element | None,
    tag: str,
    default: Sequence[float],
    owner: str,
    least: float = -LARGEST,
) -> np.ndarray:
    """Read a child element with as many numbers as its default has.

    Args:
        parent: Element that may have the child; None has no children.
        tag: The child's tag.
        default: What counts where it is missing or empty.
        owner: Whose it is, for the sentences.
        least: Lower bound of each number.

    Returns:
        The numbers, shape (len(default),).

    Raises:
        DescriptionError: If they are too many, too few, none, or out of bounds.
    """
    text, what = text_of(parent, tag), f"{tag} of {owner}"
    values = numbers(what, text, [len(default)]) if text else default
    return checked(f"the {what}", values, least)


def number(
    parent: etree._Element | None,
    tag: str,
    default: float,
    owner: str,
    least: float = -LARGEST,
) -> float:
    """Read a child element with one number, like ``vector``."""
    return float(vector(parent, tag, [default], owner, least)[0])


def optional(parent: etree._Element | None, tag: str, owner: str) -> float | None:
    """Read a child element with one number from zero up; None where it is missing."""
    return number(parent, tag, 0.0, owner, 0.0) if text_of(parent, tag) else None


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
        values = checked(f"the {what}", numbers(what, text, [7]))
        return np.concatenate([values[:3], unit(what, values[3:])]), frame
    values = checked(f"the {what}", numbers(what, text, [6]))
    degrees = _FLAGS.get(pose.get("degrees", "").lower(), False)
    rpy = np.radians(values[3:]) if degrees else values[3:]
    return np.concatenate([values[:3], from_rpy(rpy)]), frame


def _short(text: str) -> str:
    """Cut a text to what fits into a sentence."""
    line = " ".join(text.split())
    return line if len(line) <= 40 else f"{line[:40]}..."
