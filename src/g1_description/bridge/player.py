"""The motions of one robot, on the stand-in and on the real Gazebo."""

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
from g1_description.motion.playlist import Playback, Playlist, Setpoint
from g1_description.motion.trajectory import Trajectory
from g1_description.msg import ModelTrajectory
from g1_description.robot.state import RobotState
from g1_description.ros.conversions import model_trajectory, pose_from_array
from g1_description.ros.master import SERVICE_ERRORS, SLAVE_API_ERRORS
from g1_description.ros.publisher import DirectPublisher
from g1_description.srv import SetModelTrajectory

QUEUE_SIZE = 100
"""Samples kept for a busy simulator: a tenth of a second of them at 1 kHz."""

ASK_PERIOD = 1.0
"""Time after which a stream asks again which simulator there is, in [s]."""

ANSWER_TIMEOUT = 0.4
"""Longest wait in [s] of wall time of a state for the answer to a motion that it may
show: shorter than the stand-in, while it steps, waits for the bridge to read."""


class Played(NamedTuple):
    """The answer to a motion."""

    success: bool

    message: str
    """What was not done exactly as requested, or why nothing was; may be empty."""

    start_ns: int = 0
    """When its times count from, in [ns]."""

    playback: Playback | None = None
    """What is left of the motion: newer commands may replace some of it."""


class MotionPlayer:
    """Lets a robot go through motions.

    The stand-in samples a motion itself, at the time of each step. On the real Gazebo
    each state that it publishes is answered with the sample of that time.

    What motions and commands want is kept where that is asked for, for the ghost.
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
        self._was_stand_in, self._asked = False, -math.inf
        self._service = rospy.ServiceProxy(self._name, SetModelTrajectory)
        self._topic = DirectPublisher(self._name, ModelTrajectory, QUEUE_SIZE)
        self._states = DirectPublisher(
            f"{gazebo}/set_model_state", ModelState, QUEUE_SIZE
        )
        self._commands = commands
        self._plays_here = False
        # Held while the simulator is told something and it is noted here, so that both
        # know it in the same order. No state waits for it.
        self._telling = threading.Lock()
        self._lock = threading.Condition()
        self._is_awaited = False
        self._before_base: RobotState | None = None
        self._joints = [joint.name for joint in status.description.movable_joints]
        self._keeps_commands = keeps_commands
        self.reset()

    def reset(self) -> None:
        """Forget all motions: time began again."""
        if self._plays_here:
            self._commands.release(self._joints, base=True)
        with self._lock:
            count = partial(self._status.count, "motions superseded before shown")
            self._playlist = Playlist(self._joints, count)
            self._commanded: dict[str, float] = {}
            self._commanded_base: np.ndarray | None = None
            self._plays_here = False
            self.is_idle = True
            """Whether no motion was sent since then; then nothing is to be observed."""

    def play(self, trajectory: Trajectory, start_ns: int | None = None) -> Played:
        """Let the robot go through a motion; wait for the simulator's answer.

        Args:
            trajectory: The motion.
            start_ns: When its times count from, in [ns]; None: at once.
        """
        if not self._is_stand_in():
            return self._play_here(trajectory, start_ns)
        message = model_trajectory(self._status.name, trajectory, start_ns)
        played = Played(False, "")
        with self._telling:
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

    def stream(self, trajectory: Trajectory, start_ns: int | None = None) -> Played:
        """Do the same without waiting: for configurations that follow each other."""
        if time.monotonic() > self._asked + ASK_PERIOD:
            self._is_stand_in()
        if not self._was_stand_in:
            return self._play_here(trajectory, start_ns)
        if not self._topic.get_num_connections():
            return self.play(trajectory, start_ns)
        message = model_trajectory(self._status.name, trajectory, start_ns)
        with self._telling:
            self._plays_here = False
            # Known before it shows, so that the first state that shows it finds it.
            self._add(trajectory, start_ns or self._status.stamp)
            self._topic.publish(message)
        return Played(True, "")

    def place_base(self, pose: np.ndarray) -> Played:
        """Put the robot somewhere by its root link, which ends the base's motion.

        Args:
            pose: Of the root link in the map, shape (7,).
        """
        if not self._states.get_num_connections():
            return Played(False, f"nobody listens to {self._states.name}")
        message = ModelState(model_name=self._status.name, pose=pose_from_array(pose))
        with self._telling:
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
        """Send the simulator what is kept for it."""
        self._topic.flush()
        self._states.flush()

    def stop(self, joints: Collection[str] | None = None) -> Played:
        """Stop joints where they are; by default all, and the base."""
        if joints is not None and not joints:
            return Played(True, "")
        is_stand_in = self._is_stand_in()
        with self._telling:
            if is_stand_in:
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

    def command(self, positions: Mapping[str, float]) -> None:
        """Note a command for joints, which takes them from any motion.

        Args:
            positions: In [rad] or [m] by joint name.
        """
        with self._telling:
            if self._keeps_commands:
                self.is_idle = False
            self._release(positions)  # the command replaces what is queued of them
            if self._keeps_commands:
                with self._lock:
                    self._commanded.update(positions)

    def _release(self, joints: Collection[str], base: bool = False) -> None:
        """Leave joints, and perhaps the base, to another command."""
        if self.is_idle:
            return
        with self._lock:
            rows = [row for row, name in enumerate(self._joints) if name in joints]
            self._playlist.release(rows, base)
            if base:
                self._commanded_base = None

    def observe(self, state: RobotState) -> bool:
        """Go on with the motions; return whether they reach a sample."""
        with self._lock:
            # The first states of a motion come before the answer.
            if self._is_awaited:
                self._lock.wait_for(lambda: not self._is_awaited, ANSWER_TIMEOUT)
                self._is_awaited = False
            return bool(self._playlist) and self._advance(state)

    def with_commands(self, state: RobotState) -> RobotState:
        """Return a state with what motions and commands want, if that is kept."""
        with self._lock:
            return replace(
                state,
                commanded=self._commanded.copy(),
                commanded_base=self._commanded_base,
            )

    def _advance(self, state: RobotState) -> bool:
        """Go on with the motions; return whether they reach a sample."""
        stamp = state.stamp
        if self._playlist.is_waiting:
            self._playlist.begin(stamp, self._present(state))
        is_sample = False
        for playback in self._playlist.moving():
            is_sample = playback.reaches_sample(stamp) or is_sample
            if self._keeps_commands or self._plays_here:
                self._obey(playback.setpoint(stamp))
        self._playlist.drop_over(stamp)
        return is_sample

    def _obey(self, setpoint: Setpoint) -> None:
        """Keep a sample, or send it to a simulator that cannot play."""
        names = [self._joints[row] for row in setpoint.rows]
        positions = dict(zip(names, setpoint.positions.tolist()))
        if self._keeps_commands:
            self._commanded.update(positions)
            if setpoint.base_pose is not None:
                self._commanded_base = setpoint.base_pose
        if self._plays_here:
            self._commands.put(positions, setpoint.base_pose)

    def _present(self, state: RobotState) -> Setpoint:
        """Return where the robot is; joints that are not measured are at zero."""
        n = len(self._joints)
        position, velocity = np.zeros(n), np.zeros(n)
        own = [self._joints.index(name) for name in state.names]
        position[own], velocity[own] = state.positions, state.velocities
        return Setpoint(np.arange(n), position, velocity, state.base_pose)

    def _play_here(self, trajectory: Trajectory, start_ns: int | None) -> Played:
        """Play a motion on a simulator that cannot do so itself."""
        now = self._status.stamp
        if not now:
            return Played(False, "the simulator has published no state of the robot")
        state = self._status.state
        if trajectory.base_poses is not None and (
            state is None or state.base_pose is None
        ):
            return Played(False, f"{self._status.name} has no base that moves")
        self._plays_here = True
        playback = self._add(trajectory, start_ns or now)
        return Played(True, "", start_ns or now, playback)

    def _add(self, trajectory: Trajectory, start_ns: int) -> Playback:
        """Note a motion that was begun."""
        with self._lock:
            self.is_idle = False
            return self._playlist.add(trajectory, start_ns)

    def _is_stand_in(self) -> bool:
        """Ask the master whether the simulator plays motions by itself.

        Listeners to its topic tell nothing: that may be a recorder.
        """
        try:
            rosgraph.Master(rospy.get_name()).lookupService(self._service.resolved_name)
            self._was_stand_in = True
        except (rosgraph.MasterException, *SLAVE_API_ERRORS):
            self._was_stand_in = False
        self._asked = time.monotonic()
        return self._was_stand_in

    def _call(self, message: ModelTrajectory) -> Played:
        """Call the stand-in's service."""
        try:
            answer = self._service(message)
        except SERVICE_ERRORS as error:
            return Played(False, f"the simulator does not answer: {error}")
        return Played(answer.success, answer.status_message, answer.start.to_nsec())
