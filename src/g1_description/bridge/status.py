"""How the bridge is doing, as its parts write it and its diagnostics read it."""

from __future__ import annotations

import threading
import time
from collections import Counter
from dataclasses import dataclass, field
from functools import cached_property

from g1_description.bridge.commands import CommandTally
from g1_description.bridge.estimator import LinkProblems
from g1_description.errors import DescriptionError
from g1_description.robot.description import Description
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.state import RobotState

SPAWN_GRACE = 5.0
"""Time in [s] after the start of the bridge in which a robot may still be spawned."""


@dataclass
class RobotStatus:
    """One robot, its commands and what the last message says about it."""

    name: str
    """Name of its model in the simulated world."""

    description: Description
    """The robot as in its file."""

    commands: CommandTally = field(init=False)
    """What became of its commands."""

    motions: Counter[str] = field(default_factory=Counter)
    """What became of its motions and base commands, by the keys of /diagnostics."""

    state: RobotState | None = None
    """Its last state, without joints and base where the simulator does not have it."""

    problems: LinkProblems | None = None
    """What was wrong with its links then."""

    other_publishers: tuple[str, ...] = ()
    """Other nodes that publish its joint states."""

    tf_listeners: int = 0
    """How many nodes hear the joint states that go to TF."""

    start: float = field(default_factory=time.monotonic)
    """When the bridge began, on the monotonic clock in [s]."""

    def __post_init__(self) -> None:
        """Begin to count its commands."""
        self._counting = threading.Lock()
        self.commands = CommandTally(self.description.movable_joints)

    @property
    def stamp(self) -> int:
        """Time of its last state in [ns]; 0 before the first."""
        return 0 if self.state is None else self.state.stamp

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
