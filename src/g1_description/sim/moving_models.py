"""States of all moving models, read from an engine in one batch, and their rest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Callable, Optional, Tuple

import numpy as np

from g1_description.robot.assembly import SCOPE
from g1_description.robot.description import Description, Joint, Link
from g1_description.robot.kinematics import Kinematics
from g1_description.sim.model import Model, States

REST_SPEED = 1e-5
"""Largest speed of a joint or root at rest, in [m/s] or [rad/s]: above the solver's
noise in a stack of boxes, far below anything visible."""

REST_TIME = 0.1
"""Time at rest before the world sleeps, in [s] of simulated time: a pendulum at its
turning point is slower than REST_SPEED for less."""


Read = Callable[[], Tuple[States, States, Optional[Callable[[], States]]]]
"""Reads poses, shape (n_trees, 7), and twists, shape (n_trees, 6), of all roots, and
positions and velocities, shape (n_joints,), of all joints from an engine; also a
function that computes those of all links then, if the engine has a faster one."""


class MovingModels:
    """The moving models of a world, concatenated in common arrays.

    A world has dozens of small ones, for which numpy's overhead per call dominates.
    """

    def __init__(self, models: Sequence[Model], read: Read) -> None:
        """Create the arrays.

        Args:
            models: The models.
            read: Reads their roots and joints in this order.
        """
        self._models, self._read = models, read
        self._roots = _slices([len(model.trees) for model in models])
        self._joints = _slices([len(model.joint_names) for model in models])
        self._links = _slices([len(model.link_names) for model in models])
        self._rates: States = np.zeros((1, 6)), np.zeros(0)
        self._measured: list[tuple[States, States, Callable[[], States]]] = []
        self._kinematics: Kinematics | None = None

    def _link_states(self, state: Sequence[States]) -> States:
        """Compute poses and twists of all links."""
        if self._kinematics is None:
            forest, self._of_forest = _joined(self._models)
            self._kinematics = Kinematics(forest)
        (roots, root_twists), (position, velocity) = state
        found = self._kinematics.link_states(roots, position, root_twists, velocity)
        return found[0][self._of_forest], found[1][self._of_forest]

    def read(self) -> None:
        """Read the state of all models; ``update_models`` applies it."""
        if not self._models:
            return
        *state, compute = self._read()
        (roots, root_twists), (position, velocity) = state
        states: list[States] = []

        def links(rows: slice) -> States:
            if not states:  # computed on the first access
                states.append(compute() if compute else self._link_states(state))
            poses, twists = states[0]
            return poses[rows], twists[rows]

        self._measured = [
            (
                (roots[root], root_twists[root]),
                (position[joint], velocity[joint]),
                partial(links, link),
            )
            for root, joint, link in zip(self._roots, self._joints, self._links)
        ]
        self._rates = root_twists, velocity

    def update_models(self) -> None:
        """Set the last read state of all models."""
        for model, state in zip(self._models, self._measured):
            model.set_measured_state(*state)

    @property
    def speed(self) -> float:
        """Largest last read speed of a joint or a root, in [m/s] or [rad/s]."""
        root_twists, velocity = self._rates
        return float(np.abs(np.concatenate([root_twists.ravel(), velocity])).max())

    def stop(self) -> None:
        """Zero the velocities of all models without writing them to the engine."""
        for model in self._models:
            model.stop()


class RestDetector:
    """Measures for how long all models have been at rest."""

    def __init__(self) -> None:
        self._still_for = 0.0
        self._first_speed = 0.0

    @property
    def is_resting(self) -> bool:
        """Whether steps change nothing until something is written."""
        return self._still_for >= REST_TIME

    def steps_left(self, time_step: float) -> int:
        """Return the number of steps until the world may sleep, at least 1."""
        left = (REST_TIME - self._still_for) / max(time_step, 1e-9)
        return max(1, math.ceil(left - 1e-6))

    def wake(self) -> None:
        """Resume steps, and count from zero."""
        self._still_for = 0.0

    def update(self, speed: float, time_step: float) -> None:
        """Count a step that was computed.

        The world does not sleep while the speed grows, such as with a pole that starts
        to topple.

        Args:
            speed: Greatest speed after the step, in [m/s] or [rad/s].
            time_step: Length of the step in [s].
        """
        if not speed <= REST_SPEED:  # also where it is NaN
            self.wake()
            return
        if self._still_for == 0.0:
            self._first_speed = speed
        self._still_for += time_step
        if self.is_resting and speed > self._first_speed:
            self.wake()


def _joined(models: Sequence[Model]) -> tuple[Description, np.ndarray]:
    """Join the trees of many models to one robot.

    Returns:
        The robot, and the rows of the models' links in it, shape (n_links,).
    """
    links: list[Link] = []
    joints: list[Joint] = []
    rows: list[int] = []
    for number, model in enumerate(models):
        scope, one = f"{number}{SCOPE}", model.assembly.description
        # The root comes first, as it does among the roots.
        ordered = sorted(one.links, key=lambda link: link.name != one.root)
        row = {link.name: len(links) + n for n, link in enumerate(ordered)}
        rows += [row[name] for name in model.link_names]
        links += [replace(link, name=scope + link.name) for link in ordered]
        joints += [
            replace(
                joint,
                name=scope + joint.name,
                parent=scope + joint.parent,
                child=scope + joint.child,
            )
            for joint in one.joints
        ]
    forest = Description("forest", links[0].name, tuple(links), tuple(joints))
    return forest, np.array(rows)


def _slices(lengths: Sequence[int]) -> list[slice]:
    """Return the slices of consecutive parts of given lengths."""
    ends = np.cumsum([0, *lengths]).tolist()
    return [slice(begin, end) for begin, end in zip(ends, ends[1:])]
