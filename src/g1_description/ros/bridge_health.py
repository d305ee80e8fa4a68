"""How the bridge fares: /diagnostics, and what no message would tell."""

from __future__ import annotations

import contextlib
import threading
import time
from typing import TYPE_CHECKING

import rosgraph
import rospy
from diagnostic_msgs.msg import DiagnosticStatus
from diagnostic_updater import Updater

from ..core.commands import listed
from .bridge_robot import START, BridgedRobot
from .complaints import Complaints
from .own_node import FAILURES
from .registration import keep_in_touch
from .shutdown import quiet_when_closing

if TYPE_CHECKING:
    from .bridge_node import BridgeNode

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR

PERIOD = 1.0
"""Time between two diagnostics in [s] of wall time."""

ASK = 0.5
"""Time between two questions to the master in [s] of wall time."""

STALE = 1.0
"""Link states older than this are told, in [s] of wall time."""

HANGING = 2.0
"""A command that waits longer than this for the simulator is told, in [s]."""

RECENT = 10.0
"""What was clamped or ignored of a command is told for this long, in [s]."""

NAMELESS, OTHERS = "(no name)", "(other names)"
"""In place of names that cannot be given."""


class BridgeHealth:
    """Two threads beside the callbacks: one tells, one asks the master.

    They go by wall time, as simulated time may stand still, and the master may take
    long to answer or be gone.
    """

    def __init__(self, bridge: BridgeNode, complaints: Complaints) -> None:
        """Prepare the diagnostics.

        Args:
            bridge: The node.
            complaints: Where to tell what is wrong.
        """
        self._bridge = bridge
        self._complaints = complaints
        self._stopped = threading.Event()
        self._began = time.monotonic()
        self._passed_over = 0
        self._updater = Updater()
        self._updater.setHardwareID("none")
        self._updater.add("link states", self._tell_link_states)
        self._updater.add("commands", self._tell_commands)
        for robot in bridge.robots:
            self._updater.add(f"{robot.name} joints", self._joints_of(robot))

    def start(self) -> None:
        """Begin, until the node is shut down."""
        rospy.on_shutdown(self._stopped.set)
        for target in (self._tell_forever, self._ask_forever):
            threading.Thread(target=target, daemon=True).start()

    def _tell_forever(self) -> None:
        """Tell how the bridge fares, once per period."""
        while not self._stopped.wait(PERIOD):
            self._tell_of_silence()
            with quiet_when_closing():
                self._bridge.take_kept()
                for robot in self._bridge.robots:
                    robot.joint_states.flush()
                self._updater.force_update()

    @property
    def _age(self) -> float | None:
        """How old the last good link states are in [s]; None before the first."""
        came = self._bridge.last_came
        return None if came is None else time.monotonic() - came

    def _tell_of_silence(self) -> None:
        """Say that link states stay away, or that a command does."""
        topic, waiting = self._bridge.topic, self._bridge.sender.waiting
        age = self._age
        passed_over = self._bridge.passed_over - self._passed_over
        if passed_over:
            self._passed_over += passed_over
            told = f"{passed_over} messages on {topic} were passed over for newer ones."
            self._complaints.tell("behind", told)
        if age is None and time.monotonic() - self._began > START:
            told = f"Nothing usable has come on {topic} yet."
            if self._bridge.timeless:
                told = f"Nothing is published: {topic} comes, but no time on /clock."
            self._complaints.tell("silence", told)
        if age is not None and age > STALE:
            self._complaints.tell(
                "silence",
                f"Nothing usable on {topic} for {age:.0f} s: {self._why()}.",
            )
        if waiting > HANGING:
            self._complaints.tell(
                "hanging",
                f"A command waits for the simulator's answer since {waiting:.0f} s.",
            )

    def _why(self) -> str:
        """Guess why link states stay away."""
        if self._bridge.subscriber.get_num_connections():
            return "the simulator is silent, perhaps paused"
        return "there is no simulator"

    def _tell_link_states(self, status):
        """Report whether link states come."""
        age = self._age
        status.add("malformed messages", self._bridge.malformed)
        status.add("messages passed over for newer ones", self._bridge.passed_over)
        if age is None:
            status.summary(WARN, f"nothing usable on {self._bridge.topic}")
            return status
        status.add("age in s", f"{age:.3f}")
        if age > STALE:
            told = f"nothing on {self._bridge.topic} for {age:.0f} s: {self._why()}"
            status.summary(WARN, told)
        else:
            status.summary(OK, "link states come")
        return status

    def _tell_commands(self, status):
        """Report what became of the commands."""
        counts = self._bridge.sender.counts
        waiting = self._bridge.sender.waiting
        status.add("sent", sum(count.sent for count in counts.values()))
        status.add("refused", sum(count.refused for count in counts.values()))
        recent = time.monotonic() - RECENT
        tallies = [robot.tally for robot in self._bridge.robots]
        status.summary(OK, "commands are obeyed")
        if not all(tally.is_empty for tally in tallies):
            told = f"nothing was clamped or ignored in the last {RECENT:g} s"
            status.summary(OK, told)
        refused = [name for name, count in counts.items() if count.reason]
        if refused:
            reason = counts[refused[0]].reason
            status.summary(WARN, f"{listed(refused)} was refused: {reason}")
        for robot in self._bridge.robots:
            if robot.ignored and robot.ignored[0] > recent:
                why = robot.ignored[1]
                status.mergeSummary(WARN, f"ignored in one to {robot.name}: {why}")
            clamped = robot.tally.clamped_since(recent)
            if clamped:
                told = f"clamped to the limits of {robot.name}: {listed(clamped)}"
                status.mergeSummary(WARN, told)
            self._add_counts(status, robot)
        if waiting > HANGING:
            status.summary(ERROR, f"the simulator has not answered for {waiting:.0f} s")
        return status

    def _add_counts(self, status, robot: BridgedRobot) -> None:
        """Report how many positions were clamped and ignored, by joint."""
        scope = f"{robot.name}::" if len(self._bridge.robots) > 1 else ""
        tally = robot.tally
        for what, counts in (("clamped", tally.clamped), ("ignored", tally.ignored)):
            # A copy: commands come meanwhile.
            for name, count in counts.copy().items():
                status.add(f"{what} {scope}{name or NAMELESS}", count)
        if tally.other_ignored:
            status.add(f"ignored {scope}{OTHERS}", tally.other_ignored)

    def _joints_of(self, robot: BridgedRobot):
        """Make what reports on one robot's joints."""

        def tell(status):
            share = robot.share
            if share is None or self._age is None or self._age > STALE:
                status.summary(WARN, "no link states come")
                return status
            if not share.is_there:
                status.summary(ERROR, f"the simulator has no link of {robot.name}")
                return status
            status.summary(OK, f"{len(share.joints.names)} joints are measured")
            if robot.other_publishers:
                others = listed(robot.other_publishers)
                status.mergeSummary(WARN, f"joint_states also come from {others}")
            if robot.off_axis:
                status.mergeSummary(WARN, f"off their axes: {listed(robot.off_axis)}")
            missing = dict.fromkeys(share.joints.missing + share.broken)
            if missing:
                missing = listed(missing)
                status.mergeSummary(ERROR, f"links are missing: {missing}")
            return status

        return tell

    def _ask_forever(self) -> None:
        """Be known to the master, and ask it who else publishes."""
        while not self._stopped.wait(ASK):
            # The master is gone or has just come: the next time is as good.
            with contextlib.suppress(*FAILURES, rosgraph.MasterException):
                state = rosgraph.Master(rospy.get_name()).getSystemState()
                if rospy.core.is_shutdown_requested():
                    return
                if keep_in_touch(state):
                    rospy.loginfo("The master did not know this node; it does now.")
                self._find_other_publishers(dict(state[0]))

    def _find_other_publishers(self, publishers: dict[str, list[str]]) -> None:
        """Find other nodes that publish the robots' joint states."""
        own = rospy.get_name()
        for robot in self._bridge.robots:
            topic = robot.joint_states.name
            others = [node for node in publishers.get(topic, ()) if node != own]
            robot.other_publishers = others
            if others:
                self._complaints.tell(
                    f"publishers {robot.name}",
                    f"{listed(others)} also publishes {topic}: both reach its readers.",
                )
