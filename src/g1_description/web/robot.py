"""What a page is told of a robot, and what it may ask of it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from threading import Event
from typing import Protocol, Sequence

import numpy as np

from g1_description.motion.motion import Motion
from g1_description.robot.description import Description
from g1_description.robot.state import RobotState


class ShownRobot(Protocol):
    """A robot, real, simulated or of a file. No method waits."""

    name: str
    description: Description
    joint_topic: str
    """Where the same command could be published."""

    def state(self) -> RobotState | None:
        """Return its newest state, and what is commanded; None if there is none yet."""

    def command(self, positions: Mapping[str, float]) -> None:
        """Set joints, in [rad] or [m] by name."""

    def command_base(self, pose: np.ndarray) -> None:
        """Put the base somewhere: T_map_base, shape (7,)."""


class Player(Protocol):
    """A motion, and where it is. ``play`` and the like may wait for an answer.

    Raises:
        G1DescriptionError: By all methods, if that is refused or nobody answers.
    """

    begin: float
    """Time of the first sample, in [s]."""

    end: float
    """Time of the last one, in [s]."""

    @property
    def time(self) -> float:
        """Time of the motion that is shown, in [s]."""

    @property
    def is_running(self) -> bool:
        """Whether it goes on by itself."""

    def play(self, begin: float, speed: float) -> None:
        """Play from a time on, in [s], at so many seconds of it in a second."""

    def pause(self) -> None:
        """Stop where it is."""

    def rest(self) -> None:
        """Stay at the end, which is reached; does not wait."""

    def show(self, time: float) -> None:
        """Show the configuration of a time, in [s]."""


class Simulator(Protocol):
    """The simulated world. All methods but ``status`` may wait for an answer.

    Raises:
        G1DescriptionError: If that is refused or nobody answers.
    """

    def status(self) -> str:
        """Describe physics, time and speed in a line; does not wait."""

    @property
    def is_paused(self) -> bool:
        """Whether simulated time stands still; does not wait."""

    def pause(self) -> None:
        """Let simulated time stand still."""

    def go_on(self) -> None:
        """Let simulated time run."""

    def step(self, steps: int) -> None:
        """Run so many steps while time stands still."""

    def set_speed(self, factor: float) -> None:
        """Set the speed of simulated time; 1: that of the clock, 0: no limit."""

    def reset(self) -> None:
        """Put all robots back to where they began."""


class ShownWorld(Protocol):
    """All that a page shows."""

    robots: Sequence[ShownRobot]
    can_move: bool
    """Whether anybody takes commands."""

    has_commanded: bool
    """Whether the commanded configuration is known."""

    can_arrange: bool
    """Whether robots can be shown beside each other or over each other."""

    simulator: Simulator | None
    changed: Event
    """Set when there is something new; whoever waits for it clears it."""

    def arrange(self, beside: bool) -> None:
        """Show robots beside each other, or all where they are; if that is free."""

    def watch(self, is_watched: bool) -> None:
        """Begin to listen, or stop: nobody looks."""

    def tick(self) -> None:
        """Go on with what moves by itself; sets ``changed`` if anything does."""

    def read(self, path: Path, robot: ShownRobot, rate: float | None) -> Motion:
        """Read a motion from a file of any format.

        Args:
            path: The file.
            robot: Who shall go through it.
            rate: Samples per second of a file without times.

        Raises:
            G1DescriptionError: If there is none in it that fits.
        """

    def open(self, robot: ShownRobot, motion: Motion) -> Player:
        """Let a robot have a motion; it does not move yet."""

    def move(
        self, robot: ShownRobot, positions: Mapping[str, float], seconds: float
    ) -> None:
        """Move joints from where they are, beginning and ending at rest.

        Raises:
            G1DescriptionError: If that is refused or nobody answers.
        """
