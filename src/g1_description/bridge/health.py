"""The bridge's /diagnostics, and warnings when states or answers do not arrive."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Sequence
from functools import partial

import rospy
from diagnostic_msgs.msg import DiagnosticStatus
from diagnostic_updater import Updater
from gazebo_msgs.srv import GetPhysicsProperties

from g1_description.bridge.estimator import LASTING
from g1_description.bridge.state_source import StateSource
from g1_description.bridge.status import SPAWN_GRACE, RobotStatus
from g1_description.ros.lifecycle import quiet_when_closing
from g1_description.ros.log import ThrottledLog
from g1_description.ros.waiting import SERVICE_ERRORS
from g1_description.text import listed

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR

PERIOD = 1.0
"""Time between two messages on /diagnostics in [s] of wall time."""

PAUSE_PERIOD = 0.4
"""A simulator that is silent for this long is asked whether it is paused, and asked
again after this time, in [s] of wall time."""

MAX_AGE = 1.0
"""Age of link states in [s] of wall time above which a warning is logged."""

MAX_ANSWER_TIME = 2.0
"""Time in [s] without an answer of the simulator after which a warning is logged."""

RECENT = 10.0
"""Time in [s] for which a clamped or ignored command stays a warning."""

NAMELESS = "(no name)"
"""Shown instead of an empty name."""


class BridgeHealth:
    """Reports the state of the bridge, from two threads, in wall time."""

    def __init__(
        self,
        gazebo: str,
        source: StateSource,
        robots: Sequence[RobotStatus],
        log: ThrottledLog,
    ) -> None:
        self._source, self._robots, self._log = source, robots, log
        self._stopped = threading.Event()
        self._start = time.monotonic()
        self._physics = rospy.ServiceProxy(
            f"{gazebo}/get_physics_properties", GetPhysicsProperties
        )
        self._is_paused = False
        """The simulator's last answer; False while states arrive."""
        self._was_queried = False
        """Whether it was queried since the last state."""
        self._updater = Updater()
        self._updater.setHardwareID("none")
        self._updater.add("link states", self._report_link_states)
        self._updater.add("commands", self._report_commands)
        for robot in robots:
            self._updater.add(
                f"{robot.name} joints", partial(self._report_joints, robot)
            )

    def start(self) -> None:
        """Begin, until the node is shut down."""
        rospy.on_shutdown(self._stopped.set)
        for target in (self._report_forever, self._watch_pause):
            threading.Thread(target=target, daemon=True).start()

    def _report_forever(self) -> None:
        """Publish the diagnostics, once per period."""
        while not self._stopped.wait(PERIOD):
            self._warn_of_silence()
            with quiet_when_closing():
                self._updater.force_update()

    def _watch_pause(self) -> None:
        """Ask a silent simulator whether it is paused."""
        while not self._stopped.wait(PAUSE_PERIOD):
            age = self._source.age
            is_silent, paused = age is None or age >= PAUSE_PERIOD, False
            if is_silent:  # its answer may take any time
                with contextlib.suppress(*SERVICE_ERRORS):
                    paused = self._physics().pause
            self._is_paused, self._was_queried = paused, is_silent

    def _is_silent(self, age: float) -> bool:
        """Whether states of this age are late although the simulator is not paused."""
        return age > MAX_AGE and not self._is_paused

    def _warn_of_silence(self) -> None:
        """Warn that link states, or the answer to a command, do not arrive."""
        source, age = self._source, self._source.age
        is_early = time.monotonic() - self._start <= SPAWN_GRACE
        if age is None and not is_early and not self._is_paused:
            text = f"No valid message on {source.topic} yet; is a simulator running?"
            if source.timeless:
                text = "Waiting for /clock; nothing is published until then."
            self._log.warn("silence", text)
        is_known = self._was_queried or (age or 0.0) > MAX_ANSWER_TIME
        if age is not None and self._is_silent(age) and is_known:
            text = f"No valid message on {source.topic} for {age:.0f} s"
            self._log.warn("silence", f"{text}: {self._reason}.")
        waiting = max(robot.commands.waiting for robot in self._robots)
        if waiting > MAX_ANSWER_TIME:
            text = f"The simulator has not answered a command for {waiting:.0f} s."
            self._log.warn("hanging", text)

    @property
    def _reason(self) -> str:
        """Why no states arrive."""
        is_silent = self._source.is_connected
        return "the simulator is silent" if is_silent else "there is no simulator"

    def _report_link_states(self, status):
        """Report whether states arrive."""
        source, age = self._source, self._source.age
        status.add("malformed messages", source.malformed)
        status.add("messages skipped for newer ones", source.skipped)
        if age is not None:
            status.add("age in s", f"{age:.3f}")
        if age is not None and self._is_silent(age):
            text = f"no message on {source.topic} for {age:.0f} s: {self._reason}"
            status.summary(WARN, text)
        elif age is None and not self._is_paused:
            status.summary(WARN, f"no valid message on {source.topic}")
        elif self._is_paused:
            status.summary(OK, "paused")
        else:
            status.summary(OK, "link states arrive")
        return status

    def _report_commands(self, status):
        """Report sent, refused, clamped and ignored commands."""
        tallies = [robot.commands for robot in self._robots]
        status.add("sent", sum(tally.sent for tally in tallies))
        status.add("refused", sum(tally.refused for tally in tallies))
        status.summary(OK, "commands are applied")
        if not all(tally.is_empty for tally in tallies):
            text = f"nothing was clamped or ignored in the last {RECENT:g} s"
            status.summary(OK, text)
        refused = [robot for robot in self._robots if robot.commands.reason]
        if refused:
            names = listed(robot.name for robot in refused)
            reason = refused[0].commands.reason
            status.summary(WARN, f"command to {names} refused: {reason}")
        for robot in self._robots:
            scope = f"{robot.name}::" if len(self._robots) > 1 else ""
            _report_robot(status, robot, scope)
        waiting = max(tally.waiting for tally in tallies)
        if waiting > MAX_ANSWER_TIME:
            status.summary(ERROR, f"the simulator has not answered for {waiting:.0f} s")
        return status

    def _report_joints(self, robot: RobotStatus, status):
        """Report on one robot's joints."""
        state, problems = robot.state, robot.problems
        status.add("listeners to tf_joint_states", robot.tf_listeners)
        age = self._source.age
        if state is None or problems is None or age is None or self._is_silent(age):
            status.summary(WARN, "no link states arrive")
            return status
        if not problems.is_present:
            reason = f"the simulator has no link of {robot.name}"
            if robot.vanishes:
                reason = (
                    f"the simulator dropped every link of {robot.name}: none has mass"
                )
            status.summary(ERROR, reason)
            return status
        status.summary(OK, f"{len(state.names)} joints are published")
        if robot.other_publishers:
            others = listed(robot.other_publishers)
            status.mergeSummary(WARN, f"joint_states are also published by {others}")
        if problems.axis_residual:
            off_axis = listed(problems.axis_residual)
            status.mergeSummary(
                WARN, f"joints off their axes for {LASTING:g} s: {off_axis}"
            )
        missing = listed(problems.missing + problems.invalid)
        if missing:
            status.mergeSummary(ERROR, f"missing links: {missing}")
        return status


def _report_robot(status, robot: RobotStatus, scope: str) -> None:
    """Warn of recently clamped or ignored commands, and report their counts."""
    recent = time.monotonic() - RECENT
    ignored = robot.commands.last_ignored
    if ignored and ignored[0] > recent:
        text = f"ignored in a command to {robot.name}: {ignored[1]}"
        status.mergeSummary(WARN, text)
    clamped = robot.commands.clamped_since(recent)
    if clamped:
        text = f"clamped to the limits of {robot.name}: {listed(clamped)}"
        status.mergeSummary(WARN, text)
    # Copies: other threads count commands meanwhile.
    for event, count in robot.motions.copy().items():
        status.add(f"{scope}{event}", count)
    tally = robot.commands
    for outcome, counts in (("clamped", tally.clamped), ("ignored", tally.ignored)):
        for name, count in counts.copy().items():
            status.add(f"{outcome} {scope}{name or NAMELESS}", count)
