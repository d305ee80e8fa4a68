"""The motions of one robot, on our simulator and on the real Gazebo."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
import rosgraph
import rospy
from gazebo_msgs.msg import ModelState

from g1_description.bridge.commands import JointCommands
from g1_description.bridge.status import RobotStatus
from g1_description.motion.motion import Motion
from g1_description.motion.playlist import Playback, Playlist, Setpoint
from g1_description.msg import ModelTrajectory
from g1_description.robot.state import RobotState
from g1_description.ros.conversions import model_trajectory, pose_from_array
from g1_description.ros.master import SERVICE_ERRORS, SLAVE_API_ERRORS
from g1_description.ros.publisher import DirectPublisher
from g1_description.srv import SetAnchor, SetAnchorResponse, SetModelTrajectory

QUEUE_SIZE = 100
"""Samples queued for a busy simulator: a tenth of a second at 1 kHz."""

ASK_PERIOD = 1.0
"""Time after which a stream checks again which simulator is running, in [s]."""

ANSWER_TIMEOUT = 0.4
"""Longest wait in [s] of wall time of a state for the answer to a motion that it may
show: shorter than our simulator, while it steps, waits for the bridge to read."""


class Played(NamedTuple):
    """The answer to a motion."""

    success: bool

    message: str
    """Deviations from the request, or why it was refused; may be empty."""

    start_ns: int = 0
    """Start of its times, in [ns]."""

    playback: Playback | None = None
    """The motion as it plays: newer commands may replace joints of it."""


class MotionPlayer:
    """Plays motions of a robot.

    Our simulator samples a motion itself, at the time of each step. On the real Gazebo
    the bridge answers each published state with the sample of that time.

    With ``keeps_commands`` the commanded joints and base are recorded, for the ghost.
    """

    def __init__(
        self,
        gazebo: str,
        status: RobotStatus,
        commands: JointCommands,
        keeps_commands: bool = False,
    ) -> None:
        self._status = status
        self._name = f"{gazebo}/set_model_trajectory"
        self._plays_itself, self._asked = False, -math.inf
        self._service = rospy.ServiceProxy(self._name, SetModelTrajectory)
        self._anchor = rospy.ServiceProxy(f"{gazebo}/set_anchor", SetAnchor)
        self._topic = DirectPublisher(self._name, ModelTrajectory, QUEUE_SIZE)
        self._states = DirectPublisher(
            f"{gazebo}/set_model_state", ModelState, QUEUE_SIZE
        )
        self._commands = commands
        self._plays_here = False
        # Locked while a request is sent and recorded, so that the order is the same in
        # the simulator and here. No state waits for it.
        self._sending = threading.Lock()
        self._lock = threading.Condition()
        self._is_awaited = False
        self._before_base: RobotState | None = None
        self._joints = [joint.name for joint in status.description.movable_joints]
        self._keeps_commands = keeps_commands
        self.reset()

    def reset(self) -> None:
        """Forget all motions: time began again."""
        if self._plays_here:
            self._commands.drop(self._joints, base=True)  # states wait for a reset
        with self._lock:
            count = partial(self._status.count, "motions superseded before shown")
            self._playlist = Playlist(self._joints, count)
            self._commanded: dict[str, float] = {}
            self._commanded_base: np.ndarray | None = None
            self._plays_here = False
            self.is_idle = True
            """Whether no motion was sent since the reset."""

    def play(self, trajectory: Motion, start_ns: int | None = None) -> Played:
        """Play a motion; wait for the simulator's answer.

        Args:
            trajectory: The motion.
            start_ns: Start of its times, in [ns]; None: now.
        """
        if not self._finds_service():
            return self._play_here(trajectory, start_ns)
        message = model_trajectory(self._status.name, trajectory, start_ns)
        played = Played(False, "")
        with self._sending:
            self.is_idle = self._plays_here = False
            with self._lock:
                self._is_awaited = True
            try:
                played = self._call(message)
            finally:
                with self._lock:
                    self._is_awaited = False
                    if played.success:
                        playback = self._add(trajectory, played.start_ns)
                        played = played._replace(playback=playback)
                    self._lock.notify_all()
        return played

    def stream(self, trajectory: Motion, start_ns: int | None = None) -> Played:
        """Like ``play``, without waiting: for a stream of configurations."""
        if time.monotonic() > self._asked + ASK_PERIOD:
            self._finds_service()
        if not self._plays_itself:
            return self._play_here(trajectory, start_ns)
        if not self._topic.get_num_connections():
            return self.play(trajectory, start_ns)
        message = model_trajectory(self._status.name, trajectory, start_ns)
        with self._sending:
            self._plays_here = False
            # Recorded first, so that the first state that shows it finds it.
            self._add(trajectory, start_ns or self._status.stamp)
            self._topic.publish(message)
        return Played(True, "")

    def place_base(self, pose: np.ndarray) -> Played:
        """Place the root link, which ends the base's motion.

        Args:
            pose: Pose in the map, shape (7,).
        """
        if not self._states.get_num_connections():
            return Played(
                False, f"{self._states.name} has no subscriber; is a simulator running?"
            )
        message = ModelState(model_name=self._status.name, pose=pose_from_array(pose))
        with self._sending:
            if self._keeps_commands:
                self.is_idle = False
            self._release((), base=True)
            if self._plays_here:
                self._commands.release((), base=True)
            with self._lock:
                state = self._status.state
                if state is not None and state is self._before_base:
                    self._status.count("base commands superseded before shown")
                self._before_base = state
                if self._keeps_commands:
                    self._commanded_base = pose
            self._states.publish(message)
        return Played(True, "")

    def flush(self) -> None:
        """Send the queued messages."""
        self._topic.flush()
        self._states.flush()

    def stop(self, joints: Collection[str] | None = None) -> Played:
        """Stop joints where they are; by default all, and the base."""
        if joints is not None and not joints:
            return Played(True, "")
        plays_itself = self._finds_service()
        with self._sending:
            if plays_itself:
                message = ModelTrajectory(model_name=self._status.name)
                message.joint_names = list(joints or ())
                played = self._call(message)
            else:
                played = Played(True, "", self._status.stamp)
            if played.success:
                released = self._joints if joints is None else joints
                self._release(released, joints is None)
                if self._plays_here:
                    self._commands.release(released, joints is None)
        return played

    def set_anchor(self, link: str) -> SetAnchorResponse:
        """Set the link that stays at its place while joints move; empty: none."""
        if not self._finds_service():
            why = "the simulator has no anchors; use the simulator of this package"
            return SetAnchorResponse(False, why, "")
        try:
            return self._anchor(self._status.name, link)
        except SERVICE_ERRORS as error:
            why = f"the simulator does not answer: {error}"
            return SetAnchorResponse(False, why, "")

    def command(self, positions: Mapping[str, float]) -> None:
        """Record a command for joints, which ends their motions.

        Args:
            positions: In [rad] or [m] by joint name.
        """
        with self._sending:
            if self._keeps_commands:
                self.is_idle = False
            self._release(positions)
            if self._keeps_commands:
                with self._lock:
                    self._commanded.update(positions)

    def _release(self, joints: Collection[str], base: bool = False) -> None:
        """End the motions of joints, and optionally of the base."""
        if self.is_idle:
            return
        with self._lock:
            rows = [row for row, name in enumerate(self._joints) if name in joints]
            self._playlist.release(rows, base)
            if base:
                self._commanded_base = None

    def observe(self, state: RobotState) -> bool:
        """Advance the motions to a state; return whether one reaches a sample."""
        with self._lock:
            # The first states of a motion arrive before the answer.
            if self._is_awaited:
                self._lock.wait_for(lambda: not self._is_awaited, ANSWER_TIMEOUT)
                self._is_awaited = False
            return bool(self._playlist) and self._advance(state)

    def with_commands(self, state: RobotState) -> RobotState:
        """Return a state with the commanded joints and base."""
        with self._lock:
            return replace(
                state,
                commanded=self._commanded.copy(),
                commanded_base=self._commanded_base,
            )

    def _advance(self, state: RobotState) -> bool:
        stamp = state.stamp
        if self._playlist.is_waiting:
            self._playlist.begin(stamp, self._present(state))
        is_sample = False
        for playback in self._playlist.moving():
            is_sample = playback.reaches_sample(stamp) or is_sample
            if self._keeps_commands or self._plays_here:
                self._apply(playback.setpoint(stamp))
        self._playlist.drop_over(stamp)
        return is_sample

    def _apply(self, setpoint: Setpoint) -> None:
        """Record a sample, or send it to a simulator that cannot play."""
        names = [self._joints[row] for row in setpoint.rows]
        positions = dict(zip(names, setpoint.positions.tolist()))
        if self._keeps_commands:
            self._commanded.update(positions)
            if setpoint.base_pose is not None:
                self._commanded_base = setpoint.base_pose
        if self._plays_here:
            self._commands.put(positions, setpoint.base_pose)

    def _present(self, state: RobotState) -> Setpoint:
        """Return the robot's state as a setpoint; joints not measured are at zero."""
        n = len(self._joints)
        position, velocity = np.zeros(n), np.zeros(n)
        own = [self._joints.index(name) for name in state.names]
        position[own], velocity[own] = state.positions, state.velocities
        return Setpoint(np.arange(n), position, velocity, state.base_pose)

    def _play_here(self, trajectory: Motion, start_ns: int | None) -> Played:
        """Play a motion on a simulator that cannot play motions."""
        now = self._status.stamp
        if not now:
            return Played(
                False, "the simulator has not published a state of the robot yet"
            )
        state = self._status.state
        if trajectory.base_poses is not None and (
            state is None or state.base_pose is None
        ):
            return Played(False, f"{self._status.name} has no floating base")
        self._plays_here = True
        playback = self._add(trajectory, start_ns or now)
        return Played(True, "", start_ns or now, playback)

    def _add(self, trajectory: Motion, start_ns: int) -> Playback:
        """Record a started motion."""
        with self._lock:
            self.is_idle = False
            return self._playlist.add(trajectory, start_ns)

    def _finds_service(self) -> bool:
        """Ask the master whether the simulator plays motions itself.

        A subscriber to the topic is not enough: it may be a recorder.
        """
        try:
            rosgraph.Master(rospy.get_name()).lookupService(self._service.resolved_name)
            self._plays_itself = True
        except (rosgraph.MasterException, *SLAVE_API_ERRORS):
            self._plays_itself = False
        self._asked = time.monotonic()
        return self._plays_itself

    def _call(self, message: ModelTrajectory) -> Played:
        try:
            answer = self._service(message)
        except SERVICE_ERRORS as error:
            return Played(False, f"the simulator does not answer: {error}")
        return Played(answer.success, answer.status_message, answer.start.to_nsec())
