"""Interfaces of a page to robots, motions and the simulator."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Protocol, Sequence

import numpy as np

from g1_description.motion.motion import Motion
from g1_description.robot.description import Description
from g1_description.robot.state import RobotState
from g1_description.scenes.objects import SceneObject
from g1_description.scenes.scene import Scene

if TYPE_CHECKING:
    from g1_description.ros.history import HistoryClient
    from g1_description.web.scene.objects import SeenObject


class ShownRobot(Protocol):
    """A real or simulated robot, or one of a file. Methods do not block."""

    name: str
    description: Description
    anchor: str
    """Link that stays at its place while joints move, or ``lowest_foot``; empty:
    none."""
    history: HistoryClient | None
    """Its past, which blocks; None: there is none."""

    @property
    def has_anchors(self) -> bool:
        """Whether an anchor can be set."""

    def state(self) -> RobotState | None:
        """Return its newest state; None if there is none yet."""

    def command(self, positions: Mapping[str, float]) -> None:
        """Set joints, in [rad] or [m] by name."""

    def command_base(self, pose: np.ndarray) -> None:
        """Command the pose of the base: T_map_base, shape (7,)."""

    def command_all(self, positions: Mapping[str, float], base: np.ndarray) -> None:
        """Set joints and the pose of the base, T_map_base, at once."""

    def set_anchor(self, link: str) -> None:
        """Set ``anchor``; may block.

        Raises:
            G1DescriptionError: If it is refused, or not answered.
        """


class Player(Protocol):
    """A motion that can be played. Methods may block, unless noted.

    Raises:
        G1DescriptionError: By all methods, if it fails or is not answered.
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
        """Whether it is playing."""

    def play(self, begin: float, speed: float) -> None:
        """Play from a time, in [s], at a relative speed."""

    def pause(self) -> None:
        """Pause."""

    def rest(self) -> None:
        """Stay at the end; does not block."""

    def show(self, time: float) -> None:
        """Show the configuration of a time, in [s]."""


class Simulator(Protocol):
    """The simulated world. Methods may block, unless noted.

    Raises:
        G1DescriptionError: If it fails or is not answered.
    """

    def status(self) -> str:
        """Format physics, time and speed in a line; does not block."""

    @property
    def is_paused(self) -> bool:
        """Whether simulated time is paused; does not block."""

    @property
    def is_kinematic(self) -> bool:
        """Whether configurations are set without physics; does not block."""

    @property
    def is_stand_in(self) -> bool:
        """Whether it is the simulator of this package; does not block.

        The real Gazebo has no steps, speeds, ropes and anchors.
        """

    def pause(self) -> None:
        """Pause simulated time."""

    def go_on(self) -> None:
        """Resume simulated time."""

    def step(self, steps: int) -> None:
        """Run a number of steps while time is paused."""

    def set_speed(self, factor: float) -> None:
        """Set the speed of simulated time; 1: that of the clock, 0: no limit."""

    def reset(self) -> None:
        """Reset the world."""

    def hang(self, robot: str, is_on: bool, length: float) -> None:
        """Hang a robot on a rope of a length in [m], or let it go."""

    def place(self, robot: str, state: RobotState) -> None:
        """Put a robot to a state, at rest."""


class ShownScene(Protocol):
    """Objects around robots. Those of a simulator block where they are changed.

    Raises:
        G1DescriptionError: By all that changes it, if that is refused.
    """

    is_live: bool
    """Whether they are those of a simulator."""

    links: Sequence[str]
    """Names of the links that can carry objects."""

    @property
    def offset(self) -> np.ndarray:
        """Shift of the scene in the map, in [m], shape (3,)."""

    def shown(self) -> tuple[Mapping[str, SeenObject], Mapping[str, np.ndarray]]:
        """Return all objects by name, and T_map_object of each, shape (7,), as of now.

        An object that was changed is another one, and the pose of one that has moved
        another array. The offset is not in it.
        """

    def scene(self) -> Scene:
        """Return the objects as they are to be saved."""

    def load(self, scene: Scene) -> None:
        """Replace all objects."""

    def add(self, added: SceneObject) -> None:
        """Add an object."""

    def remove(self, name: str) -> None:
        """Remove an object."""

    def change(self, name: str, changed: SceneObject) -> None:
        """Replace an object, whose name may be a new one, where it is now."""

    def move(self, name: str, pose: np.ndarray) -> None:
        """Place an object: T_map_object without the offset, shape (7,), as of now."""

    def attach(self, name: str, link: str) -> None:
        """Let a link carry an object from now on; empty: none."""

    def carrier(self, name: str) -> str:
        """Return what carries an object now; empty: nothing."""


class ShownWorld(Protocol):
    """The robots and the simulator of a page."""

    robots: Sequence[ShownRobot]
    scenes: Sequence[ShownScene]
    """Objects around them."""

    can_move: bool
    """Whether robots can be commanded."""

    has_commanded: bool
    """Whether the commanded configuration is known."""

    can_arrange: bool
    """Whether robots can be shown next to each other or overlaid."""

    simulator: Simulator | None
    changed: Event
    """Set on changes; cleared by the page."""

    def arrange(self, beside: bool) -> None:
        """Show robots next to each other, or overlaid, if possible."""

    def watch(self, is_watched: bool) -> None:
        """Subscribe while the page is open."""

    def tick(self) -> None:
        """Update moving robots; sets ``changed`` if there are any."""

    def read(self, path: Path, robot: ShownRobot, rate: float | None) -> Motion:
        """Read a motion from a file of any format.

        Args:
            path: The file.
            robot: The robot of the motion.
            rate: Samples per second of a file without times.

        Raises:
            G1DescriptionError: If it is not a motion of the robot.
        """

    def open(
        self, robot: ShownRobot, motion: Motion, at: float | None = None
    ) -> Player:
        """Set the motion of a robot; a simulated one does not move yet.

        Args:
            robot: The robot.
            motion: The motion.
            at: Time at which it begins while the robot stays, in [s]; None: the first
                one, which a robot without a simulator shows.
        """

    def move(
        self, robot: ShownRobot, positions: Mapping[str, float], seconds: float
    ) -> None:
        """Move joints from their current positions, from rest to rest.

        Raises:
            G1DescriptionError: If it fails or is not answered.
        """
