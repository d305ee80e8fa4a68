"""Contact forces of a robot that moves, found from its last states."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from g1_description.checks.arrows import Arrow, force_arrows
from g1_description.checks.checker import Checker
from g1_description.motion.motion import SNAP, Motion
from g1_description.robot.state import RobotState

SPAN = 0.3
"""Forces are found from the states of this time, in [s]."""

PERIOD = 0.1
"""Shortest time between states for which they are found, in [s]: it takes longer than
the check of a state."""

CHECK = "contact_forces"


class LiveForces:
    """The contact forces of a robot shortly ago: accelerations need later states."""

    def __init__(self) -> None:
        self._states: deque[RobotState] = deque()
        self._found: float | None = None
        self.arrows: Sequence[Arrow] = ()
        self.text = ""
        """What is missing; may be empty."""

    def begin_again(self) -> None:
        """Forget all states: time went back, or the robot jumped."""
        self._states.clear()
        self._found, self.arrows, self.text = None, (), ""

    def add(self, state: RobotState) -> None:
        """Add a state; without a base, or with other joints, it is a new beginning."""
        if self._states and state.stamp <= self._states[-1].stamp:
            return
        if state.base_pose is None or (
            self._states and self._states[-1].names != state.names
        ):
            self.begin_again()
        if state.base_pose is not None:
            self._states.append(state)
        while self._states and state.time - self._states[0].time > SPAN:
            self._states.popleft()

    def find(self, checker: Checker, objects: np.ndarray | None) -> None:
        """Find the forces, unless there is next to nothing new.

        Args:
            checker: Checks the robot.
            objects: As for ``Checker.check``.

        Raises:
            G1DescriptionError: If the states cannot be checked.
        """
        if not self._states:
            return
        newest = self._states[-1].time
        if self._found is not None and newest - self._found < PERIOD - SNAP:
            return
        self._found, self.arrows, self.text = newest, (), ""
        arrows = force_arrows(checker.check(self._motion(checker), [CHECK], objects))
        if arrows is None:
            return
        known = arrows.times[np.isfinite(arrows.missing[:, 0])]
        if len(known):
            self.arrows, self.text = arrows.at(known[-1]), arrows.text(known[-1])

    def _motion(self, checker: Checker) -> Motion:
        """Return the states as a motion of the robot's own joints."""
        own = {joint.name for joint in checker.description.movable_joints}
        names = self._states[0].names
        columns = [column for column, name in enumerate(names) if name in own]
        return Motion(
            np.array([state.time for state in self._states]),
            tuple(names[column] for column in columns),
            np.array([state.positions[columns] for state in self._states]),
            None,
            np.array([state.base_pose for state in self._states]),
        )
