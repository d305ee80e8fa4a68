"""Robots that play motions from files, without ROS."""

from __future__ import annotations

import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from threading import Event, Lock
from typing import Callable, Optional

import numpy as np

from g1_description.motion.edit import minimum_jerk_trajectory
from g1_description.motion.motion import Motion, sample
from g1_description.robot.description import Description
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.state import RobotState
from g1_description.robot.transform import IDENTITY
from g1_description.scenes.scene import Scene
from g1_description.sim.anchor import Anchor
from g1_description.sim.model import Model
from g1_description.sim.standing import standing_base
from g1_description.web.file_scene import FileScene
from g1_description.web.robot import ShownRobot

DISTANCE = 1.2
"""Distance between robots next to each other, in [m]."""

ReadMotion = Callable[[Path, Description, Optional[float]], Motion]
"""Reads a motion of a robot, with samples per second for files without times."""


class StillRobot:
    """A robot that is moved only by commands and motions."""

    history = None

    def __init__(self, name: str, description: Description) -> None:
        """Place it on the floor, with joints at zero or the nearest limit.

        Args:
            name: Its name on the page.
            description: The robot.
        """
        self.name, self.description = name, description
        self._lock = Lock()
        self._model = Model(name, lump_fixed_joints(description, False), IDENTITY)
        self._anchor: Anchor | None = None
        self.offset = np.zeros(3)
        """Offset of its displayed position, in [m]."""
        joints = description.movable_joints
        bent = {j.name: float(np.clip(0.0, j.lower, j.upper)) for j in joints}
        self._beginning = bent, standing_base(description, bent)
        self.reset()

    def reset(self) -> None:
        """Return to the initial state."""
        with self._lock:
            self._positions, self._base = self._beginning
            self._way: tuple[Motion, float] | None = None
            self._renew()

    def state(self) -> RobotState:
        """Return the current state."""
        now = time.monotonic()
        with self._lock:
            if self._way is not None:
                motion, began = self._way
                self._take(motion, now - began)
                if now - began >= motion.end:
                    self._way = None
            base = self._base.copy()
            base[:3] += self.offset
            bent = self._positions
            names, positions = tuple(bent), np.array([*bent.values()], dtype=float)
            return RobotState(int(1e9 * now), names, positions, base_pose=base)

    def command(self, positions: Mapping[str, float]) -> None:
        """Set joints."""
        with self._lock:
            self._way = None
            self._positions = {**self._positions, **positions}
            self._hold()

    has_anchors = True

    @property
    def anchor(self) -> str:
        """The link that stays at its place while joints move; empty: none."""
        return self._anchor.name if self._anchor else ""

    def set_anchor(self, link: str) -> None:
        """Set the link that stays at its place while joints move; empty: none.

        Raises:
            G1DescriptionError: If there is no such link.
        """
        with self._lock:
            self._anchor = Anchor(self._moved(), link) if link else None

    def _moved(self) -> Model:
        """Return the model at the current state."""
        model = self._model
        model.position[:] = [self._positions[name] for name in model.joint_names]
        model.set_root(0, self._base, np.zeros(6))
        return model

    def _hold(self) -> None:
        """Let the base follow the anchor."""
        if self._anchor:
            self._moved()
            self._anchor.hold()
            self._base = self._model.root_poses[0].copy()

    def _renew(self) -> None:
        """Keep the anchor where it is now."""
        if self._anchor:
            self._moved()
            self._anchor.renew()

    def command_base(self, pose: np.ndarray) -> None:
        """Set the pose of the base."""
        with self._lock:
            self._base = pose.copy()
            self._base[:3] -= self.offset
            self._renew()

    def command_all(self, positions: Mapping[str, float], base: np.ndarray) -> None:
        """Set joints and the pose of the base."""
        with self._lock:
            self._way = None
            self._positions = {**self._positions, **positions}
            self._base = base.copy()
            self._base[:3] -= self.offset
            self._renew()

    def go(self, motion: Motion) -> None:
        """Play a motion of joints from now."""
        with self._lock:
            self._way = motion, time.monotonic()

    def take(self, motion: Motion, at: float) -> None:
        """Take the state of a motion at a time, in [s]."""
        with self._lock:
            self._way = None
            self._take(motion, at)

    def _take(self, motion: Motion, at: float) -> None:
        found = sample(motion, at)
        bent = dict(zip(motion.joint_names, found.positions.tolist()))
        self._positions = {**self._positions, **bent}
        if found.base_poses is None:
            self._hold()
        else:
            self._base = found.base_poses
            self._renew()

    @property
    def is_moving(self) -> bool:
        """Whether a motion is played."""
        return self._way is not None


class ClockPlayer:
    """Plays the motions of all robots in sync, in real time."""

    def __init__(self, world: FileWorld, at: float | None) -> None:
        self._world = world
        motions = world.motions.values()
        self.begin = min(m.begin for m in motions)
        self.end = max(m.end for m in motions)
        self._from = self.begin if at is None else at
        self._speed = 1.0
        self._began: float | None = None
        if at is None:
            self.show(self.begin)

    @property
    def time(self) -> float:
        """Time of the motion that is shown, in [s]."""
        passed = 0.0
        if self._began is not None:
            passed = self._speed * (time.monotonic() - self._began)
        return float(min(self._from + passed, self.end))

    @property
    def is_running(self) -> bool:
        """Whether it is playing."""
        return self._began is not None

    def play(self, begin: float, speed: float) -> None:
        """Play from a time, in [s], at a speed relative to real time."""
        self._from, self._speed = begin, speed
        self._began = time.monotonic()
        self._world.changed.set()

    def pause(self) -> None:
        """Pause."""
        self._from, self._began = self.time, None

    def rest(self) -> None:
        """Stay at the end."""
        self.pause()

    def show(self, time: float) -> None:
        """Show the configuration of a time, in [s]."""
        self._from, self._began = time, None
        self.tick()

    def tick(self) -> None:
        """Update all robots."""
        at = self.time
        for robot, motion in self._world.motions.items():
            robot.take(motion, at)
        self._world.changed.set()


class FileWorld:
    """Robots without a simulator, with motions from files."""

    simulator = None
    can_move = True
    has_commanded = False

    def __init__(
        self, robots: list[StillRobot], read: ReadMotion, scene: Scene | None = None
    ) -> None:
        """Create a world without motions.

        Args:
            robots: All robots.
            read: Reads files.
            scene: Objects around each robot; None: none at first.

        Raises:
            UnknownNameError: If an object is attached to a link that is not there.
        """
        self.robots = robots
        self.can_arrange = len(robots) > 1
        self.changed = Event()
        self.changed.set()
        self.motions: dict[StillRobot, Motion] = {}
        self.player: ClockPlayer | None = None
        self._read = read
        scene = Scene() if scene is None else scene
        self.scenes = [
            FileScene(scene, robot, partial(self._motion_of, robot)) for robot in robots
        ]
        self.arrange(beside=True)

    def _motion_of(self, robot: StillRobot) -> tuple[Motion | None, float]:
        """Return the motion of a robot, if there is one, and the time in it, in [s]."""
        time = 0.0 if self.player is None else self.player.time
        return self.motions.get(robot), time

    def arrange(self, beside: bool) -> None:
        """Show robots next to each other, or at the positions of their motions."""
        for number, robot in enumerate(self.robots):
            robot.offset = np.array([0.0, -DISTANCE * number * beside, 0.0])
        self.changed.set()

    def watch(self, is_watched: bool) -> None:
        """Show the current state to a new viewer."""
        self.changed.set()

    def tick(self) -> None:
        """Update moving robots."""
        if self.player is not None and self.player.is_running:
            self.player.tick()
        elif any(robot.is_moving for robot in self.robots):
            self.changed.set()

    def read(self, path: Path, robot: ShownRobot, rate: float | None) -> Motion:
        """Read a motion from a file of any format."""
        return self._read(path, robot.description, rate)

    def open(
        self, robot: StillRobot, motion: Motion, at: float | None = None
    ) -> ClockPlayer:
        """Set the motion of a robot."""
        self.motions[robot] = motion
        self.player = ClockPlayer(self, at)
        return self.player

    def move(
        self, robot: StillRobot, positions: Mapping[str, float], seconds: float
    ) -> None:
        """Move joints from their current positions, from rest to rest."""
        if self.player is not None:
            self.player.pause()
        if not seconds:
            robot.command(positions)
        else:
            now, names = robot.state().positions_by_name, list(positions)
            begin = np.array([now[name] for name in names])
            goal = np.array([positions[name] for name in names])
            robot.go(minimum_jerk_trajectory(names, begin, goal, seconds))
        self.changed.set()
