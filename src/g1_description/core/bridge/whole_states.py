"""Which states have a base and joints that belong together."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

MOVED = 1e-9
"""What changes by more was moved, in [m], [rad] or parts of a quaternion; less is
rounding."""

UNSEEN = 0.02
"""A command that was answered shows so soon or moves nothing, in [s] of wall time."""

OVERDUE = 0.05
"""After this, in [s] of wall time, the newest state passes whatever it is: commands may
come without a pause."""


class State(NamedTuple):
    """A robot at some time."""

    stamp: int
    """In [ns]."""

    pose: np.ndarray
    """Pose of the root link, shape (7,)."""

    joints: np.ndarray
    """Positions in [rad] or [m], shape (n_joints,)."""

    message: Any = None
    """What tells of it."""

    is_moving: bool = False
    """Whether it moves by itself, and is not just set: then each state is whole."""


class WholeStates:
    """Hold each state until the next one, when it is known whether it was whole.

    Who moves base and joints sends two messages at a time, and the joints' takes the
    longer way: through the bridge. A state between the two has a new base and old
    joints, and a foot that should stand still is off by a step of the motion. So a
    state whose base has moved does not pass while a command for the joints is on its
    way.
    """

    def __init__(self) -> None:
        """Begin without any."""
        self.reset()

    def reset(self) -> None:
        """Forget what is held."""
        self.held: State | None = None
        """The last state."""
        self._is_torn = False
        self._base_moved = False
        self._shown: np.ndarray | None = None
        self._passed = self._answered = -math.inf
        self._commands = 0

    def next(
        self, state: State, now: float, commands: int, is_under_way: bool
    ) -> State | None:
        """Take a state in.

        Args:
            state: The state.
            now: Wall time, from any beginning, in [s].
            commands: How many commands for the joints have come until now.
            is_under_way: Whether one of them has not been answered.

        Returns:
            The state before, if that was whole or is overdue.
        """
        held, self.held = self.held, state
        has_news, self._commands = commands != self._commands, commands
        if held is None or len(state.joints) != len(held.joints):
            return held
        was_torn = self._is_torn or (self._base_moved and has_news)
        self._base_moved = bool(np.abs(state.pose - held.pose).max() > MOVED)
        joints_moved = np.abs(state.joints - held.joints).max(initial=0.0) > MOVED
        if is_under_way or (has_news and not joints_moved):
            self._is_torn, self._answered = True, now
        elif joints_moved or now - self._answered > UNSEEN:
            self._is_torn = False
        is_still = self._shown is not None and (
            np.abs(held.pose - self._shown).max() <= MOVED
        )
        is_early = now - self._passed < OVERDUE
        if was_torn and is_early and not (is_still or held.is_moving):
            return None
        self._shown, self._passed = held.pose, now
        return held
