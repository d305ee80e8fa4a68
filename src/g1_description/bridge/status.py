"""How the bridge is doing, as its parts write it and its diagnostics read it."""

from __future__ import annotations

import itertools
import math
import threading
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from g1_description.bridge.estimator import Observation
from g1_description.errors import DescriptionError
from g1_description.robot.description import Description
from g1_description.robot.lumping import lump_fixed_joints

MAX_NAMES = 50
"""Largest number of ignored names that are counted one by one; the rest together. Names
come from outside, and there may be any number of them."""

MAX_NAME_LENGTH = 80
"""Number of characters of such a name that are kept."""


class CommandTally:
    """Counts positions that the simulator clamps, and those that nobody sets."""

    def __init__(self, limits: Mapping[str, tuple[float, float]]) -> None:
        """Begin with zero counts.

        Args:
            limits: Lower and upper limit in [rad] or [m] of each joint that moves.
        """
        self._limits = limits
        self.clamped: Counter[str] = Counter()
        """Positions beyond the limits, by joint."""
        self.ignored: Counter[str] = Counter()
        """Ignored positions, by the name in the command: unknown, without a position,
        or with one that is not finite; '' for positions without a name."""
        self.other_ignored = 0
        """Ignored positions under names beyond the first ``MAX_NAMES``."""
        self._last_clamped: dict[str, float] = {}

    def count(
        self, names: Sequence[str], positions: Sequence[float], now: float
    ) -> None:
        """Count the positions of a command that are clamped or ignored.

        Args:
            names: Joint names in the command.
            positions: Positions in [rad] or [m] in the command.
            now: Time of the command in [s] on a clock that does not go back.
        """
        for name, position in itertools.zip_longest(names, positions):
            is_finite = position is not None and math.isfinite(position)
            if name not in self._limits or not is_finite:
                self._ignore((name or "")[:MAX_NAME_LENGTH])
                continue
            lower, upper = self._limits[name]
            if not lower <= position <= upper:
                self.clamped[name] += 1
                self._last_clamped[name] = now

    def _ignore(self, name: str) -> None:
        """Count a position that nobody sets."""
        if name in self.ignored or len(self.ignored) < MAX_NAMES:
            self.ignored[name] += 1
        else:
            self.other_ignored += 1

    def clamped_since(self, time: float) -> list[str]:
        """Return the joints that were clamped after a time in [s]."""
        # A copy: another thread counts meanwhile.
        last = self._last_clamped.copy()
        return [name for name, when in last.items() if when > time]

    @property
    def is_empty(self) -> bool:
        """Whether every position so far was obeyed."""
        return not (self.clamped or self.ignored)


SPAWN_GRACE = 5.0
"""Time in [s] after the start of the bridge in which a robot may still be spawned."""


@dataclass
class CommandCount:
    """What became of one robot's commands."""

    received: int = 0
    """Commands that were received."""

    answered: int = 0
    """How many of them the simulator has answered, alone or merged with others."""

    sent: int = 0
    """Calls that the simulator answered with success."""

    refused: int = 0
    """Calls that it refused."""

    reason: str = ""
    """Why it refused the last call; empty if it did not."""


@dataclass
class RobotStatus:
    """One robot, its commands and what the last message says about it."""

    name: str
    """Name of its model in the simulated world."""

    description: Description
    """The robot as in its file."""

    commands: CommandCount = field(default_factory=CommandCount)

    motions: Counter[str] = field(default_factory=Counter)
    """What became of its motions and base commands, by the keys of /diagnostics."""

    observation: Observation | None = None
    """What the last message says about it."""

    stamp: int = 0
    """Time of that message in [ns]; 0 before the first."""

    ignored: tuple[float, str] | None = None
    """When part of a command was last ignored, on the monotonic clock, and why."""

    other_publishers: tuple[str, ...] = ()
    """Other nodes that publish its joint states."""

    tf_listeners: int = 0
    """How many nodes hear the joint states that go to TF."""

    start: float = field(default_factory=time.monotonic)
    """When the bridge began, on the monotonic clock in [s]."""

    tally: CommandTally = field(init=False)
    """Which of its commands were clamped or ignored."""

    def __post_init__(self) -> None:
        """Begin to count its commands."""
        self._counting = threading.Lock()
        joints = self.description.movable_joints
        self.tally = CommandTally({j.name: (j.lower, j.upper) for j in joints})

    def count(self, what: str) -> None:
        """Count one more of its motions or base commands, in whichever thread."""
        with self._counting:
            self.motions[what] += 1

    @property
    def is_in_grace(self) -> bool:
        """Whether the bridge began just now, and the robot may still be spawned."""
        return time.monotonic() - self.start < SPAWN_GRACE

    @cached_property
    def vanishes(self) -> bool:
        """Whether Gazebo drops all its links, as none has mass."""
        try:
            return not lump_fixed_joints(self.description).link_names
        except DescriptionError:
            return False
