"""The action follow_joint_trajectory, as joint_trajectory_controller has it."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Sequence

import actionlib
import numpy as np
import rospy
from actionlib import ServerGoalHandle
from control_msgs.msg import (
    FollowJointTrajectoryAction,
    FollowJointTrajectoryFeedback,
    FollowJointTrajectoryGoal,
    FollowJointTrajectoryResult,
)

from g1_description.bridge.controllers import Controller
from g1_description.bridge.history import last_positions, motion_text
from g1_description.bridge.player import Claim, MotionPlayer, Played
from g1_description.bridge.status import RobotStatus
from g1_description.errors import G1DescriptionError, MotionError, UnknownNameError
from g1_description.motion.motion import Motion
from g1_description.motion.playlist import (
    Following,
    Outcome,
    Progress,
    remaining,
)
from g1_description.motion.tolerances import (
    JointTolerance,
    Tolerances,
    tolerances_of_goal,
)
from g1_description.robot.state import RobotState
from g1_description.ros.conversions import stamp_from_ns
from g1_description.ros.lifecycle import quiet_when_closing
from g1_description.ros.log import SHORT_PERIOD, ThrottledLog
from g1_description.ros.motion_messages import (
    check_joint_names,
    trajectory_from_message,
)
from g1_description.text import listed

STATUS_PERIOD = 0.2
"""Time between two publications of the goals' status, in [s] of wall time."""


class SteadyActionServer(actionlib.ActionServer):
    """An action server for simulated time that may stop or go back.

    actionlib publishes the status from a timer in simulated time, which wakes up with
    every message on /clock, blocks while time stands still, and dies when it goes back.
    """

    _last_status = 0.0

    def initialize(self) -> None:
        """Advertise and subscribe, without the timer."""
        super().initialize()
        if self.status_timer is not None:
            self.status_timer.shutdown()

    def keep_up(self) -> None:
        """Publish the status if it is due; to be called several times a second."""
        now = time.monotonic()
        if now - self._last_status >= STATUS_PERIOD:
            self._last_status = now
            self.publish_status()

    def reset(self) -> None:
        """Forget times in the future, as time went back."""
        with self.lock:
            self.last_cancel = rospy.Time()
            now = rospy.Time.now()
            for tracker in self.status_list:
                tracker.handle_destruction_time = min(
                    tracker.handle_destruction_time, now
                )


FEEDBACK_PERIOD = 50_000_000
"""Time between two messages of feedback, in [ns] of simulated time."""


class ActiveGoal:
    """The goal being executed."""

    next_feedback = 0
    """When feedback is due, in [ns]."""

    is_seen = False
    """Whether a state arrived since it began."""

    def __init__(
        self, handle: ServerGoalHandle, following: Following, claim: Claim
    ) -> None:
        self.handle, self.following = handle, following
        self.claim = claim
        self._names: Sequence[str] | None = None
        self._columns: list[int] = []

    def actual(self, state: RobotState) -> np.ndarray:
        """Return the positions and velocities of its joints, shape (2, n_joints).

        Raises:
            UnknownNameError: If the state does not have all of them.
        """
        if state.names is not self._names:
            needed = self.following.joint_names
            missing = [name for name in needed if name not in state.names]
            if missing:
                raise UnknownNameError(
                    f"The simulator no longer publishes {listed(missing)}."
                )
            self._columns = [state.names.index(name) for name in needed]
            self._names = state.names
        return np.stack([state.positions, state.velocities])[:, self._columns]

    def publish_feedback(self, stamp: int, progress: Progress) -> None:
        """Publish desired and actual joints, if feedback is due at a time in [ns]."""
        if stamp < self.next_feedback:
            return
        self.next_feedback = stamp + FEEDBACK_PERIOD
        following = self.following
        message = FollowJointTrajectoryFeedback(joint_names=list(following.joint_names))
        message.header.stamp = stamp_from_ns(stamp)
        elapsed = stamp_from_ns(stamp - following.start_ns) - stamp_from_ns(0)
        for point, rows in (
            (message.desired, progress.desired),
            (message.actual, progress.actual),
            (message.error, progress.error),
        ):
            point.positions, point.velocities = rows.tolist()
            point.time_from_start = elapsed
        self.handle.publish_feedback(message)


class OldTrajectoryError(MotionError):
    """All points of a trajectory are in the past."""


def trajectory_of_goal(
    goal: FollowJointTrajectoryGoal, controller: Controller, now_ns: int
) -> Motion:
    """Read the part of a goal's trajectory that is in the future.

    Args:
        goal: The goal, with at least one point.
        controller: The joints that it may move.
        now_ns: The time in [ns].

    Raises:
        UnknownNameError: If it has joints that the controller does not have.
        OldTrajectoryError: If all of it is in the past.
        MotionError: If it is not a valid trajectory.
    """
    message = goal.trajectory
    motion = trajectory_from_message(message, controller.joints)
    start = message.header.stamp.to_nsec()
    if not start and len(motion.times) == 1:
        return motion
    elapsed = (now_ns - start) / 1e9 if start else 0.0
    rest = remaining(motion, elapsed)
    if rest is None:
        late = elapsed - motion.end
        raise OldTrajectoryError(
            f"The last point of the trajectory is {late:.3g} s in the past."
        )
    return rest


def tolerances_in_goal(
    goal: FollowJointTrajectoryGoal, controller: Controller
) -> Tolerances:
    """Read the tolerances of a goal; the controller has the defaults.

    Raises:
        InvalidValueError: If one is NaN.
    """
    path, end = (
        [JointTolerance(one.name, one.position, one.velocity) for one in requested]
        for requested in (goal.path_tolerance, goal.goal_tolerance)
    )
    return tolerances_of_goal(
        goal.trajectory.joint_names,
        controller.constraints,
        path,
        end,
        goal.goal_time_tolerance.to_sec(),
    )


ACTION = "follow_joint_trajectory"

TIME_WENT_BACK = "Simulated time went back; all motions are aborted."

Result = FollowJointTrajectoryResult


class FollowJointTrajectory:
    """Executes goals of follow_joint_trajectory, one at a time.

    actionlib's SimpleActionServer accepts each goal before it is checked. Here, as in
    joint_trajectory_controller, an invalid goal is rejected and the current one
    continues. Goals and cancellations have a thread of their own, because the simulator
    may take long to answer while actionlib holds its lock.
    """

    def __init__(
        self,
        action: str,
        controller: Controller,
        status: RobotStatus,
        player: MotionPlayer,
        log: ThrottledLog,
    ) -> None:
        self._action, self._log = action, log
        self._controller, self._status, self._player = controller, status, player
        joints = status.description.movable_joints
        self._continuous = {
            joint.name for joint in joints if joint.kind == "continuous"
        }
        self._lock = threading.Lock()
        self._active: ActiveGoal | None = None
        self._resets: list[int] = []
        requests: queue.SimpleQueue = queue.SimpleQueue()
        threading.Thread(target=self._handle, args=[requests], daemon=True).start()
        self._server = SteadyActionServer(
            action,
            FollowJointTrajectoryAction,
            lambda handle: requests.put((self._on_goal, handle)),
            lambda handle: requests.put((self._on_cancel, handle)),
            auto_start=False,
        )
        self._server.start()

    @staticmethod
    def _handle(requests: queue.SimpleQueue) -> None:
        """Handle goals and cancellations in their order."""
        while True:
            handler, handle = requests.get()
            try:
                with quiet_when_closing():
                    handler(handle)
            except Exception as error:  # the next goal must not suffer
                rospy.logerr("Internal error while handling a goal: %r", error)

    def on_state(self) -> None:
        """Compare the robot's new state with the goal, if there is one."""
        goal = self._active
        if goal is None:
            return
        goal.is_seen = True
        state, stamp = self._status.state, self._status.stamp
        if goal.claim.is_lost(stamp):
            self._preempt()
            return
        if state is None or stamp < goal.following.start_ns:
            return
        if stamp < goal.next_feedback and not goal.following.decides_at(stamp):
            return
        try:
            progress = goal.following.update(stamp, goal.actual(state))
        except UnknownNameError as error:
            self._abort(str(error))
            return
        if progress.outcome is not Outcome.UNDER_WAY:
            self._end(goal, stamp, progress)
        else:
            goal.publish_feedback(stamp, progress)

    def reset(self, stamp: int) -> None:
        """Abort the goal, as simulated time went back.

        A goal that arrived after the reset, before the first state, stays.

        Args:
            stamp: The new time in [ns].
        """
        self._server.reset()
        with self._lock:
            self._resets.append(stamp)
            goal = self._active
        if goal is not None and (goal.is_seen or goal.following.start_ns > stamp):
            self._abort(TIME_WENT_BACK)

    def keep_up(self, is_connected: bool) -> None:
        """Publish the status; abort the goal if there is no simulator.

        To be called several times a second.
        """
        if not is_connected:
            self._abort("The simulator is gone.")
        self._server.keep_up()

    def _on_goal(self, handle: ServerGoalHandle) -> None:
        """Replace the current goal by a new one, or reject that."""
        goal = handle.get_goal()
        content, positions = (
            motion_text(goal.trajectory),
            last_positions(goal.trajectory),
        )
        self._status.record(handle.goal, self._action, content, positions)
        try:
            if not goal.trajectory.points:
                self._stop(handle, goal.trajectory.joint_names)
                return
            now = rospy.Time.now().to_nsec() or self._status.stamp
            motion = trajectory_of_goal(goal, self._controller, now)
            tolerances = tolerances_in_goal(goal, self._controller)
        except UnknownNameError as error:
            _reject(handle, Result.INVALID_JOINTS, str(error))
        except OldTrajectoryError as error:
            _reject(handle, Result.OLD_HEADER_TIMESTAMP, str(error))
        except G1DescriptionError as error:
            _reject(handle, Result.INVALID_GOAL, str(error))
        else:
            start = goal.trajectory.header.stamp.to_nsec() or None
            self._start(handle, motion, start, tolerances)

    def _on_cancel(self, handle: ServerGoalHandle) -> None:
        """Stop the joints, if the goal is the current one and still moves them."""
        goal = self._active
        if goal is None or goal.handle != handle:
            return
        if goal.claim.is_lost(self._status.stamp):
            self._preempt()
        elif self._take(goal):
            self._warn(self._player.stop(self._controller.joints))
            why = "The goal was cancelled."
            goal.handle.set_canceled(Result(error_string=why), why)

    def _stop(self, handle: ServerGoalHandle, names: Sequence[str]) -> None:
        """Stop joints where they are; without names all of the controller."""
        if names:
            check_joint_names(names, self._controller.joints)
        played = self._player.stop(names or self._controller.joints)
        if not played.success:
            _refuse(handle, played)
            return
        self._preempt()
        handle.set_accepted()
        handle.set_succeeded(Result())

    def _start(
        self,
        handle: ServerGoalHandle,
        motion: Motion,
        start: int | None,
        tolerances: Tolerances,
    ) -> None:
        """Play a motion; ``start`` in [ns], None: now."""
        n_resets = len(self._resets)
        played = self._player.play(motion, start)
        if not played.success:
            _refuse(handle, played)
            return
        self._warn(played)
        continuous = [name in self._continuous for name in motion.joint_names]
        following = Following(motion, played.start_ns, tolerances, np.array(continuous))
        self._preempt()
        handle.set_accepted()
        with self._lock:
            self._active = ActiveGoal(handle, following, played.claim)
            resets = self._resets[n_resets:]
            is_old = any(played.start_ns > stamp for stamp in resets)
        if is_old:
            self._abort(TIME_WENT_BACK)

    def _preempt(self) -> None:
        """Cancel the current goal, as another motion replaces it."""
        goal = self._active
        if goal is not None and self._take(goal):
            why = "Replaced by another motion."
            goal.handle.set_canceled(Result(error_string=why), why)

    def _abort(self, message: str) -> None:
        """Abort the current goal, if there is one."""
        goal = self._active
        if goal is not None and self._take(goal):
            goal.handle.set_aborted(Result(Result.INVALID_GOAL, message), message)

    def _end(self, goal: ActiveGoal, stamp: int, progress: Progress) -> None:
        """End a goal that is reached, or that violates a tolerance."""
        if not self._take(goal):
            return
        if progress.outcome is Outcome.REACHED:
            goal.handle.set_succeeded(Result())
            return
        is_path = progress.outcome is Outcome.OFF_PATH
        code = (
            Result.PATH_TOLERANCE_VIOLATED
            if is_path
            else Result.GOAL_TOLERANCE_VIOLATED
        )
        elapsed = (stamp - goal.following.start_ns) / 1e9
        message = f"{elapsed:.3f} s after the start {progress.message}."
        goal.handle.set_aborted(Result(code, message), message)

    def _warn(self, played: Played) -> None:
        """Log the simulator's remarks."""
        if played.message:
            text = f"{self._action}: {played.message}."
            self._log.warn(self._action, text, SHORT_PERIOD)

    def _take(self, goal: ActiveGoal) -> bool:
        """Claim the end of a goal; False if another thread has done so."""
        with self._lock:
            is_current = self._active is goal
            if is_current:
                self._active = None
        return is_current


def _reject(handle: ServerGoalHandle, code: int, message: str) -> None:
    handle.set_rejected(Result(code, message), message)


def _refuse(handle: ServerGoalHandle, played: Played) -> None:
    message = f"The simulator refused the motion: {played.message}."
    _reject(handle, Result.INVALID_GOAL, message)
