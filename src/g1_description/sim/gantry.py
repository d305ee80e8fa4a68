"""Ropes on which models hang, as robots do while their controllers are tried."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from g1_description.errors import InvalidValueError, UnknownNameError
from g1_description.robot.rotation import cross, rotate
from g1_description.sim.engine import Engine
from g1_description.sim.model import Model
from g1_description.text import listed, similar_first

HEIGHT = 3.0
"""Height in [m] of the point from which a rope hangs."""

FREQUENCY = 4.0 * np.pi
"""Natural frequency in [rad/s] of a model on its rope: it sags by 6 cm."""


@dataclass
class Rope:
    """A rope between a point and the center of mass of a link. It only pulls."""

    row: int
    """Row of the link in the model."""

    point: np.ndarray
    """In the world, in [m], shape (3,)."""

    length: float
    """Without load, in [m]."""


class Gantries:
    """The ropes of models, at most one each."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._ropes: dict[Model, Rope] = {}

    def hang(self, model: Model, link: str, length: float) -> float:
        """Hang a model from the point above a link, also one that hangs already.

        Args:
            model: The model.
            link: The link, which may be lumped into another one; empty: that of its
                rope, the torso of its profile, or its root.
            length: In [m]; 0: the link's distance from the point.

        Returns:
            The length in [m].

        Raises:
            InvalidValueError: If nothing moves the model, or the length is negative or
                above ``HEIGHT``.
            UnknownNameError: If it has no such link.
        """
        if not self._engine.is_dynamic:
            raise InvalidValueError("nothing falls in kinematic physics")
        if not model.trees or model.trees[0].fixed:
            raise InvalidValueError(f"the base of {model.name} is fixed")
        if not 0.0 <= length <= HEIGHT:
            raise InvalidValueError(
                f"length must be from 0 to {HEIGHT:g} m (got {length:g})"
            )
        rope = self._ropes.get(model)
        row = rope.row if rope and not link else _row(model, link)
        taut = abs(HEIGHT - float(_place(model, row)[0][2]))
        self._ropes[model] = Rope(row, np.zeros(3), length or taut)
        self.renew(model)
        return length or taut

    def renew(self, model: Model) -> None:
        """Hang a model that was placed elsewhere from the point above it there."""
        if model in self._ropes:
            rope = self._ropes[model]
            rope.point = np.array([*_place(model, rope.row)[0][:2], HEIGHT])

    def forget(self, model: Model) -> None:
        """Let a model go."""
        self._ropes.pop(model, None)

    def apply(self) -> None:
        """Pull the models for the next step."""
        for model, rope in self._ropes.items():
            place, velocity = _place(model, rope.row)
            span = rope.point - place
            distance = np.linalg.norm(span)
            stretch = distance - rope.length
            if stretch <= 0.0:
                continue
            along = span / distance
            pull = FREQUENCY**2 * stretch - 2.0 * FREQUENCY * (velocity @ along)
            inertials = [each.inertial for each in model.links.values()]
            mass = sum(inertial.mass for inertial in inertials if inertial)
            force = mass * max(pull, 0.0) * along
            link = model.link_names[rope.row]
            self._engine.apply_wrench(model, link, np.concatenate([force, np.zeros(3)]))


def _row(model: Model, link: str) -> int:
    """Find a link, or the one to hang a model by."""
    names = model.link_names
    torso = model.assembly.description.profile.links.get("torso", "")
    chosen = link or (torso if torso in names else names[0])
    lumped = model.assembly.lumped
    chosen = lumped.get(chosen, chosen)
    if chosen not in names:
        near = listed(similar_first(chosen, [*names, *lumped]))
        raise UnknownNameError(
            f"{model.name} has no link {chosen}. Known links: {near}"
        )
    return list(names).index(chosen)


def _place(model: Model, row: int) -> tuple[np.ndarray, np.ndarray]:
    """Compute position and velocity of a link's center of mass, each of shape (3,)."""
    pose, twist = model.poses[row], model.twists[row]
    lever = rotate(pose[3:], model.centers[row])
    return pose[:3] + lever, twist[:3] + cross(twist[3:], lever)
