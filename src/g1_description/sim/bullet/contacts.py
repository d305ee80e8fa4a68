"""Limit of the speed at which overlapping links separate."""

from __future__ import annotations

from collections.abc import Mapping

from g1_description.sim.bullet.body import Body
from g1_description.sim.bullet.client import BulletClient
from g1_description.sim.engine import PhysicsProperties

MAX_DEPENETRATION_SPEED = 0.3
"""Largest speed at which overlapping links separate, in [m/s]. ODE has such a bound per
contact, Gazebo's ``max_vel`` of 0.01 m/s, which is slow to watch; an object thrown at
this speed rises by 5 mm."""

CONTACT_HARDNESS = 1e9
"""Stiffness times the time step, plus damping, of links with their own ``erp``: large
enough that their contacts are as hard as others."""


class DepenetrationLimiter:
    """Bounds the speed at which contacts push overlapping links apart.

    In each step PyBullet corrects the fraction ``erp`` of an overlap, by a velocity
    that bodies keep. It has no bound for it, but contact stiffness and damping set a
    fraction per link: deep links get a smaller one.
    """

    def __init__(self, client: BulletClient) -> None:
        self._client = client
        self._given: dict[tuple[int, int], tuple[float, float]] = {}
        self._may_overlap = False

    def expect_overlaps(self) -> None:
        """Record that a change may have caused an overlap."""
        self._may_overlap = True

    def forget(self, body: int) -> None:
        """Forget a removed body, by its number in PyBullet."""
        self._given = {key: erp for key, erp in self._given.items() if key[0] != body}

    def apply(self, bodies: Mapping[int, Body], properties: PhysicsProperties) -> None:
        """Set each link's ``erp`` for the next step.

        Args:
            bodies: All bodies by their numbers in PyBullet.
            properties: The physics properties.
        """
        if not (self._may_overlap and properties.step_ns):
            return
        time_step = properties.time_step
        distance = MAX_DEPENETRATION_SPEED * time_step
        deepest = self._deep_links(bodies, properties.erp, distance)
        for key in {**self._given, **deepest}:
            erp = distance / deepest[key] if key in deepest else properties.erp
            if self._given.get(key) != (erp, time_step):
                self._set_erp(key, erp, time_step)
        self._may_overlap = bool(deepest)

    def _deep_links(
        self, bodies: Mapping[int, Body], erp: float, distance: float
    ) -> dict[tuple[int, int], float]:
        """Find the links that PyBullet would push by more than a distance in a step.

        Returns:
            The largest depth in [m] by PyBullet's numbers of body and link, assigned to
            the first movable link of each pair.
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

    def _set_erp(self, key: tuple[int, int], erp: float, time_step: float) -> None:
        """Set the fraction of the depth that a link's contacts correct per step."""
        body, link = key
        self._client.changeDynamics(
            body,
            link,
            contactStiffness=erp * CONTACT_HARDNESS / time_step,
            contactDamping=(1.0 - erp) * CONTACT_HARDNESS,
        )
        self._given[key] = erp, time_step
