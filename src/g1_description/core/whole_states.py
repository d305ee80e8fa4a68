"""Which states have a base and joints that belong together."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

MOVED = 1e-9
"""What changes by more was moved, in [m], [rad] or parts of a quaternion; less is
rounding."""

SHORT, LONG = 0.01, 0.1
"""What moves alone waits at most so long for the other, in [s] of wall time, as a busy
machine keeps them apart: the longer where the other has moved within that time, too."""


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


class WholeStates:
    """Hold each state until the next one tells whether it was whole.

    Base and joints are set by two messages, and a state between the two has one of
    them new and the other old: a foot that should stand still is off by a step of the
    motion. Such a state shows in what moves: one of the two alone, and next the other
    alone.
    """

    def __init__(self) -> None:
        """Begin without any."""
        self.reset()

    def reset(self) -> None:
        """Forget what is held."""
        self.held: State | None = None
        """The last state."""
        self._last_moved = {"base": -math.inf, "joints": -math.inf}
        self._alone: str | None = None
        self._since = self._patience = 0.0

    def next(self, state: State, now: float) -> State | None:
        """Take a state in.

        Args:
            state: The state.
            now: Wall time, from any beginning, in [s].

        Returns:
            The state before, if that was whole or is taken to be.
        """
        held, self.held = self.held, state
        if held is None or len(state.joints) != len(held.joints):
            return held
        changes = {
            "base": np.abs(state.pose - held.pose).max(),
            "joints": np.abs(state.joints - held.joints).max(initial=0.0),
        }
        moved = [name for name, change in changes.items() if change > MOVED]
        is_whole = self._judge(now, moved)
        self._last_moved.update(dict.fromkeys(moved, now))
        return held if is_whole else None

    def _judge(self, now: float, moved: list[str]) -> bool:
        """Tell whether the state before was whole, from what moved since."""
        is_whole = self._alone is None
        if len(moved) == 1 and is_whole:
            self._alone, self._since = moved[0], now
            (other,) = {*self._last_moved} - {*moved}
            is_recent = now - self._last_moved[other] < LONG
            self._patience = LONG if is_recent else SHORT
        elif not is_whole and {*moved} <= {self._alone}:
            is_whole = now - self._since >= self._patience
            if is_whole and not moved:
                self._alone = None
        else:  # both move, or the other half has come
            self._alone = None
        return is_whole
