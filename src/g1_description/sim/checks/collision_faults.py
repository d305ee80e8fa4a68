"""Self-collisions of a motion, pair by pair."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from g1_description.core.checks.verdict import Fault
from g1_description.sim.collisions.shape_collisions import Contacts


def collision_faults(
    contacts: Contacts, pairs: Sequence[tuple[str, str]], n_samples: int
) -> Iterator[Fault]:
    """Sort contacts by the pair of links that touch.

    Args:
        contacts: Of all samples.
        pairs: Names of the links of each pair.
        n_samples: How many samples the motion has.

    Returns:
        A fault per pair that touches; its points are those of both links.
    """
    for pair in np.unique(contacts.pair):
        rows = np.flatnonzero(contacts.pair == pair)
        sizes = np.full(n_samples, -np.inf)
        np.maximum.at(sizes, contacts.frame[rows], -contacts.distance[rows])
        points = np.full((n_samples, 2, 3), np.nan)
        is_deepest = -contacts.distance[rows] == sizes[contacts.frame[rows]]
        deep = rows[is_deepest]
        points[contacts.frame[deep], 0] = contacts.points_a[deep]
        points[contacts.frame[deep], 1] = contacts.points_b[deep]
        first, second = pairs[pair]
        text = f"{first} is {{worst:.4g}} m deep in {second} at {{time:.3f}} s"
        yield Fault("self_collision", pairs[pair], sizes, "m", text, points)


def deepest(contacts: Contacts | None, n_samples: int) -> np.ndarray:
    """Return the depth of the deepest contact of each sample in [m].

    Zero where there is none; NaN where contacts were not looked for.
    """
    if contacts is None:
        return np.full(n_samples, np.nan)
    depth = np.zeros(n_samples)
    np.maximum.at(depth, contacts.frame, -contacts.distance)
    return depth
