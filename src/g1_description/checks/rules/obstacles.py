"""Links, and objects that they carry, that overlap objects or are near them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from g1_description.checks import surroundings
from g1_description.checks.intervals import runs
from g1_description.checks.measured import Measured
from g1_description.checks.rule import Rule
from g1_description.checks.rules.self_collision import per_pair
from g1_description.checks.thresholds import Level
from g1_description.checks.verdict import BY_LIMBS, Finding


def _pairs(
    measured: Measured,
) -> Iterator[tuple[tuple[str, str], np.ndarray, np.ndarray]]:
    """Sort contacts with objects by pair."""
    obstacles, near = measured.robot.obstacles, measured.near_objects
    assert obstacles is not None and near is not None
    return per_pair(measured, near, obstacles.pairs)


def _collisions(rule: Rule, measured: Measured) -> Iterator[Finding | None]:
    """Find what overlaps objects."""
    for pair, distances, points in _pairs(measured):
        text = f"{pair[0]} penetrates {pair[1]} by {{worst:.4g}} m{{when}}"
        yield rule.compared(measured, pair, -distances, text, points=points)


def distances_of(
    measured: Measured,
) -> list[tuple[tuple[str, str], np.ndarray, np.ndarray]]:
    """Find distances from objects as `clearance` compares them.

    Distances of an object from what it is taken off or put on do not count while it
    gets away from that, or comes nearer.

    Returns:
        As ``per_pair`` yields it; distances are at least 0, or NaN.
    """
    found = []
    for pair, distances, points in _pairs(measured):
        if pair[0] not in measured.robot.links:
            for first, last in runs(~np.isnan(distances)):
                near = distances[first : last + 1]
                for course in (near, near[::-1]):
                    _leave(course, measured.robot.thresholds.contact_height)
        found.append((pair, np.maximum(distances, 0.0), points))
    return found


def _leave(distances: np.ndarray, touching: float) -> None:
    """Set distances to NaN until an object is away from what it touches at first."""
    if distances[0] <= touching:
        with np.errstate(invalid="ignore"):
            rises = np.append(np.diff(distances) > 0.0, False)
            stays = (distances > touching) & ~rises
        distances[: np.argmax(stays) if stays.any() else len(stays)] = np.nan


def _clearances(rule: Rule, measured: Measured) -> Iterator[Finding | None]:
    """Find what is too near objects."""
    for pair, distances, points in measured.once(distances_of):
        text = f"{pair[0]} is {{worst:.4g}} m from {pair[1]}{{when}}"
        yield rule.compared(measured, pair, distances, text, points=points)


COLLISION = Rule(
    name="collision",
    about="[links and carried objects that overlap objects](scenes.md#checked)",
    level=Level(0.001, 0.005),
    limit="m, depth in an object; with --scene",
    unit="m",
    find=_collisions,
    needs=("objects",),
    requires="a scene, base",
    namespace="contacts",
    grouping=BY_LIMBS,
    reddens=True,
)
CLEARANCE = Rule(
    name=surroundings.CLEARANCE,
    about="links and carried objects that are too near objects",
    level=Level(None, None),
    limit="m, least distance from an object; with --scene",
    unit="m",
    find=_clearances,
    needs=("objects",),
    requires="a scene, base, a threshold",
    lower_is_worse=True,
    namespace="clearance",
    grouping=BY_LIMBS,
)
