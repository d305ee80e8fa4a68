"""State of each robot of the bridge, for its diagnostics."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from g1_description.bridge.commands import CommandTally
from g1_description.bridge.estimator import LinkProblems
from g1_description.errors import DescriptionError
from g1_description.motion.history import History
from g1_description.motion.history_chunks import Command
from g1_description.robot.description import Description
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.state import RobotState

SPAWN_GRACE = 5.0
"""Time in [s] after the start of the bridge in which a robot may still be spawned."""


@dataclass
class RobotStatus:
    """One robot, its commands and its last state."""

    name: str
    """Name of its model in the simulated world."""

    description: Description
    history: History | None = None
    """Last states and commands; None if they are not kept."""

    commands: CommandTally = field(init=False)
    motions: Counter[str] = field(default_factory=Counter)
    """Counts of its motions and base commands, by the keys of /diagnostics."""

    state: RobotState | None = None
    """Last state, without joints and base if the simulator does not have it."""

    problems: LinkProblems | None = None
    """Problems of its links in that state."""

    other_publishers: tuple[str, ...] = ()
    """Other nodes that publish its joint states."""

    tf_listeners: int = 0
    """Number of subscribers to tf_joint_states."""

    start: float = field(default_factory=time.monotonic)
    """When the bridge started, on the monotonic clock in [s]."""

    def __post_init__(self) -> None:
        self._counting = threading.Lock()
        joints = self.description.movable_joints
        self.commands = CommandTally(joints)
        self._names = {joint.name: joint.name for joint in joints}
        """One object for each name: the history keeps many."""

    @property
    def stamp(self) -> int:
        """Time of its last state in [ns]; 0 before the first."""
        return 0 if self.state is None else self.state.stamp

    def count(self, event: str) -> None:
        """Count one of its motions or base commands; thread-safe."""
        with self._counting:
            self.motions[event] += 1

    def record(
        self,
        message: Any,
        topic: str,
        content: str,
        positions: Mapping[str, float],
    ) -> None:
        """Keep a command for the history; ``message`` knows its sender."""
        if self.history is not None:
            sender = message._connection_header.get("callerid", "")
            known = {
                self._names[name]: position
                for name, position in positions.items()
                if name in self._names
            }
            command = Command(sender, topic, content, tuple(known))
            self.history.add_command(command, [*known.values()])

    @cached_property
    def vanishes(self) -> bool:
        """Whether Gazebo drops all of its links, as none has mass."""
        try:
            return not lump_fixed_joints(self.description).link_names
        except DescriptionError:
            return False
