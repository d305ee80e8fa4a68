"""Links that overlap, and distances between links."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from g1_description.checks.measured import CheckedRobot, Measured
from g1_description.checks.rule import Rule
from g1_description.checks.thresholds import Level
from g1_description.checks.verdict import BY_LIMBS, Finding
from g1_description.collisions.contacts import Contacts


def per_pair(
    measured: Measured, contacts: Contacts, pairs: Sequence[tuple[str, str]]
) -> Iterator[tuple[tuple[str, str], np.ndarray, np.ndarray]]:
    """Sort contacts by the pair of links, or of a link and an object.

    Args:
        measured: The motion.
        contacts: Contacts of all its times.
        pairs: Names of the pairs of the contacts.

    Yields:
        Both names; distances in [m], negative where they overlap, shape (n,); nearest
        or deepest points of both in the map, in [m], shape (n, 2, 3). NaN without a
        contact.
    """
    n_samples = len(measured.times)
    for pair in np.unique(contacts.pair).tolist():
        found = contacts[np.flatnonzero(contacts.pair == pair)]
        distances, points = (
            np.full(n_samples, np.nan),
            np.full((n_samples, 2, 3), np.nan),
        )
        distances[found.sample] = found.distance
        points[found.sample, 0], points[found.sample, 1] = (
            found.points_a,
            found.points_b,
        )
        yield pairs[pair], distances, points


def _measure(robot: CheckedRobot, link_poses: np.ndarray) -> Contacts:
    return robot.collisions.contacts(link_poses)


def _find(rule: Rule, measured: Measured) -> Iterator[Finding | None]:
    """Find links that overlap."""
    pairs = measured.robot.collisions.pairs
    for pair, distances, points in per_pair(measured, measured.own[rule.name], pairs):
        text = f"{pair[0]} penetrates {pair[1]} by {{worst:.4g}} m{{when}}"
        yield rule.compared(measured, pair, -distances, text, points=points)


SELF_COLLISION = Rule(
    name="self_collision",
    about="[links that overlap](self_collision.md)",
    level=Level(0.001, 0.005),
    limit="m, depth",
    unit="m",
    find=_find,
    needs=("pairs",),
    requires="shapes",
    measure=_measure,
    namespace="contacts",
    grouping=BY_LIMBS,
    reddens=True,
)
