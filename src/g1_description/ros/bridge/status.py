"""How the bridge is doing, as its parts write it and its diagnostics read it."""

from __future__ import annotations

import threading
import time
from collections import Counter
from dataclasses import dataclass, field
from functools import cached_property

from g1_description.core.bridge.command_tally import CommandTally
from g1_description.core.bridge.estimator import Observation
from g1_description.core.errors import DescriptionError
from g1_description.core.robot.description import Description
from g1_description.core.robot.lumping import lump_fixed_joints

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
