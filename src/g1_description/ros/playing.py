"""Motions of a robot that runs: asked of its bridge, paused and stepped by a person.

Calls: play_motion (g1_description/PlayMotion)
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Protocol

import numpy as np
import rospy
from trajectory_msgs.msg import MultiDOFJointTrajectoryPoint

from g1_description.motion.edit import at_speed, cut, later
from g1_description.motion.trajectory import SNAP, Trajectory
from g1_description.msg import RobotTrajectory
from g1_description.ros.conversions import to_transform
from g1_description.ros.motion_messages import durations_of, message_of_joints
from g1_description.ros.waiting import NoAnswerError, RefusedError


class MotionClient:
    """Asks a robot's bridge for motions, and stops what it has asked for."""

    def __init__(self, service: rospy.ServiceProxy) -> None:
        self._service = service
        self._lock = threading.Lock()
        self.is_left = False
        """Whether no motion may begin any more."""
        self.may_move = False
        """Whether the robot may be on its way."""

    def play(self, trajectory: Trajectory) -> tuple[int, str]:
        """Let the robot go through a motion, at once.

        Returns:
            When its times count from, in [ns], and what was not done as requested.

        Raises:
            G1DescriptionError: If that is refused, or nobody answers.
            ROSInterruptException: If the robot was left.
        """
        with self._lock:
            # Before the question: who leaves sets is_left before it looks at may_move.
            self.may_move = len(trajectory.times) > 1 or trajectory.times[0] > 0.0
            if self.is_left:
                self.may_move = False
                raise rospy.ROSInterruptException("interrupted")
            try:
                return self._call(_message(trajectory))
            except RefusedError:
                self.may_move = False
                raise

    def stop(self) -> None:
        """Stop the robot where it is.

        Raises:
            G1DescriptionError: If that is refused, or nobody answers.
        """
        with self._lock:
            self._call(RobotTrajectory())
            self.may_move = False

    def leave(self) -> bool:
        """Begin no motion any more, and stop the robot if it may be on its way.

        It may be called from any thread. A motion that the bridge has been asked for is
        stopped as soon as it has answered.

        Returns:
            Whether the robot was stopped.

        Raises:
            G1DescriptionError: If that is refused, or nobody answers.
        """
        self.is_left = True
        if not self.may_move:
            return False
        self.stop()
        return True

    def _call(self, message: RobotTrajectory) -> tuple[int, str]:
        """Call the bridge."""
        try:
            answer = self._service(message)
        except (rospy.ServiceException, OSError) as error:
            name = self._service.resolved_name
            raise NoAnswerError(
                f"{name} does not answer, is the bridge running? {error}"
            ) from error
        if not answer.success:
            raise RefusedError(f"The motion is refused: {answer.status_message}")
        return answer.start.to_nsec(), answer.status_message


def _message(trajectory: Trajectory) -> RobotTrajectory:
    """Write a motion as a message."""
    message = RobotTrajectory()
    if trajectory.joint_names:
        message.joint_trajectory = message_of_joints(trajectory)
    if trajectory.base_poses is not None:
        base = message.multi_dof_joint_trajectory
        base.joint_names = ["base"]
        base.points = [
            MultiDOFJointTrajectoryPoint(
                transforms=[to_transform(pose)], time_from_start=time
            )
            for pose, time in zip(
                trajectory.base_poses.tolist(), durations_of(trajectory)
            )
        ]
    return message


class PlayedRobot(Protocol):
    """A robot whose bridge plays motions: a ``RobotView``, or one of the page."""

    motions: MotionClient

    @property
    def now_ns(self) -> int:
        """Time of its newest state, in [ns]."""

    def look_after_time(self) -> None:
        """Report what keeps its time from going on.

        Raises:
            NoAnswerError: If nobody publishes its state any more.
        """


REST = 1.0
"""Time between the end of a motion and its next beginning, in [s]."""


class Session:
    """Where a motion is, and whether it runs."""

    def __init__(
        self,
        robot: PlayedRobot,
        trajectory: Trajectory,
        speed: float,
        notify: Callable[[str], None],
        lead_in: float = 0.0,
    ) -> None:
        """Prepare; the robot does nothing yet.

        Args:
            robot: Who goes through the motion.
            trajectory: The motion.
            speed: Seconds of the motion in a second.
            notify: Takes messages about what was not done as requested.
            lead_in: Time in which the robot goes to the beginning, in [s].
        """
        self._robot, self._notify = robot, notify
        self.speed = speed
        """Seconds of the motion in a second; what is chosen counts from ``start`` on.
        """
        self._lead_in = lead_in
        self.trajectory = trajectory
        self.is_running = False
        self._told, self._rate = "", speed
        self._begin_ns: int | None = None
        """When what is played begins, after the lead-in, in [ns]."""
        self._seen_ns = 0
        self._from = self._time = self.begin
        self._ended: float | None = None

    @property
    def begin(self) -> float:
        """Time of the first sample, in [s]."""
        return float(self.trajectory.times[0])

    @property
    def end(self) -> float:
        """Time of the last sample, in [s]."""
        return self.trajectory.duration

    @property
    def time(self) -> float:
        """Time of the motion that the robot shows, in [s].

        Raises:
            NoAnswerError: If the robot was reset on the way, or is gone.
        """
        if self.is_running:
            self._robot.look_after_time()
            now_ns = self._robot.now_ns
            if now_ns < self._seen_ns:
                self.is_running = self._robot.motions.may_move = False
                raise NoAnswerError("Time went back on the way; the robot was reset.")
            self._seen_ns = now_ns
            begin_ns = now_ns if self._begin_ns is None else self._begin_ns
            elapsed = 1e-9 * (now_ns - begin_ns)
            self._time = self._from + self._rate * max(0.0, elapsed)
        return float(np.clip(self._time, self.begin, self.end))

    @property
    def frame(self) -> int:
        """Number of the sample at or before that time, from 1."""
        until = self.time + SNAP
        return int(np.searchsorted(self.trajectory.times, until, side="right"))

    @property
    def _is_there(self) -> bool:
        """Whether the robot has come to the beginning of what is played."""
        return self._begin_ns is not None and self._robot.now_ns >= self._begin_ns

    @property
    def is_over(self) -> bool:
        """Whether it has come to its end."""
        is_over = self.is_running and self.time >= self.end and self._is_there
        if is_over:
            self._robot.motions.may_move = False
        return is_over

    def start(self, time: float | None = None) -> None:
        """Play from a time of the motion in [s]; by default from where it is."""
        self._from = self.time if time is None else time
        if self._from >= self.end:
            self._from = self.begin
            self._begin_ns = None
        self._seen_ns, self._ended, self._rate = 0, None, self.speed
        part = cut(self.trajectory, self._from)
        self.is_running = False
        self._begin_ns = self._play(at_speed(part, self._rate, self._from))
        self.is_running = True

    def rest(self) -> None:
        """Stay at the end, which is reached: nothing is stopped."""
        self._time, self.is_running = self.end, False
        self._robot.motions.may_move = False

    def pause(self) -> None:
        """Stop the robot where it is."""
        if self.is_running:
            self._robot.motions.stop()
            self._time, self.is_running = self.time, False
            if not self._is_there:
                self._begin_ns = None

    def step(self, n: int) -> None:
        """Pause, and show the sample ``n`` after the present one."""
        last = len(self.trajectory.times) - 1
        row = min(max(self.frame - 1 + n, 0), last)
        self.show(float(self.trajectory.times[row]))

    def show(self, time: float) -> None:
        """Pause, and show the configuration of a time of the motion, in [s]."""
        self.pause()
        self._time = time
        part = at_speed(cut(self.trajectory, time, time), 1.0, time)
        begin_ns = self._play(part)
        if not self._is_there:
            self._begin_ns = begin_ns

    def toggle(self) -> None:
        """Pause, or go on."""
        if self.is_running:
            self.pause()
        else:
            self.start()

    def restart_when_rested(self) -> None:
        """Begin again some time after the end."""
        now = time.monotonic()
        self._ended = self._ended or now
        if now >= self._ended + REST:
            self._begin_ns = None
            self.start(self.begin)

    def _play(self, part: Trajectory) -> int:
        """Let the robot play a part; return when it begins, in [ns]."""
        lead_in = 0.0 if self._is_there else self._lead_in
        start_ns, message = self._robot.motions.play(later(part, lead_in))
        if message != self._told:
            self._told = message
            self._notify(f"{message}.")
        return start_ns + round(1e9 * lead_in)
