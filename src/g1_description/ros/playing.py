"""A motion that is played, paused and stepped through by a person."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import rosgraph
import rospy

from g1_description.errors import MotionError
from g1_description.motion.edit import at_speed, cut, later
from g1_description.motion.trajectory import SNAP, Trajectory
from g1_description.robot.transform import IDENTITY
from g1_description.ros.map_frame import MapFrame
from g1_description.ros.motion_client import MotionClient
from g1_description.ros.robot_view import RobotView
from g1_description.ros.waiting import NoAnswerError
from g1_description.srv import PlayMotion

TIMEOUT = 30.0
"""Longest wait for the bridge, in [s]: machines may be busy."""

GONE = 5.0
"""Time without a publisher of joint states after which the robot is given up, in [s]:
a bridge that failed is started again."""


class PlayedRobot(RobotView):
    """The robot behind play_motion of a namespace."""

    def __init__(self, namespace: str, notify: Callable[[str], None]) -> None:
        """Connect.

        Args:
            namespace: Of the robot's topics, without slashes around; empty: the
                node's.
            notify: Takes messages about what is waited for.

        Raises:
            DescriptionError: If there is no description, or it is not one.
            NoAnswerError: If there is no bridge, or no master.
        """
        with _told_without_master():
            super().__init__(namespace, notify)
        self._told = ""
        self._alone: float | None = None
        """Since when nobody publishes its state, on the monotonic clock."""
        service = rospy.ServiceProxy(f"{self._prefix}play_motion", PlayMotion)
        self.motions = MotionClient(service)
        """What lets it move."""
        if not self.wait_until(lambda: self.newest is not None, TIMEOUT):
            raise NoAnswerError(f"The robot's state is unknown: {self.silence}")

    @property
    def now_ns(self) -> int:
        """Time of its newest state, in [ns]."""
        return self.newest.header.stamp.to_nsec() if self.newest else 0

    def look_after_time(self) -> None:
        """Tell what keeps its time from going on; to be called again and again.

        Raises:
            NoAnswerError: If nobody publishes its state any more.
        """
        obstacle = self.obstacle()
        if obstacle not in ("", self._told):
            self._notify(f"waiting: {obstacle}")
        self._told = obstacle
        if self._subscriber.get_num_connections():
            self._alone = None
            return
        now = time.monotonic()
        self._alone = self._alone or now
        if now > self._alone + GONE:
            raise NoAnswerError(
                f"Nobody publishes {self.topic} any more; the bridge is gone."
            )

    def base_pose(self, frame: str | None) -> np.ndarray:
        """Return where its base is in the map, shape (7,).

        Args:
            frame: The base on TF; None: base_link with the namespace before it.

        Raises:
            MotionError: If TF does not have it.
            NoAnswerError: If there is no master.
        """
        frame = frame or f"{self._prefix.lstrip('/')}base_link"
        try:
            with _told_without_master():
                return MapFrame().pose_in_map(IDENTITY, frame, rospy.Time())
        except MotionError as error:
            raise MotionError(
                f"TF does not know where the robot is: {error}. --base-frame names "
                "its base."
            ) from error


@contextmanager
def _told_without_master() -> Iterator[None]:
    """Raise NoAnswerError where the master does not answer."""
    try:
        yield
    except (OSError, rosgraph.MasterException) as error:
        raise NoAnswerError(f"The master is gone: {error}.") from error


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
