"""Which states of a robot go to TF: complete ones, at the rate that listeners need."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Optional, Tuple

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
"""Longest time while no joint moves: each message makes robot_state_publisher ask
the master three times for ``tf_prefix``, which costs as much as the message does."""


@dataclass
class PoseThrottle:
    """Lets a pose pass when it moved, turned, or was last sent a while ago.

    Plain numbers: for a single pose they cost a tenth of arrays' time.
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
        """Forget the last pose: the next one passes."""
        self._stamp = self._pose = None


class Delayed(NamedTuple):
    """A state that waits for the next one."""

    state: RobotState
    is_sample: bool = False
    """Whether it reached a sample of a motion."""

    is_torn: bool = False
    """Whether a command for the joints was pending when it came."""

    base_moved: bool = False
    """Whether its base differs from that of the state before."""


class WholeStates:
    """Delays each state by one, until it is known to be complete.

    A planner that moves base and joints sends two messages at a time, and the one for
    the joints takes longer: through the bridge. A state between the two has a new base
    and old joints, and a stance foot slides by a step of the motion. Each state is the
    first of these cases that it matches:

    ==============================================================  ==================
    a state                                                         passes
    ==============================================================  ==================
    whose next state has other joints than it, in number            yes
    that reached a sample of a motion, or moves by itself           yes
    with the base that was shown last                               yes
    that came while a command for the joints was under way          after ``MAX_HOLD``
    that came after a command was answered, and before the joints   after ``MAX_HOLD``
    moved, for ``ANSWER_DELAY``
    whose base moved, if a command came before the next state       after ``MAX_HOLD``
    else                                                            yes
    ==============================================================  ==================
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the delayed state."""
        self.delayed: Delayed | None = None
        self._commands = 0
        self._torn_until = self._passed = -math.inf
        self._shown: np.ndarray | None = None

    def next(
        self,
        state: RobotState,
        now: float,
        commands: int = 0,
        is_under_way: bool = False,
        is_sample: bool = False,
    ) -> Delayed | None:
        """Take a state.

        Args:
            state: The state, which has a base.
            now: Wall time, from any beginning, in [s].
            commands: Number of commands for the joints until now.
            is_under_way: Whether one of them has not been answered.
            is_sample: Whether the state reached a sample of a motion.

        Returns:
            The previous state, if it passes.
        """
        before, self.delayed = self.delayed, Delayed(state, is_sample)
        has_news, self._commands = commands != self._commands, commands
        if before is None or len(state.positions) != len(before.state.positions):
            return before
        joints_moved = _differ(state.positions, before.state.positions)
        if is_under_way or (has_news and not joints_moved):
            self._torn_until = now + ANSWER_DELAY
        elif joints_moved:
            self._torn_until = -math.inf
        self.delayed = Delayed(
            state,
            is_sample,
            now <= self._torn_until,
            _differ(state.base_pose, before.state.base_pose),
        )
        is_half = before.is_torn or (before.base_moved and has_news)
        if is_half and now - self._passed < MAX_HOLD and not self._is_whole(before):
            return None
        self._shown, self._passed = before.state.base_pose, now
        return before

    def _is_whole(self, delayed: Delayed) -> bool:
        """Return whether a state is complete whatever the commands are."""
        state, shown = delayed.state, self._shown
        moves = state.velocities is not None and bool(state.velocities.any())
        is_still = shown is not None and not _differ(state.base_pose, shown)
        return delayed.is_sample or moves or is_still


Shown = Tuple[Optional[RobotState], Optional[RobotState]]
"""The states whose joints and whose base go to TF; None: not sent."""


class TfFilter:
    """Decides whether a state's base and joints go to TF.

    TF interpolates neither if both are sent with one stamp. So the joints are sent with
    each base, and alone, if they are due, while the base stands still. The last pose of
    a standing base is sent before it moves: otherwise TF would interpolate its motion
    at the stamps of those joints. Joints are sent less often while none of them moves,
    and the last state before one moves is sent, too. Of a robot without a base, joints
    are sent every ``JOINTS_PERIOD``.
    """

    def __init__(self, throttle: PoseThrottle) -> None:
        self._throttle, self._whole_states = throttle, WholeStates()
        self.reset()

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
            The parts to send of the previous state, or of one without a base.
        """
        if state.base_pose is None:
            self._baseless = state
            is_due = not 0 <= state.stamp - self._joints_stamp < JOINTS_PERIOD
            return self._shown(state, is_due, False)
        self._baseless = None
        found = self._whole_states.next(state, now, commands, is_under_way, is_sample)
        if found is None:
            return None, None
        whole, pose = found.state, found.state.base_pose.tolist()
        is_due = self._is_due(whole, state) and self._throttle.is_near(pose)
        leaves = (is_due or self._is_base_old) and not self._throttle.is_near(
            state.base_pose.tolist()
        )
        with_base = self._throttle.passes(
            1e-9 * whole.stamp, pose, found.is_sample or leaves
        )
        return self._shown(whole, with_base or (is_due and not leaves), with_base)

    def settle(self) -> Shown:
        """Decide on the last state while time stands still.

        Returns:
            The parts of it to send that were not sent yet.
        """
        if self._baseless is not None:
            return self._shown(self._baseless, True, False)
        if self._whole_states.delayed is None:
            return None, None
        state = self._whole_states.delayed.state
        with_base = self._throttle.settles(1e-9 * state.stamp, state.base_pose.tolist())
        return self._shown(state, True, with_base)

    def _shown(self, state: RobotState, joints_due: bool, with_base: bool) -> Shown:
        """Record the parts of a state that are sent; joints are sent once."""
        with_joints = joints_due and state.stamp != self._joints_stamp
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

    def drop(self) -> None:
        """Forget the delayed state: the robot is gone."""
        self._whole_states.reset()
        self._baseless: RobotState | None = None

    def reset(self) -> None:
        """Forget what was sent: time began again, or a listener is new."""
        self._throttle.reset()
        self.drop()
        self._joints_stamp = -STILL_PERIOD
        self._joints = np.zeros(0)
        self._is_base_old = False


def _differ(numbers: np.ndarray, others: np.ndarray) -> bool:
    """Whether positions or poses differ, in number or by a motion."""
    if len(numbers) != len(others):
        return True
    return bool(np.abs(numbers - others).max(initial=0.0) > MIN_MOTION)
