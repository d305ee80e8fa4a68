"""Which states of a robot go to TF: complete ones, at the rate that listeners need."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Optional, Tuple

import numpy as np

from g1_description.robot.state import RobotState

MIN_MOTION = 1e-9
"""Smallest change that counts as a motion, in [m], [rad] or parts of a quaternion."""

ANSWER_DELAY = 0.02
"""Longest time in [s] of wall time from the answer to a command to a state with it."""

MAX_HOLD = 0.05
"""Longest time in [s] of wall time without a state on TF: commands may come without a
pause."""

JOINTS_PERIOD = 20_000_000
"""Longest time in [ns] between two joint states on TF: 50 Hz, the rate of
robot_state_publisher itself."""

STILL_PERIOD = 50_000_000
"""The same in [ns] while no joint moves: each message makes robot_state_publisher ask
the master three times for ``tf_prefix``, which costs as much as the message does."""


@dataclass
class PoseThrottle:
    """Lets a pose pass when it moved, turned, or was last sent a while ago.

    Plain numbers: for a single pose they cost a tenth of what arrays do.
    """

    position_threshold: float
    """A pose this far from the last one sent passes, in [m]."""

    rotation_threshold: float
    """A pose turned this far from the last one sent passes, in [rad]."""

    max_interval: float
    """Any pose passes this long after the last one sent, in [s]."""

    min_interval: float = 0.0
    """No pose passes sooner than this after the last one sent, in [s]."""

    _stamp: float | None = None
    _pose: Sequence[float] | None = None

    def passes(self, stamp: float, pose: Sequence[float], is_due: bool = False) -> bool:
        """Decide on one pose, and remember it as sent if it passes.

        Args:
            stamp: Time of the pose in [s]. A stamp that is not newer than the
                last one sent never passes.
            pose: Position and unit quaternion (x, y, z, w), seven numbers.
            is_due: Whether it passes without having moved; ``min_interval`` applies.

        Returns:
            Whether to send the pose.
        """
        if self._stamp is not None and self._pose is not None:
            # A thousandth of a microsecond: stamps are whole nanoseconds.
            since = stamp - self._stamp + 1e-9
            if stamp <= self._stamp or since < self.min_interval:
                return False
            is_due = is_due or since >= self.max_interval
            if not is_due and not self._moved(self._pose, pose):
                return False
        self._stamp, self._pose = stamp, pose
        return True

    def settles(self, stamp: float, pose: Sequence[float]) -> bool:
        """Decide on the last pose, and remember it as sent if it passes.

        Returns:
            Whether its stamp is newer than that of the last one sent.
        """
        if self._stamp is not None and stamp <= self._stamp:
            return False
        self._stamp, self._pose = stamp, pose
        return True

    def is_near(self, pose: Sequence[float]) -> bool:
        """Whether a pose is within a tenth of the thresholds of the last one sent."""
        return self._pose is not None and not self._moved(self._pose, pose, 0.1)

    def _moved(
        self, before: Sequence[float], pose: Sequence[float], fraction: float = 1.0
    ) -> bool:
        """Whether a pose differs by at least a fraction of a threshold."""
        if math.dist(pose[:3], before[:3]) >= fraction * self.position_threshold:
            return True
        # The chord between unit quaternions; q and -q are the same rotation.
        opposite = [-part for part in before[3:]]
        chord = min(math.dist(pose[3:], before[3:]), math.dist(pose[3:], opposite))
        angle = 4.0 * math.asin(min(1.0, 0.5 * chord))
        return angle >= fraction * self.rotation_threshold

    def reset(self) -> None:
        """Forget what was sent: the next pose passes."""
        self._stamp = self._pose = None


class WholeStates:
    """Delays each state by one, until it is known to be complete.

    A planner that moves base and joints sends two messages at a time, and the one for
    the joints takes longer: through the bridge. A state between the two has a new base
    and old joints, and a stance foot slides by a step of the motion. So a state whose
    base has moved does not pass while a command for the joints is pending. States that
    move by themselves, and samples of a motion, are complete.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the delayed state."""
        self.delayed: RobotState | None = None
        """The last state."""
        self.is_sample = False
        """Whether it reached a sample of a motion: all of them are sent to TF."""
        self._is_torn = False
        self._base_moved = False
        self._shown: np.ndarray | None = None
        self._passed = self._answered = -math.inf
        self._commands = 0

    def next(
        self,
        state: RobotState,
        now: float,
        commands: int = 0,
        is_under_way: bool = False,
        is_sample: bool = False,
    ) -> RobotState | None:
        """Take a state.

        Args:
            state: The state, which has a base.
            now: Wall time, from any beginning, in [s].
            commands: Number of commands for the joints until now.
            is_under_way: Whether one of them has not been answered.
            is_sample: Whether the state reached a sample of a motion.

        Returns:
            The previous state, if it was complete or was delayed for too long.
        """
        delayed, self.delayed = self.delayed, state
        was_sample, self.is_sample = self.is_sample, is_sample
        has_news, self._commands = commands != self._commands, commands
        if delayed is None or len(state.positions) != len(delayed.positions):
            return delayed
        was_torn = self._is_torn or (self._base_moved and has_news)
        self._base_moved = _differ(state.base_pose, delayed.base_pose)
        joints_moved = _differ(state.positions, delayed.positions)
        if is_under_way or (has_news and not joints_moved):
            self._is_torn, self._answered = True, now
        elif joints_moved or now - self._answered > ANSWER_DELAY:
            self._is_torn = False
        if was_torn and now - self._passed < MAX_HOLD:
            is_still = self._shown is not None and not _differ(
                delayed.base_pose, self._shown
            )
            is_moving = delayed.velocities is not None and delayed.velocities.any()
            if not (is_still or is_moving or was_sample):
                return None
        self._shown, self._passed = delayed.base_pose, now
        return delayed


Shown = Tuple[Optional[RobotState], Optional[RobotState]]
"""The states whose joints and whose base go to TF; None: not sent."""


class TfFilter:
    """Decides whether a state's base and joints go to TF.

    TF interpolates neither if both are sent with one stamp. So the joints are sent with
    each base, and alone, if they are due, while the base stands still. The last pose of
    a standing base is sent before it moves: otherwise TF would interpolate its motion
    at the stamps of those joints. Joints are sent less often while none of them moves,
    and the last state before one moves is sent, too.
    """

    def __init__(self, throttle: PoseThrottle) -> None:
        self._throttle, self._whole_states = throttle, WholeStates()
        self._joints_stamp = -STILL_PERIOD
        self._joints = np.zeros(0)
        self._is_base_old = False

    def next(
        self,
        state: RobotState,
        now: float,
        commands: int = 0,
        is_under_way: bool = False,
        is_sample: bool = False,
    ) -> Shown:
        """Take a state; the arguments are those of ``WholeStates.next``.

        Returns:
            The parts of the previous state to send.
        """
        was_sample = self._whole_states.is_sample
        whole = self._whole_states.next(state, now, commands, is_under_way, is_sample)
        if whole is None:
            return None, None
        pose = whole.base_pose.tolist()
        is_due = self._is_due(whole, state) and self._throttle.is_near(pose)
        leaves = (is_due or self._is_base_old) and not self._throttle.is_near(
            state.base_pose.tolist()
        )
        with_base = self._throttle.passes(
            1e-9 * whole.stamp, pose, was_sample or leaves
        )
        return self._shown(whole, with_base or (is_due and not leaves), with_base)

    def settle(self) -> Shown:
        """Decide on the last state while time stands still.

        Returns:
            The parts of it to send that were not sent yet.
        """
        delayed = self._whole_states.delayed
        if delayed is None:
            return None, None
        with_base = self._throttle.settles(
            1e-9 * delayed.stamp, delayed.base_pose.tolist()
        )
        return self._shown(delayed, True, with_base)

    def _shown(self, state: RobotState, wants_joints: bool, with_base: bool) -> Shown:
        """Record the parts of a state that are sent; joints are sent once."""
        with_joints = wants_joints and state.stamp > self._joints_stamp
        if with_joints:
            self._joints_stamp, self._joints = state.stamp, state.positions
            self._is_base_old = not with_base
        return state if with_joints else None, state if with_base else None

    def _is_due(self, state: RobotState, newer: RobotState) -> bool:
        """Whether a state's joints are due without the base."""
        age = state.stamp - self._joints_stamp
        if age < JOINTS_PERIOD:
            return False
        moved = (_differ(one.positions, self._joints) for one in (state, newer))
        return age >= STILL_PERIOD or any(moved)

    def passes_without_base(self, stamp: int) -> bool:
        """Decide on joint states at a time in [ns] whose base is unknown."""
        is_due = not 0 <= stamp - self._joints_stamp < JOINTS_PERIOD
        if is_due:
            self._joints_stamp = stamp
        return is_due

    def drop(self) -> None:
        """Forget the delayed state: the robot is gone."""
        self._whole_states.reset()

    def reset(self) -> None:
        """Forget what was sent: time began again, or a listener is new."""
        self._throttle.reset()
        self._whole_states.reset()
        self._joints_stamp = -STILL_PERIOD
        self._is_base_old = False


def _differ(numbers: np.ndarray, others: np.ndarray) -> bool:
    """Whether positions or poses differ, in number or by a motion."""
    if len(numbers) != len(others):
        return True
    return bool(np.abs(numbers - others).max(initial=0.0) > MIN_MOTION)
