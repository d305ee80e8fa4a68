"""Objects that links carry.

In ``kinematic`` physics an object is placed where its link is; in the others the engine
fixes it to the link, so that its mass counts.
"""

from __future__ import annotations

from typing import Dict, Tuple

import numpy as np

from g1_description.errors import InvalidValueError, UnknownNameError
from g1_description.robot.assembly import SCOPE
from g1_description.sim.engine import Engine
from g1_description.sim.grip import Grip
from g1_description.sim.model import Model
from g1_description.text import listed, similar_first

Carriers = Dict[Tuple[Model, int], Tuple[Model, str]]
"""Models and links that carry the trees of models; links by the names that were given.
"""


class Attachments:
    """The objects that are carried in a world."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._grips: dict[tuple[Model, int], Grip] = {}
        self.changes = 0
        """How often objects were attached or let go."""

    def __bool__(self) -> bool:
        return bool(self._grips)

    def carriers(self) -> Carriers:
        """Return what carries objects."""
        return {key: (grip.carrier, grip.given) for key, grip in self._grips.items()}

    def attach(self, carried: Model, link: str, carrier: Model, to: str) -> None:
        """Let a link carry an object as it is now, also one that another link carries.

        Args:
            carried: The model of the object.
            link: Name of its link; empty: its only one.
            carrier: The model that carries it.
            to: The link that carries it, possibly lumped into another one, or a role of
                the robot's profile.

        Raises:
            UnknownNameError: If there is no such link.
            InvalidValueError: If it cannot be carried by that.
        """
        tree = tree_of(carried, link)
        row = link_row(carrier, to)
        if carried.trees[tree].fixed and self._engine.is_dynamic:
            raise InvalidValueError(
                f"{carried.name} is static; in physics only objects with a mass can be "
                "carried"
            )
        if carrier in self._carried_by(carried):
            raise InvalidValueError(f"{carrier.name} is carried by {carried.name}")
        grip = Grip(carrier, row, carried, tree, np.zeros(7), to).renewed()
        self._grips.pop((carried, tree), None)
        self._grips[carried, tree] = grip
        in_order = sorted(self._grips.items(), key=lambda item: self._depth(item[1]))
        self._grips = dict(in_order)
        self._change()

    def _depth(self, grip: Grip) -> int:
        """Count what carries the carrier of a grip, which follows before it."""
        others = (each.carried for each in self._grips.values())
        return sum(grip.carrier in self._carried_by(other) for other in others)

    def _carried_by(self, model: Model) -> set[Model]:
        """Collect a model, and all that it carries, directly or not."""
        found, waiting = {model}, [model]
        for each in waiting:
            for grip in self._grips.values():
                if grip.carrier is each and grip.carried not in found:
                    found.add(grip.carried)
                    waiting.append(grip.carried)
        return found

    def detach(self, carried: Model, link: str = "") -> None:
        """Let an object go.

        Raises:
            UnknownNameError: If there is no such link.
            InvalidValueError: If no link carries it.
        """
        tree = tree_of(carried, link)
        if (carried, tree) not in self._grips:
            raise InvalidValueError(f"no link carries {link or carried.name}")
        del self._grips[carried, tree]
        if not self._engine.is_dynamic:
            pose = carried.root_poses[tree]
            carried.set_root(tree, pose, np.zeros(6))
        self._change()

    def forget(self, model: Model) -> None:
        """Let go all that a model carries, and the model."""
        left = {
            key: grip
            for key, grip in self._grips.items()
            if model not in (grip.carrier, grip.carried)
        }
        if len(left) < len(self._grips):
            self._grips = left
            self._change()

    def clear(self) -> None:
        """Let everything go."""
        if self._grips:
            self._grips = {}
            self._change()

    def _change(self) -> None:
        """Count that objects were attached or let go."""
        self.changes += 1
        self._write()

    def _write(self) -> None:
        """Give the grips to the engine."""
        self._engine.fix([*self._grips.values()])

    def follow(self) -> None:
        """Move objects with their links, after models moved without physics."""
        for grip in self._grips.values():
            grip.follow()
            self._engine.write(grip.carried)

    def renew(self, model: Model) -> None:
        """Keep an object that was placed elsewhere there, in the frame of its link.

        All that is carried follows.
        """
        if not self._grips:
            return
        own = [key for key in self._grips if key[0] is model]
        for key in own:
            self._grips[key] = self._grips[key].renewed()
        if own:
            self._write()
        self.follow()


def tree_of(model: Model, link: str) -> int:
    """Find the tree of an object.

    Args:
        model: Its model.
        link: Name of its link; empty: the only one of the model.

    Raises:
        UnknownNameError: If there is no such link.
        InvalidValueError: If the model has several trees and none is named.
    """
    names = list(model.link_names)
    if link and link not in names:
        near = listed(similar_first(link, names))
        raise UnknownNameError(f"{model.name} has no link {link}; its links are {near}")
    if not link and len(model.trees) != 1:
        parts = listed(f"{model.name}{SCOPE}{name}" for name in names) or "none"
        raise InvalidValueError(
            f"{model.name} is not one object; the objects of it are {parts}"
        )
    row = names.index(link) if link else 0
    return next(n for n, tree in enumerate(model.trees) if row in tree.links)


def link_row(model: Model, link: str) -> int:
    """Find the row of a link, of a lumped one or of a role.

    Raises:
        UnknownNameError: If there is none.
    """
    robot = model.assembly.description
    roles = (robot.given_profile or robot.profile).links
    lumped, names = model.assembly.lumped, list(model.link_names)
    known = link if link in names or link in lumped else roles.get(link, link)
    body = lumped.get(known, known)
    if body not in names:
        near = listed(similar_first(link, [*roles, *names, *lumped]))
        raise UnknownNameError(
            f"{model.name} has no link {link}. Its roles and links: {near}"
        )
    return names.index(body)
