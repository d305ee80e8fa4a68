"""What was put into something else comes out of it slowly."""

from __future__ import annotations

from collections.abc import Mapping

from g1_description.sim.physics import PhysicsProperties

from .body import Body
from .client import BulletClient

PARTING = 0.3
"""What was put into each other parts at this speed at most, in [m/s]. ODE has such a
bound for each contact, Gazebo's ``max_vel``; its 0.01 m/s would be slow to watch, and
what is thrown at this speed rises by 5 mm."""

HARDNESS = 1e9
"""Stiffness times the time step, plus damping, of links whose part of ``erp`` is given:
so great that their contacts are as hard as others."""


class Parting:
    """Bounds the speed at which a contact takes back its depth.

    PyBullet takes back the part ``erp`` of it in each step, by a velocity that bodies
    keep. It has no bound for that, but a part for each link, by its contact stiffness
    and damping: a link that is deep in something gets less than the others.
    """

    def __init__(self, client: BulletClient) -> None:
        """Begin without a link that is deep in something."""
        self._client = client
        self._given: dict[tuple[int, int], tuple[float, float]] = {}
        self._looks = False

    def look(self) -> None:
        """Note that something may have been put into something else."""
        self._looks = True

    def forget(self, body: int) -> None:
        """Note that a body is gone, by its number in PyBullet."""
        self._given = {
            key: share for key, share in self._given.items() if key[0] != body
        }

    def bound(self, bodies: Mapping[int, Body], numbers: PhysicsProperties) -> None:
        """Give each link its part for the next step.

        Args:
            bodies: All bodies by their numbers in PyBullet.
            numbers: The physics' numbers.
        """
        if not (self._looks and numbers.step_ns):
            return
        self._client.performCollisionDetection()
        deepest: dict[tuple[int, int], float] = {}
        longest = PARTING * numbers.time_step
        for point in self._client.getContactPoints() or ():
            depth = -point[8]
            if numbers.erp * depth <= longest:
                continue
            for body, link in ((point[1], point[3]), (point[2], point[4])):
                if bodies[body].can_move(link):
                    deepest[body, link] = max(depth, deepest.get((body, link), 0.0))
                    break
        for key in {**self._given, **deepest}:
            share = longest / deepest[key] if key in deepest else numbers.erp
            if self._given.get(key) != (share, numbers.time_step):
                self._give(key, share, numbers.time_step)
        self._looks = bool(deepest)

    def _give(self, key: tuple[int, int], share: float, time_step: float) -> None:
        """Let the contacts of a link take back a part of their depth in each step."""
        body, link = key
        self._client.changeDynamics(
            body,
            link,
            contactStiffness=share * HARDNESS / time_step,
            contactDamping=(1.0 - share) * HARDNESS,
        )
        self._given[key] = share, time_step
