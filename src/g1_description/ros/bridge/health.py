"""How the bridge fares: /diagnostics, and what no message would tell."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Sequence

import rosgraph
import rospy
from diagnostic_msgs.msg import DiagnosticStatus
from diagnostic_updater import Updater
from gazebo_msgs.srv import GetPhysicsProperties

from g1_description.core.bridge.commands import listed
from g1_description.ros.node.complaints import Complaints
from g1_description.ros.node.own_node import FAILURES
from g1_description.ros.node.registration import keep_in_touch
from g1_description.ros.node.shutdown import quiet_when_closing

from .robot import START, BridgedRobot
from .sender import FAILURES as SERVICE_FAILURES
from .sender import CommandSender
from .state_source import StateSource

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR

PERIOD = 1.0
"""Time between two diagnostics in [s] of wall time."""

ASK = 0.5
"""Time between two questions to the master in [s] of wall time."""

ASK_PAUSED = 0.4
"""A simulator that is silent for so long is asked whether it is paused, and so often,
in [s] of wall time."""

STALE = 1.0
"""Link states older than this are told, in [s] of wall time."""

HANGING = 2.0
"""A command that waits longer than this for the simulator is told, in [s]."""

RECENT = 10.0
"""What was clamped or ignored of a command is told for this long, in [s]."""

NAMELESS, OTHERS = "(no name)", "(other names)"
"""In place of names that cannot be given."""


class PauseWatch:
    """Whether a simulator that is silent was paused; it alone knows."""

    def __init__(self, gazebo: str) -> None:
        """Begin without knowing.

        Args:
            gazebo: Namespace of the simulator.
        """
        self._get = rospy.ServiceProxy(
            f"{gazebo}/get_physics_properties", GetPhysicsProperties
        )
        self._asked: float | None = None
        self.is_paused = False
        """Whether it said so when it was asked last."""

    def ask(self) -> None:
        """Ask the simulator; it may take as long as it likes."""
        paused = False
        with contextlib.suppress(*SERVICE_FAILURES):
            paused = self._get().pause
        self.is_paused, self._asked = paused, time.monotonic()

    def forget(self) -> None:
        """Take it that time runs: states come."""
        self.is_paused, self._asked = False, None

    def is_known(self, age: float) -> bool:
        """Tell whether it was asked since states stay away, or does not answer.

        Args:
            age: How long they have stayed away in [s].
        """
        return self._asked is not None or age > HANGING


class BridgeHealth:
    """Two threads beside the callbacks: one tells, one asks the master.

    They go by wall time, as simulated time may stand still, and the master may take
    long to answer or be gone.
    """

    def __init__(
        self,
        gazebo: str,
        source: StateSource,
        sender: CommandSender,
        robots: Sequence[BridgedRobot],
        complaints: Complaints,
    ) -> None:
        """Prepare the diagnostics.

        Args:
            gazebo: Namespace of the simulator.
            source: Where states come from.
            sender: Where commands go.
            robots: What the bridge knows of each robot.
            complaints: Where to tell what is wrong.
        """
        self._source = source
        self._sender = sender
        self._robots = robots
        self._complaints = complaints
        self._stopped = threading.Event()
        self._began = time.monotonic()
        self._pause = PauseWatch(gazebo)
        self._updater = Updater()
        self._updater.setHardwareID("none")
        self._updater.add("link states", self._tell_link_states)
        self._updater.add("commands", self._tell_commands)
        for robot in robots:
            self._updater.add(f"{robot.name} joints", self._joints_of(robot))

    def start(self) -> None:
        """Begin, until the node is shut down."""
        rospy.on_shutdown(self._stopped.set)
        for target in (self._tell_forever, self._ask_forever, self._watch_forever):
            threading.Thread(target=target, daemon=True).start()

    def _tell_forever(self) -> None:
        """Tell how the bridge fares, once per period."""
        while not self._stopped.wait(PERIOD):
            self._tell_of_silence()
            with quiet_when_closing():
                self._updater.force_update()

    def _watch_forever(self) -> None:
        """Find out whether the simulator is paused, when it is silent."""
        while not self._stopped.wait(ASK_PAUSED):
            age = self._source.age
            if age is not None and age < ASK_PAUSED:
                self._pause.forget()
            else:
                self._pause.ask()

    @property
    def _is_stale(self) -> bool:
        """Whether states stay away, and nobody asked for that."""
        age = self._source.age
        return age is None or (age > STALE and not self._pause.is_paused)

    def _tell_of_silence(self) -> None:
        """Say that link states stay away, or that a command does."""
        source, waiting = self._source, self._sender.waiting
        age = source.age
        is_early = time.monotonic() - self._began <= START
        if age is None and not is_early and not self._pause.is_paused:
            told = f"Nothing usable has come on {source.topic} yet."
            if source.timeless:
                told = (
                    f"Nothing is published: {source.topic} comes, but no time on "
                    "/clock."
                )
            self._complaints.tell("silence", told)
        if age is not None and self._is_stale and self._pause.is_known(age):
            self._complaints.tell(
                "silence",
                f"Nothing usable on {source.topic} for {age:.0f} s: {self._why()}.",
            )
        if waiting > HANGING:
            self._complaints.tell(
                "hanging",
                f"A command waits for the simulator's answer since {waiting:.0f} s.",
            )

    def _why(self) -> str:
        """Tell what is known of why states stay away."""
        if self._source.is_connected:
            return "the simulator is silent"
        return "there is no simulator"

    def _tell_link_states(self, status):
        """Report whether states come."""
        source = self._source
        age = source.age
        status.add("malformed messages", source.malformed)
        status.add("messages passed over for newer ones", source.passed_over)
        if age is not None:
            status.add("age in s", f"{age:.3f}")
        elif not self._pause.is_paused:
            status.summary(WARN, f"nothing usable on {source.topic}")
            return status
        if self._is_stale:
            told = f"nothing on {source.topic} for {age:.0f} s: {self._why()}"
            status.summary(WARN, told)
        elif self._pause.is_paused:
            status.summary(OK, "paused")
        else:
            status.summary(OK, "link states come")
        return status

    def _tell_commands(self, status):
        """Report what became of the commands."""
        counts = self._sender.counts
        waiting = self._sender.waiting
        status.add("sent", sum(count.sent for count in counts.values()))
        status.add("refused", sum(count.refused for count in counts.values()))
        recent = time.monotonic() - RECENT
        tallies = [robot.tally for robot in self._robots]
        status.summary(OK, "commands are obeyed")
        if not all(tally.is_empty for tally in tallies):
            told = f"nothing was clamped or ignored in the last {RECENT:g} s"
            status.summary(OK, told)
        refused = [name for name, count in counts.items() if count.reason]
        if refused:
            reason = counts[refused[0]].reason
            status.summary(WARN, f"{listed(refused)} was refused: {reason}")
        for robot in self._robots:
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
        scope = f"{robot.name}::" if len(self._robots) > 1 else ""
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
            if share is None or self._is_stale:
                status.summary(WARN, "no link states come")
                return status
            if not share.is_there:
                why = f"the simulator has no link of {robot.name}"
                if robot.vanishes:
                    why = f"nothing is left of {robot.name} without links of no mass"
                status.summary(ERROR, why)
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
        """Find other nodes that publish the robots' joint states; tell of new ones."""
        own = rospy.get_name()
        for robot in self._robots:
            topic = robot.joint_states.name
            others = [node for node in publishers.get(topic, ()) if node != own]
            known, robot.other_publishers = robot.other_publishers, others
            for node in others:
                if node in known:
                    continue
                clock = "/clock and " if node in publishers.get("/clock", ()) else ""
                self._complaints.tell(
                    f"publisher {node} {topic}",
                    f"{node} also publishes {clock}{topic}: readers get both. To look "
                    "at a bag, end this launch and use "
                    "roslaunch g1_description view.launch.",
                )
