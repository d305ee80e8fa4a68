"""Anchors and gantries, which hold models.

An anchor is a link that keeps its pose in the world while joints move, and the base
follows: only in ``kinematic`` physics, as in the others physics moves the base. On a
gantry a model hangs, as robots do while their controllers are tried.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from g1_description.errors import InvalidValueError, UnknownNameError
from g1_description.robot.assembly import SCOPE
from g1_description.robot.launch_arguments import FEET, LOWEST_FOOT
from g1_description.robot.rotation import conjugate, cross, normalized, rotate
from g1_description.robot.transform import compose, inverse
from g1_description.sim.engine import Engine
from g1_description.sim.model import Model
from g1_description.sim.standing import outlines
from g1_description.text import listed, similar_first

TOLERANCE = 1e-6
"""Height by which another foot must be lower to become the anchor, in [m]: rounding
errors must not change the anchor of a robot that squats on both feet."""

UP = np.array([0.0, 0.0, 1.0])


class Anchor:
    """A link of a model that keeps its pose in the world.

    Of several candidates it is the lowest one. If another one becomes lower, that keeps
    the place and rotation that it has then, at the height of the one before.
    """

    def __init__(self, model: Model, name: str) -> None:
        """Keep a link where it is now.

        Args:
            model: The model.
            name: The link, possibly scoped or on a fixed joint, or ``LOWEST_FOOT``.

        Raises:
            UnknownNameError: If there is no such link.
            InvalidValueError: If it is fixed to the world.
        """
        scope = model.name + SCOPE
        self.name = name[len(scope) :] if name.startswith(scope) else name
        self._model, name = model, self.name
        links = _known_feet(model) if name == LOWEST_FOOT else [name]
        names = [_body(model, link) for link in links]
        if not names:
            raise UnknownNameError(
                f"the profile of {model.name} has no feet; name a link instead of "
                f"{LOWEST_FOOT}"
            )
        self._rows = np.array([model.link_names.index(name) for name in names])
        tree = next(n for n, t in enumerate(model.trees) if self._rows[0] in t.links)
        if model.trees[tree].fixed:
            raise InvalidValueError(f"the base of {model.name} is fixed to the world")
        self._tree = tree
        several = names if len(names) > 1 else ()
        self._soles = [outlines(model.links[name]) for name in several]
        self.renew()

    def _heights(self, poses: np.ndarray) -> np.ndarray:
        """Compute the heights of the candidates' lowest points at some poses."""
        if not self._soles:
            return poses[:, 2]
        ups = rotate(conjugate(poses[:, 3:]), UP)
        lowest = [(p @ up - radii).min() for (p, radii), up in zip(self._soles, ups)]
        return poses[:, 2] + lowest

    def _keep(self, poses: np.ndarray) -> None:
        """Keep the lowest candidate at its pose; poses of all, shape (n, 7)."""
        heights = self._heights(poses)
        candidate = int(np.argmin(heights))
        self._row, self._height = self._rows[candidate], heights[candidate]
        self._pose = np.array(poses[candidate])
        self._pose[3:] = normalized(self._pose[3:])

    def renew(self) -> None:
        """Keep the link where it is now, after something else moved the robot."""
        model = self._model
        self._keep(model.poses[self._rows])
        if model.root_twists[self._tree].any():  # that of an earlier ``hold``
            model.set_root(self._tree, model.root_poses[self._tree], np.zeros(6))

    def hold(self) -> None:
        """Move the base so that the link stays, after joints moved."""
        # The target is kept and the base computed from it: nothing accumulates.
        poses, twists = self._model.states_in_roots()
        T_world_root = compose(self._pose, inverse(poses[self._row]))
        if len(self._rows) > 1:
            placed = compose(T_world_root, poses[self._rows])
            before = self._height
            if self._heights(placed).min() < before - TOLERANCE:
                self._keep(placed)
                self._pose[2] += before - self._height
                self._height = before
                T_world_root = compose(self._pose, inverse(poses[self._row]))
        linear, angular = -rotate(T_world_root[3:], twists[self._row].reshape(2, 3))
        linear = linear + cross(angular, T_world_root[:3] - self._pose[:3])
        twist = np.concatenate([linear, angular])
        self._model.set_root(self._tree, T_world_root, twist)


def _known_feet(model: Model) -> list[str]:
    """Return the feet in the profile of a model, which may be lumped links."""
    robot = model.assembly.description
    links = (robot.given_profile or robot.profile).links
    return [links[role] for role in FEET if role in links]


def _body(model: Model, link: str) -> str:
    """Return the body of a link, which may be lumped into another one.

    Raises:
        UnknownNameError: If there is no such link.
    """
    body = model.assembly.lumped.get(link, link)
    if body not in model.link_names:
        names = [*model.link_names, *model.assembly.lumped]
        names += [LOWEST_FOOT] if _known_feet(model) else []
        known = listed(similar_first(link, names))
        raise UnknownNameError(
            f"{model.name} has no link '{link}'; known anchors: {known}"
        )
    return body


class Anchors:
    """The anchors of a world's models."""

    def __init__(self, physics: str) -> None:
        self._physics = physics
        self._anchors: dict[Model, Anchor] = {}

    def name(self, model: Model) -> str:
        """Return the name of a model's anchor; empty without one."""
        return self._anchors[model].name if model in self._anchors else ""

    def set(self, model: Model, name: str) -> None:
        """Keep a link of a model where it is now.

        Args:
            model: The model.
            name: The link, or ``LOWEST_FOOT``; empty: none any more.

        Raises:
            UnknownNameError: If there is no such link; nothing is changed.
            InvalidValueError: If physics moves the base, or it is fixed.
        """
        if not name:
            self.renew(model)  # it may be moving
            self.forget(model)
        elif self._physics != "kinematic":
            raise InvalidValueError(
                f"an anchor needs kinematic physics; in {self._physics} physics moves "
                "the base"
            )
        else:
            self._anchors[model] = Anchor(model, name)

    def __bool__(self) -> bool:
        return bool(self._anchors)

    def hold(self, model: Model) -> None:
        """Move the base of a model so that its anchor stays, after joints moved."""
        if model in self._anchors:
            self._anchors[model].hold()

    def renew(self, model: Model) -> None:
        """Keep the anchor of a model where it is now."""
        if model in self._anchors:
            self._anchors[model].renew()

    def forget(self, model: Model) -> None:
        """Remove the anchor of a model."""
        self._anchors.pop(model, None)


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

    def __bool__(self) -> bool:
        return bool(self._ropes)

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
