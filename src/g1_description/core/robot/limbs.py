"""Which limb a joint belongs to, by the words in its name."""

from __future__ import annotations

import re
from collections.abc import Iterable

LIMBS = {
    "leg": ("hip", "thigh", "knee", "calf", "shin", "ankle", "foot", "toe", "leg"),
    "hand": ("hand", "finger", "thumb", "index", "middle", "ring", "little", "pinky"),
    "arm": ("shoulder", "upperarm", "elbow", "forearm", "wrist", "arm"),
    "waist": ("waist", "torso", "spine", "chest"),
    "head": ("head", "neck"),
}
"""Words that tell a limb, the first limb that fits counts: a hand has a wrist, too."""

OTHER = "joints"
"""The group of joints whose names tell nothing."""

_SIDES = {"left": "left ", "l": "left ", "right": "right ", "r": "right "}


def limb_of(name: str) -> str:
    """Name the limb of a joint, such as ``left leg``; ``joints`` if none is told."""
    words = re.findall("[a-z]+", name.lower())
    for limb, parts in LIMBS.items():
        if any(part in words for part in parts):
            sides = (_SIDES[word] for word in words if word in _SIDES)
            return next(sides, "") + limb
    return OTHER


def by_limb(names: Iterable[str]) -> dict[str, list[str]]:
    """Group joints by limb, in the order in which they come.

    Args:
        names: Of the joints.

    Returns:
        Names of joints by the name of their limb.
    """
    found: dict[str, list[str]] = {}
    for name in names:
        found.setdefault(limb_of(name), []).append(name)
    return found
