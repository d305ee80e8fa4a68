"""The bridge's /diagnostics, and warnings when states or answers stay away."""

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

from g1_description.bridge.state_source import StateSource
from g1_description.bridge.status import SPAWN_GRACE, RobotStatus
from g1_description.ros.lifecycle import quiet_when_closing
from g1_description.ros.log import ThrottledLog
from g1_description.ros.master import SERVICE_ERRORS
from g1_description.text import listed

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR

PERIOD = 1.0
"""Time between two messages on /diagnostics in [s] of wall time."""

PAUSE_PERIOD = 0.4
"""A simulator that is silent for this long is asked whether it is paused, and asked
again after this time, in [s] of wall time."""

MAX_AGE = 1.0
"""Oldest link states in [s] of wall time that are no reason for a warning."""

MAX_ANSWER_TIME = 2.0
"""Longest time in [s] that the simulator may take for an answer without a warning."""

RECENT = 10.0
"""Time in [s] for which a clamped or ignored command stays a warning."""

NAMELESS = "(no name)"
"""In place of names that are empty."""


class BridgeHealth:
    """Reads the state of the bridge and reports it, from two threads.

    They use wall time, as simulated time may stand still.
    """

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
        """What the simulator last answered; False while states come."""
        self._was_asked = False
        """Whether it was asked since the last state."""
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
        """Find out whether the simulator is paused, when it is silent."""
        while not self._stopped.wait(PAUSE_PERIOD):
            age = self._source.age
            is_silent, paused = age is None or age >= PAUSE_PERIOD, False
            if is_silent:  # its answer may take any time
                with contextlib.suppress(*SERVICE_ERRORS):
                    paused = self._physics().pause
            self._is_paused, self._was_asked = paused, is_silent

    @property
    def _is_stale(self) -> bool:
        """Whether states stay away though the simulator is not paused."""
        age = self._source.age
        return age is None or (age > MAX_AGE and not self._is_paused)

    def _warn_of_silence(self) -> None:
        """Warn that link states, or the answer to a command, stay away."""
        source, age = self._source, self._source.age
        is_early = time.monotonic() - self._start <= SPAWN_GRACE
        if age is None and not is_early and not self._is_paused:
            text = f"Nothing usable has arrived on {source.topic} yet."
            if source.timeless:
                text = f"Nothing is published: {source.topic} has no time on /clock."
            self._log.warn("silence", text)
        is_known = self._was_asked or (age or 0.0) > MAX_ANSWER_TIME
        if age is not None and self._is_stale and is_known:
            text = f"Nothing usable on {source.topic} for {age:.0f} s"
            self._log.warn("silence", f"{text}: {self._reason}.")
        waiting = max(robot.commands.waiting for robot in self._robots)
        if waiting > MAX_ANSWER_TIME:
            text = "A command still waits for the simulator's answer after"
            self._log.warn("hanging", f"{text} {waiting:.0f} s.")

    @property
    def _reason(self) -> str:
        """Why states stay away, as far as it is known."""
        if self._source.is_connected:
            return "the simulator is silent"
        return "there is no simulator"

    def _report_link_states(self, status):
        """Report whether states arrive."""
        source, age = self._source, self._source.age
        status.add("malformed messages", source.malformed)
        status.add("messages passed over for newer ones", source.skipped)
        if age is not None:
            status.add("age in s", f"{age:.3f}")
        elif not self._is_paused:
            status.summary(WARN, f"nothing usable on {source.topic}")
            return status
        if self._is_stale:
            text = f"nothing on {source.topic} for {age:.0f} s: {self._reason}"
            status.summary(WARN, text)
        elif self._is_paused:
            status.summary(OK, "paused")
        else:
            status.summary(OK, "link states come")
        return status

    def _report_commands(self, status):
        """Report what became of the commands."""
        tallies = [robot.commands for robot in self._robots]
        status.add("sent", sum(tally.sent for tally in tallies))
        status.add("refused", sum(tally.refused for tally in tallies))
        status.summary(OK, "commands are obeyed")
        if not all(tally.is_empty for tally in tallies):
            text = f"nothing was clamped or ignored in the last {RECENT:g} s"
            status.summary(OK, text)
        refused = [robot for robot in self._robots if robot.commands.reason]
        if refused:
            names = listed(robot.name for robot in refused)
            reason = refused[0].commands.reason
            status.summary(WARN, f"{names} was refused: {reason}")
        for robot in self._robots:
            _report_recent(status, robot)
            scope = f"{robot.name}::" if len(self._robots) > 1 else ""
            _add_counts(status, robot, scope)
        waiting = max(tally.waiting for tally in tallies)
        if waiting > MAX_ANSWER_TIME:
            status.summary(ERROR, f"the simulator has not answered for {waiting:.0f} s")
        return status

    def _report_joints(self, robot: RobotStatus, status):
        """Report on one robot's joints."""
        state, problems = robot.state, robot.problems
        status.add("listeners to tf_joint_states", robot.tf_listeners)
        if state is None or problems is None or self._is_stale:
            status.summary(WARN, "no link states come")
            return status
        if not problems.is_present:
            reason = f"the simulator has no link of {robot.name}"
            if robot.vanishes:
                reason = f"nothing is left of {robot.name} without links of no mass"
            status.summary(ERROR, reason)
            return status
        status.summary(OK, f"{len(state.names)} joints are measured")
        if robot.other_publishers:
            others = listed(robot.other_publishers)
            status.mergeSummary(WARN, f"joint_states also come from {others}")
        if problems.axis_residual:
            off_axis = listed(problems.axis_residual)
            status.mergeSummary(WARN, f"off their axes: {off_axis}")
        missing = listed(problems.missing + problems.invalid)
        if missing:
            status.mergeSummary(ERROR, f"links are missing: {missing}")
        return status


def _report_recent(status, robot: RobotStatus) -> None:
    """Warn of commands that were clamped or ignored lately."""
    recent = time.monotonic() - RECENT
    ignored = robot.commands.last_ignored
    if ignored and ignored[0] > recent:
        text = f"ignored in one to {robot.name}: {ignored[1]}"
        status.mergeSummary(WARN, text)
    clamped = robot.commands.clamped_since(recent)
    if clamped:
        text = f"clamped to the limits of {robot.name}: {listed(clamped)}"
        status.mergeSummary(WARN, text)


def _add_counts(status, robot: RobotStatus, scope: str) -> None:
    """Report what became of motions, and of positions by joint."""
    # Copies: other threads count commands meanwhile.
    for what, count in robot.motions.copy().items():
        status.add(f"{scope}{what}", count)
    tally = robot.commands
    for what, counts in (("clamped", tally.clamped), ("ignored", tally.ignored)):
        for name, count in counts.copy().items():
            status.add(f"{what} {scope}{name or NAMELESS}", count)
