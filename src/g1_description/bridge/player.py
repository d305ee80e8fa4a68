"""The motions of one robot, on our simulator and on the real Gazebo."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple
from weakref import WeakSet

import numpy as np
import rosgraph
import rospy
from gazebo_msgs.msg import ModelState

from g1_description.bridge.commands import JointCommands
from g1_description.bridge.status import RobotStatus
from g1_description.motion.motion import Motion
from g1_description.motion.playlist import Playlist, Setpoint
from g1_description.msg import ModelTrajectory
from g1_description.robot.state import RobotState
from g1_description.ros.conversions import model_trajectory, pose_from_array
from g1_description.ros.publisher import DirectPublisher
from g1_description.ros.waiting import SERVICE_ERRORS, SLAVE_API_ERRORS
from g1_description.ros.wire import MotorArrays
from g1_description.srv import SetAnchor, SetAnchorResponse, SetModelTrajectory

QUEUE_SIZE = 100
"""Samples queued for a busy simulator: a tenth of a second at 1 kHz."""

ASK_PERIOD = 1.0
"""Time after which a stream checks again which simulator is running, in [s]."""

BASE = ""
"""The base among the joints of a ``Claim``."""


class Claim:
    """The joints and the base that a motion moves, until newer commands take them."""

    def __init__(self, parts: Collection[str], start_ns: int) -> None:
        self._parts, self._start_ns = {*parts}, start_ns
        self._lost_ns: float = math.inf

    def is_lost(self, time_ns: int) -> bool:
        """Return whether another command has any of them at a time in [ns]."""
        return time_ns >= self._lost_ns

    def is_shown(self, time_ns: int) -> bool:
        """Return whether a state of a time in [ns] shows it."""
        return time_ns >= self._start_ns

    def give(self, parts: Collection[str], start_ns: int) -> bool:
        """Give parts to a command from its start on; return whether none is left."""
        if self._parts.isdisjoint(parts):
            return False
        is_first = start_ns <= self._start_ns
        self._lost_ns = min(self._lost_ns, 0 if is_first else start_ns)
        if is_first:
            self._parts.difference_update(parts)
        return not self._parts


class Played(NamedTuple):
    """The answer to a motion."""

    success: bool

    message: str
    """Deviations from the request, or why it was refused; may be empty."""

    start_ns: int = 0
    """Start of its times, in [ns]."""

    claim: Claim | None = None
    """Joints and base that it moves, until newer commands take them."""


class MotionPlayer:
    """Plays motions of a robot.

    Our simulator samples a motion itself, at the time of each step, and publishes what
    is commanded. On the real Gazebo the bridge does: see ``GazeboMotions``.
    """

    def __init__(
        self, gazebo: str, status: RobotStatus, commands: JointCommands
    ) -> None:
        self._status = status
        self._name = f"{gazebo}/set_model_trajectory"
        self._plays_itself, self._searched = False, -math.inf
        self._has_motors = False
        self._service = rospy.ServiceProxy(self._name, SetModelTrajectory)
        self._anchor = rospy.ServiceProxy(f"{gazebo}/set_anchor", SetAnchor)
        self._topic = DirectPublisher(self._name, ModelTrajectory, QUEUE_SIZE)
        self._states = DirectPublisher(
            f"{gazebo}/set_model_state", ModelState, QUEUE_SIZE
        )
        self._joints = [joint.name for joint in status.description.movable_joints]
        self._motions = GazeboMotions(self._joints, commands)
        # Locked while a request is sent and recorded, so that the order is the same in
        # the simulator and here. No state waits for it.
        self._sending = threading.Lock()
        self._lock = threading.Lock()
        self._before_base: RobotState | None = None
        self._claims: WeakSet[Claim] = WeakSet()
        self._unseen: list[Claim] = []
        """Claims of motions that no state has shown."""

    def reset(self) -> None:
        """Forget all motions: time began again."""
        self._motions.reset()
        with self._lock:
            self._claims.clear()
            self._unseen = []

    def play(self, motion: Motion, start_ns: int | None = None) -> Played:
        """Play a motion; wait for the simulator's answer.

        Args:
            motion: The motion.
            start_ns: Start of its times, in [ns]; None: now.
        """
        if not self._finds_service():
            return self._play_here(motion, start_ns)
        message = model_trajectory(self._status.name, motion, start_ns)
        with self._sending:
            played = self._call(message)
            if not played.success:
                return played
            return played._replace(claim=self._claim(motion, played.start_ns))

    def stream(self, motion: Motion, start_ns: int | None = None) -> Played:
        """Like ``play``, without waiting: for a stream of configurations."""
        if time.monotonic() > self._searched + ASK_PERIOD:
            self._finds_service()
        if not self._plays_itself:
            return self._play_here(motion, start_ns)
        if not self._topic.get_num_connections():
            return self.play(motion, start_ns)
        message = model_trajectory(self._status.name, motion, start_ns)
        with self._sending:
            # Before it is sent: the first state that shows it may come at once.
            self._claim(motion, start_ns or self._status.stamp)
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
            self._take([BASE])
            if not self._has_motors:
                self._motions.place_base(pose)
            state = self._status.state
            if state is not None and state is self._before_base:
                self._status.count("base commands superseded before shown")
            self._before_base = state
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
                has_base = joints is None
                self._take([*released, BASE] if has_base else released)
                if not plays_itself:
                    self._motions.release(released, has_base)
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
            self._take(positions)
            if not self._has_motors:
                self._motions.command(positions)

    def observe(
        self, state: RobotState, motors: MotorArrays | None
    ) -> tuple[RobotState, bool]:
        """Advance the motions to a state.

        Args:
            state: The state.
            motors: The motors as published with it; None on the real Gazebo.

        Returns:
            The state with the commanded joints and base, and whether it reaches a
            sample of a motion.
        """
        if self._unseen:
            with self._lock:
                self._unseen = [c for c in self._unseen if not c.is_shown(state.stamp)]
        self._has_motors = motors is not None
        if motors is None:
            return self._motions.observe(state)
        pairs = zip(motors.names, motors.commanded.tolist())
        commanded = {name: value for name, value in pairs if not math.isnan(value)}
        base = motors.commanded_base
        state = replace(state, commanded=commanded, commanded_base=base)
        return state, motors.is_sample

    def _claim(self, motion: Motion, start_ns: int) -> Claim:
        """Record the joints of a motion, and motions that no state will show."""
        has_base = motion.base_poses is not None
        parts = [name for name in motion.joint_names if name in self._joints]
        parts += [BASE] if has_base else []
        claim = Claim(parts, start_ns)
        for _ in range(self._take(parts, start_ns)):
            self._status.count("motions superseded before shown")
        with self._lock:
            self._claims.add(claim)
            self._unseen.append(claim)
        return claim

    def _take(self, parts: Collection[str], start_ns: int = 0) -> int:
        """Take joints and the base from motions; return how many nobody will see."""
        with self._lock:
            lost = {one for one in self._claims if one.give(parts, start_ns)}
            seen = [one for one in self._unseen if one not in lost]
            self._unseen, n_unseen = seen, len(self._unseen) - len(seen)
        return n_unseen

    def _play_here(self, motion: Motion, start_ns: int | None) -> Played:
        """Play a motion on a simulator that cannot play motions."""
        now = self._status.stamp
        if not now:
            return Played(
                False, "the simulator has not published a state of the robot yet"
            )
        state = self._status.state
        if motion.base_poses is not None and (state is None or state.base_pose is None):
            return Played(False, f"{self._status.name} has no floating base")
        start = start_ns or now
        with self._sending:
            claim = self._claim(motion, start)
            self._motions.add(motion, start)
        return Played(True, "", start, claim)

    def _finds_service(self) -> bool:
        """Ask the master whether the simulator plays motions itself.

        A subscriber to the topic is not enough: it may be a recorder.
        """
        try:
            rosgraph.Master(rospy.get_name()).lookupService(self._service.resolved_name)
            self._plays_itself = True
        except (rosgraph.MasterException, *SLAVE_API_ERRORS):
            self._plays_itself = False
        self._searched = time.monotonic()
        return self._plays_itself

    def _call(self, message: ModelTrajectory) -> Played:
        try:
            answer = self._service(message)
        except SERVICE_ERRORS as error:
            return Played(False, f"the simulator does not answer: {error}")
        return Played(answer.success, answer.status_message, answer.start.to_nsec())


class GazeboMotions:
    """Motions that the bridge plays, and commands, on the real Gazebo.

    Each published state is answered with the sample of its time.
    """

    def __init__(self, joints: Sequence[str], commands: JointCommands) -> None:
        self._joints, self._commands = joints, commands
        self._lock = threading.Lock()
        self._forget()

    def _forget(self) -> None:
        self._playlist = Playlist(self._joints)
        self._commanded: dict[str, float] = {}
        self._commanded_base: np.ndarray | None = None
        self._is_playing = False
        """Whether any motion was played since the reset."""

    def reset(self) -> None:
        """Forget all motions: time began again."""
        if self._is_playing:
            self._commands.drop(self._joints, base=True)  # states wait for a reset
        with self._lock:
            self._forget()

    def add(self, motion: Motion, start_ns: int) -> None:
        """Play a motion from a time in [ns]."""
        with self._lock:
            self._is_playing = True
            self._playlist.add(motion, start_ns)

    def release(self, joints: Collection[str], base: bool) -> None:
        """End the motions of joints, and optionally of the base."""
        with self._lock:
            self._release(joints, base)
        if self._is_playing:
            self._commands.release(joints, base)

    def command(self, positions: Mapping[str, float]) -> None:
        """End the motions of joints, which go to positions in [rad] or [m]."""
        with self._lock:
            self._release(positions)
            self._commanded.update(positions)

    def place_base(self, pose: np.ndarray) -> None:
        """End the motion of the base, which goes to a pose in the map, shape (7,)."""
        self.release((), base=True)
        with self._lock:
            self._commanded_base = pose

    def _release(self, joints: Collection[str], base: bool = False) -> None:
        rows = [row for row, name in enumerate(self._joints) if name in joints]
        self._playlist.release(rows, base)
        if base:
            self._commanded_base = None

    def observe(self, state: RobotState) -> tuple[RobotState, bool]:
        """Send the samples of a state's time; return as ``MotionPlayer.observe``."""
        with self._lock:
            is_sample = bool(self._playlist) and self._advance(state)
            commanded, base = self._commanded.copy(), self._commanded_base
        return replace(state, commanded=commanded, commanded_base=base), is_sample

    def _advance(self, state: RobotState) -> bool:
        stamp, is_sample = state.stamp, False
        if self._playlist.is_waiting:
            self._playlist.begin(stamp, self._present(state))
        for playback in self._playlist.moving():
            is_sample = playback.reaches_sample(stamp) or is_sample
            sample = playback.setpoint(stamp)
            names = [self._joints[row] for row in sample.rows]
            positions = dict(zip(names, sample.positions.tolist()))
            self._commanded.update(positions)
            if sample.base_pose is not None:
                self._commanded_base = sample.base_pose
            self._commands.put(positions, sample.base_pose)
        self._playlist.drop_over(stamp)
        return is_sample

    def _present(self, state: RobotState) -> Setpoint:
        """Return the robot's state as a setpoint; joints not measured are at zero."""
        n = len(self._joints)
        position, velocity = np.zeros(n), np.zeros(n)
        own = [self._joints.index(name) for name in state.names]
        position[own], velocity[own] = state.positions, state.velocities
        return Setpoint(np.arange(n), position, velocity, state.base_pose)
