"""The speed at which overlapping links part."""

from __future__ import annotations

from collections.abc import Mapping

from g1_description.sim.bullet.body import Body
from g1_description.sim.bullet.client import BulletClient
from g1_description.sim.engine import PhysicsProperties

MAX_DEPENETRATION_SPEED = 0.3
"""Greatest speed at which links that overlap part, in [m/s]. ODE has such a bound for
each contact, Gazebo's ``max_vel``; its 0.01 m/s would be slow to watch, and a
thing thrown at this speed rises by 5 mm."""

CONTACT_HARDNESS = 1e9
"""Stiffness times the time step, plus damping, of links whose part of ``erp`` is given:
so great that their contacts are as hard as others."""


class DepenetrationLimiter:
    """Bounds the speed at which contacts push overlapping links apart.

    In each step PyBullet takes back the part ``erp`` of an overlap, by a velocity that
    bodies keep. It has no bound for that, but a part for each link, by its contact
    stiffness and damping: a link that is deep in something gets less than the others.
    """

    def __init__(self, client: BulletClient) -> None:
        self._client = client
        self._given: dict[tuple[int, int], tuple[float, float]] = {}
        self._may_overlap = False

    def expect_overlaps(self) -> None:
        """Note that something may have been put into something else."""
        self._may_overlap = True

    def forget(self, body: int) -> None:
        """Note that a body is gone, by its number in PyBullet."""
        self._given = {key: part for key, part in self._given.items() if key[0] != body}

    def apply(self, bodies: Mapping[int, Body], properties: PhysicsProperties) -> None:
        """Set each link's part of ``erp`` for the next step.

        Args:
            bodies: All bodies by their numbers in PyBullet.
            properties: The physics' numbers.
        """
        if not (self._may_overlap and properties.step_ns):
            return
        time_step = properties.time_step
        distance = MAX_DEPENETRATION_SPEED * time_step
        deepest = self._deep_links(bodies, properties.erp, distance)
        for key in {**self._given, **deepest}:
            part = distance / deepest[key] if key in deepest else properties.erp
            if self._given.get(key) != (part, time_step):
                self._set_part(key, part, time_step)
        self._may_overlap = bool(deepest)

    def _deep_links(
        self, bodies: Mapping[int, Body], erp: float, distance: float
    ) -> dict[tuple[int, int], float]:
        """Find the links that PyBullet would push by more than a distance in a step.

        Returns:
            The greatest depth in [m] by PyBullet's numbers of body and link; of each
            pair the first link that can move is the one.
        """
        self._client.performCollisionDetection()
        deepest: dict[tuple[int, int], float] = {}
        for point in self._client.getContactPoints() or ():
            depth = -point[8]
            if erp * depth <= distance:
                continue
            for body, link in ((point[1], point[3]), (point[2], point[4])):
                if bodies[body].can_move(link):
                    deepest[body, link] = max(depth, deepest.get((body, link), 0.0))
                    break
        return deepest

    def _set_part(self, key: tuple[int, int], part: float, time_step: float) -> None:
        """Set the part of their depth that a link's contacts take back in each step."""
        body, link = key
        self._client.changeDynamics(
            body,
            link,
            contactStiffness=part * CONTACT_HARDNESS / time_step,
            contactDamping=(1.0 - part) * CONTACT_HARDNESS,
        )
        self._given[key] = part, time_step
