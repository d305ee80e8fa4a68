"""Objects that links carry in PyBullet: fixed constraints."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from g1_description.robot.transform import compose, inverse
from g1_description.sim.bullet.body import Body
from g1_description.sim.bullet.client import BulletClient
from g1_description.sim.grip import Grip

MAX_IMPULSE = 1e5
"""Of a constraint in a step, in [N s]: more than any load needs."""


class Grips:
    """The constraints, and the pairs of links that pass through each other."""

    def __init__(self, client: BulletClient) -> None:
        self._client = client
        self._constraints: list[int] = []
        self._pairs: list[tuple[int, int, int, int]] = []

    def release(self) -> None:
        """Remove all constraints; to be called while their bodies exist."""
        for number in self._constraints:
            self._client.removeConstraint(number)
        for pair in self._pairs:
            self._client.setCollisionFilterPair(*pair, 1)
        self._constraints, self._pairs = [], []

    def fix(self, grips: Iterable[Grip], bodies: Mapping[str, Sequence[Body]]) -> None:
        """Fix objects to links.

        Args:
            grips: The objects.
            bodies: The bodies of models by name.
        """
        for grip in grips:
            link = _find(bodies[grip.carrier.name], grip.link)
            root = _find(bodies[grip.carried.name], grip.root)
            in_link = compose(inverse(self._center(*link)), grip.pose)
            in_root = inverse(self._center(*root))
            number = self._client.createConstraint(
                *link,
                *root,
                self._client.JOINT_FIXED,
                [0.0, 0.0, 0.0],
                in_link[:3].tolist(),
                in_root[:3].tolist(),
                in_link[3:].tolist(),
                in_root[3:].tolist(),
            )
            self._client.changeConstraint(number, maxForce=MAX_IMPULSE)
            self._constraints.append(number)
            pair = link[0], root[0], link[1], root[1]
            self._client.setCollisionFilterPair(*pair, 0)
            self._pairs.append(pair)

    def _center(self, body: int, link: int) -> np.ndarray:
        """Return the principal axes of a link in its frame, shape (7,)."""
        return np.concatenate(self._client.getDynamicsInfo(body, link)[3:5])


def _find(bodies: Sequence[Body], name: str) -> tuple[int, int]:
    """Return PyBullet's numbers of the body and link of a name."""
    return next(
        (body.number, index)
        for body in bodies
        for index, link in body.link_names.items()
        if link == name
    )
