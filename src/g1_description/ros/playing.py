"""Playback of motions on a running robot, through its bridge.

Calls: play_motion (g1_description/PlayMotion), set_anchor (g1_description/SetAnchor)
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Protocol

import numpy as np
import rospy

from g1_description.motion.edit import later
from g1_description.motion.motion import SNAP, Motion
from g1_description.msg import RobotTrajectory
from g1_description.ros.motion_messages import whole_body_message
from g1_description.ros.waiting import NoAnswerError, RefusedError


class MotionClient:
    """Requests motions of a robot's bridge, and stops them."""

    def __init__(self, service: rospy.ServiceProxy) -> None:
        self._service = service
        self._lock = threading.Lock()
        self.is_left = False
        """Whether no motion may start any more."""
        self.may_move = False
        """Whether the robot may be moving."""

    def play(self, motion: Motion) -> tuple[int, str]:
        """Play a motion now.

        Returns:
            Start of its times, in [ns], and deviations from the request.

        Raises:
            G1DescriptionError: If it is refused, or the bridge does not answer.
            ROSInterruptException: After ``leave``.
        """
        with self._lock:
            # Set before is_left is read: leave() sets is_left before it reads may_move.
            self.may_move = len(motion.times) > 1 or motion.times[0] > 0.0
            if self.is_left:
                self.may_move = False
                raise rospy.ROSInterruptException("interrupted")
            try:
                return self._call(whole_body_message(motion))
            except RefusedError:
                self.may_move = False
                raise

    def stop(self) -> None:
        """Stop the robot at its current state.

        Raises:
            G1DescriptionError: If it is refused, or the bridge does not answer.
        """
        with self._lock:
            self._call(RobotTrajectory())
            self.may_move = False

    def leave(self) -> bool:
        """Start no further motion, and stop the robot if it may be moving.

        Thread-safe. A motion being requested is stopped when the bridge has answered.

        Returns:
            Whether the robot was stopped.

        Raises:
            G1DescriptionError: If it is refused, or the bridge does not answer.
        """
        self.is_left = True
        if not self.may_move:
            return False
        self.stop()
        return True

    def _call(self, message: RobotTrajectory) -> tuple[int, str]:
        try:
            answer = self._service(message)
        except (rospy.ServiceException, OSError) as error:
            name = self._service.resolved_name
            raise NoAnswerError(
                f"{name} does not answer; is the bridge running? {error}"
            ) from error
        if not answer.success:
            raise RefusedError(f"The motion was refused: {answer.status_message}")
        return answer.start.to_nsec(), answer.status_message


def set_anchor(service: rospy.ServiceProxy, link: str) -> str:
    """Set the link of a robot that stays at its place while joints move.

    Args:
        service: The service ``set_anchor`` of its bridge.
        link: A link, or ``lowest_foot``; empty: none.

    Returns:
        The anchor before; empty: none.

    Raises:
        RefusedError: If there is no such link, or physics is not ``kinematic``.
        NoAnswerError: If the bridge does not answer.
    """
    try:
        answer = service(link_name=link)
    except (rospy.ServiceException, OSError) as error:
        raise NoAnswerError(
            f"{service.resolved_name} does not answer; is the bridge running? {error}"
        ) from error
    if not answer.success:
        raise RefusedError(f"The anchor was refused: {answer.status_message}.")
    return str(answer.previous)


class PlayedRobot(Protocol):
    """A robot whose bridge plays motions: a ``RobotView``, or a robot of the page."""

    motions: MotionClient

    @property
    def now_ns(self) -> int:
        """Time of its newest state, in [ns]."""

    def look_after_time(self) -> None:
        """Report why its time stands still, if it does.

        Raises:
            NoAnswerError: If its state is no longer published.
        """


REST = 1.0
"""Pause before a motion starts again, in [s]."""


class Session:
    """The playback of a motion: its position, and whether it runs."""

    def __init__(
        self,
        robot: PlayedRobot,
        motion: Motion,
        speed: float,
        notify: Callable[[str], None],
        lead_in: float = 0.0,
    ) -> None:
        """Create a playback; nothing moves yet.

        Args:
            robot: The robot that plays the motion.
            motion: The motion.
            speed: Seconds of the motion per second.
            notify: Called with messages about deviations from the request.
            lead_in: Time to go to the start of the motion, in [s].
        """
        self._robot, self._notify = robot, notify
        self.speed = speed
        """Seconds of the motion per second; takes effect with ``start``."""
        self._lead_in = lead_in
        self.motion = motion
        self.is_running = False
        self._reported, self._rate = "", speed
        self._begin_ns: int | None = None
        """Start of the playback, after the lead-in, in [ns]."""
        self._seen_ns = 0
        self._from = self._time = self.begin
        self._ended: float | None = None

    @property
    def begin(self) -> float:
        """Time of the first sample, in [s]."""
        return self.motion.begin

    @property
    def end(self) -> float:
        """Time of the last sample, in [s]."""
        return self.motion.end

    @property
    def time(self) -> float:
        """Time of the motion that the robot shows, in [s].

        Raises:
            NoAnswerError: If the robot was reset meanwhile, or is gone.
        """
        if self.is_running:
            self._robot.look_after_time()
            now_ns = self._robot.now_ns
            if now_ns < self._seen_ns:
                self.is_running = self._robot.motions.may_move = False
                raise NoAnswerError(
                    "Time went back during the motion; the simulator was reset."
                )
            self._seen_ns = now_ns
            begin_ns = now_ns if self._begin_ns is None else self._begin_ns
            elapsed = 1e-9 * (now_ns - begin_ns)
            self._time = self._from + self._rate * max(0.0, elapsed)
        return float(np.clip(self._time, self.begin, self.end))

    @property
    def sample(self) -> int:
        """Number of the sample at or before that time, from 1."""
        until = self.time + SNAP
        return int(np.searchsorted(self.motion.times, until, side="right"))

    @property
    def has_begun(self) -> bool:
        """Whether the lead-in is over."""
        return self._begin_ns is not None and self._robot.now_ns >= self._begin_ns

    @property
    def is_over(self) -> bool:
        """Whether the motion has ended."""
        is_over = self.is_running and self.time >= self.end and self.has_begun
        if is_over:
            self._robot.motions.may_move = False
        return is_over

    def start(self, time: float | None = None) -> None:
        """Play from a time of the motion in [s]; by default from the current one."""
        self._from = self.time if time is None else time
        if self._from >= self.end:
            self._from = self.begin
            self._begin_ns = None
        self._seen_ns, self._ended, self._rate = 0, None, self.speed
        part = self.motion.cut(self._from)
        self.is_running = False
        self._begin_ns = self._play(part.at_speed(self._rate, self._from))
        self.is_running = True

    def rest(self) -> None:
        """Stay at the end, which is reached."""
        self._time, self.is_running = self.end, False
        self._robot.motions.may_move = False

    def pause(self) -> None:
        """Stop the robot at its current state."""
        if self.is_running:
            self._robot.motions.stop()
            self._time, self.is_running = self.time, False
            if not self.has_begun:
                self._begin_ns = None

    def step(self, n: int) -> None:
        """Pause, and show the sample ``n`` after the current one."""
        last = len(self.motion.times) - 1
        row = min(max(self.sample - 1 + n, 0), last)
        self.show(float(self.motion.times[row]))

    def show(self, time: float) -> None:
        """Pause, and show the configuration at a time of the motion, in [s]."""
        self.pause()
        self._time = time
        part = self.motion.cut(time, time).at_speed(1.0, time)
        begin_ns = self._play(part)
        if not self.has_begun:
            self._begin_ns = begin_ns

    def toggle(self) -> None:
        """Pause or resume."""
        if self.is_running:
            self.pause()
        else:
            self.start()

    def restart_when_rested(self) -> None:
        """Start again some time after the end."""
        now = time.monotonic()
        self._ended = self._ended or now
        if now >= self._ended + REST:
            self._begin_ns = None
            self.start(self.begin)

    def _play(self, part: Motion) -> int:
        """Play a part of the motion; return its start in [ns]."""
        lead_in = 0.0 if self.has_begun else self._lead_in
        start_ns, message = self._robot.motions.play(later(part, lead_in))
        if message != self._reported:
            self._reported = message
            self._notify(f"{message}.")
        return start_ns + round(1e9 * lead_in)
