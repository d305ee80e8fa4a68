"""Which links touch."""

from __future__ import annotations

from collections.abc import Iterable

from g1_description.core.robot.assembly import SCOPE

from .body import Body
from .client import BulletClient


def contacts(client: BulletClient, bodies: Iterable[Body]) -> set[tuple[str, str]]:
    """Find the pairs of links that touch or overlap now.

    Links of the same model don't collide, as in Gazebo; things that are fixed to
    the world don't collide with each other.

    Args:
        client: PyBullet.
        bodies: All bodies.

    Returns:
        Pairs of ``model::link``, each pair once, in alphabetical order.
    """
    client.performCollisionDetection()
    owner = {body.number: body for body in bodies}
    pairs = set()
    for point in client.getContactPoints() or ():
        first, second = sorted(
            f"{owner[number].model.name}{SCOPE}{owner[number].link_of(link)}"
            for number, link in ((point[1], point[3]), (point[2], point[4]))
        )
        if point[8] <= 0.0:
            pairs.add((first, second))
    return pairs
