"""The node ``checker``: checks configurations, motions and the current state.

Services: ~check_state (g1_description/CheckState), ~check_trajectory
    (g1_description/CheckTrajectory), ~solve_ik (g1_description/SolveIK),
    ~why (std_srvs/Trigger)
Subscribes, with a ~rate: robot_state (g1_description/RobotState); without a publisher
    of that, joint_states (sensor_msgs/JointState), /tf, /tf_static (tf2_msgs/TFMessage)
Subscribes, below the simulator's name: scene, object_states; see objects.py
Publishes, with a ~rate: /diagnostics (diagnostic_msgs/DiagnosticArray), ~markers
    (visualization_msgs/MarkerArray)
Parameters: those of parameters.CheckerParameters
"""

from __future__ import annotations

import sys
import threading
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import rospy
from diagnostic_msgs.msg import DiagnosticStatus
from diagnostic_updater import Updater

from g1_description.checker.forces import LiveForces
from g1_description.checker.markers import LiveMarkers
from g1_description.checker.objects import CheckedObjects, CheckerAmongObjects
from g1_description.checker.parameters import (
    CheckerParameters,
    base_frame,
    wait_for_robot,
)
from g1_description.checker.services import CheckServices, IkService
from g1_description.checks.checker import Checker, LiveCheck
from g1_description.checks.measured import NO_BASE
from g1_description.checks.verdict import FAILED, WARNING, Finding, Verdict
from g1_description.collisions.find_pairs import collisions_of
from g1_description.collisions.self_collisions import SelfCollisions
from g1_description.errors import G1DescriptionError
from g1_description.robot.description import Description
from g1_description.robot.state import RobotState
from g1_description.ros.lifecycle import quiet_when_closing, start_node
from g1_description.ros.log import ThrottledLog
from g1_description.ros.map_frame import MapFrame
from g1_description.ros.parameters import read_parameters
from g1_description.ros.robot_states import RobotStates
from g1_description.ros.rospy_tcp import serve_as_roscpp
from g1_description.text import listed

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
LEVELS = {FAILED: ERROR, WARNING: WARN}

MAX_AGE = 2.0
"""Age of the last state in [s] of wall time above which its findings are outdated."""

SHOWN_IF_SKIPPED = ("self_collision", "penetration", "center_of_mass")
"""Checks that are reported if they are skipped."""

MAX_TEXTS = 3
"""Largest number of findings in the summary; the values list all."""


class CheckHealth:
    """Collects the findings between two reports and publishes them."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._found: dict[tuple[str, tuple[str, ...]], Finding] = {}
        self._verdict: Verdict | None = None
        self._problem = ""
        self._count = 0
        self._time = self._reported = time.monotonic()
        self._updater = Updater()
        self._updater.setHardwareID("none")
        self._updater.add("checks", self._report)

    def add(self, verdict: Verdict) -> None:
        """Add the findings of a state."""
        with self._lock:
            if self._count == 0:
                self._found = {}
            self._count += 1
            self._verdict, self._problem = verdict, ""
            self._time = time.monotonic()
            for finding in verdict.findings:
                key = finding.check, finding.subject
                last = self._found.get(key)
                if last is None or last.badness < finding.badness:
                    self._found[key] = finding

    def refuse(self, problem: str) -> None:
        """Record that a state cannot be checked."""
        with self._lock:
            self._problem, self._time = problem, time.monotonic()

    def publish(self) -> None:
        """Publish a report."""
        self._updater.force_update()

    def _report(self, status):
        """Report on the states since the last report."""
        with self._lock:
            now = time.monotonic()
            age, rate = now - self._time, self._count / (now - self._reported)
            if self._verdict is None and not self._problem:
                status.summary(WARN, "no joint_states")
            elif age > MAX_AGE:
                status.summary(WARN, f"no joint_states for {age:.0f} s")
                status.add("age of the last state in s", f"{age:.1f}")
            else:
                self._summarize(status)
                if self._verdict is not None:
                    status.add("states checked per s", f"{rate:.1f}")
                    self._add_values(status, self._verdict)
            self._count, self._reported = 0, now
        return status

    def _summarize(self, status) -> None:
        """Summarize the findings."""
        if self._problem:
            status.summary(ERROR, f"cannot check joint_states: {self._problem}")
            return
        found = sorted(self._found.values(), key=lambda f: f.severity != FAILED)
        status.summary(OK, "no findings")
        if found:
            texts = "; ".join(finding.text for finding in found[:MAX_TEXTS])
            more = len(found) - MAX_TEXTS
            text = texts + (f"; and {more} more" if more > 0 else "")
            status.summary(LEVELS[found[0].severity], text)

    def _add_values(self, status, verdict: Verdict) -> None:
        """Add names and numbers."""
        for finding in self._found.values():
            name = f"{finding.check} {finding.name}".strip()
            status.add(name, f"{finding.severity}: {finding.worst:.4g} {finding.unit}")
        if "least_center_margin" in verdict.figures:
            margin = f"{verdict.figures['least_center_margin']:.4f}"
            status.add(
                "centre of mass inside the support polygon, at rest, in m", margin
            )
        if "penetration" in verdict.checked:
            status.add(
                "in contact with the floor", listed(verdict.floor_contacts) or "nothing"
            )
        for name in SHOWN_IF_SKIPPED:
            if name in verdict.skipped:
                status.add(f"{name} is not checked", verdict.skipped[name])


REPORT_PERIOD = 1.0
"""Time between two reports on /diagnostics in [s] of wall time."""


class LiveChecks:
    """Threads that check at a limited rate and report."""

    def __init__(
        self,
        checker: CheckerAmongObjects,
        lock: threading.Lock,
        states: RobotStates,
        markers: LiveMarkers,
        rate: float,
    ) -> None:
        """Start the threads.

        Args:
            checker: The checks.
            lock: Locked while the checker is used.
            states: Source of states.
            markers: Shows findings in RViz.
            rate: Maximum rate of checks in wall time, in [Hz].
        """
        self._checker, self._lock = checker, lock
        self._states, self._markers = states, markers
        self._period = 1.0 / rate
        self._check = LiveCheck(checker.newest()[0])
        self._forces = LiveForces()
        self._health = CheckHealth()
        self.newest: RobotState | None = None
        """The last state; None before the first one."""
        self._stopped = threading.Event()
        rospy.on_shutdown(self._stopped.set)
        for target in (self._check_forever, self._report_forever):
            threading.Thread(target=target, daemon=True).start()

    def _check_forever(self) -> None:
        """Check new states until the node is shut down."""
        due = time.monotonic()
        try:
            while not self._stopped.wait(max(0.0, due - time.monotonic())):
                self._states.changed.wait(self._period)
                self._states.changed.clear()
                due = time.monotonic() + self._period
                with quiet_when_closing():
                    self._check_newest()
                    self._markers.keep_up()
        finally:  # after an error the node ends, as its reports would be outdated
            rospy.signal_shutdown("the checks have ended")

    def _report_forever(self) -> None:
        """Report until the node is shut down."""
        while not self._stopped.wait(REPORT_PERIOD):
            with quiet_when_closing():
                self._health.publish()

    def _check_newest(self) -> None:
        """Check the newest state, if there is one, and show the findings."""
        try:
            state = self._states.newest()
            if state is None:
                return
            self.newest = state
            if self._states.began_again.is_set():
                self._states.began_again.clear()
                self._check.begin_again()
                self._forces.begin_again()
            with self._lock:
                checker, objects = self._checker.newest()
                if checker is not self._check.checker:
                    self._check = LiveCheck(checker)
                verdict = self._check.check(state, objects)
                self._forces.add(state)
                if self._markers.is_seen:
                    self._forces.find(checker, objects)
        except G1DescriptionError as error:
            self._health.refuse(str(error))
            return
        if state.base_pose is None:
            why = {NO_BASE: self._states.no_base}
            skipped = {
                n: why.get(reason, reason) for n, reason in verdict.skipped.items()
            }
            verdict = replace(verdict, skipped=skipped)
        self._health.add(verdict)
        self._markers.show(state, verdict, self._forces)


def make_collisions(
    robot: Description, parameters: CheckerParameters
) -> SelfCollisions:
    """Prepare the self-collisions of the robot.

    Raises:
        G1DescriptionError: If a file cannot be read.
    """
    file = Path(parameters.collisions) if parameters.collisions else None
    return collisions_of(robot, file, parameters.visual_hulls)


def make_checker(
    robot: Description, parameters: CheckerParameters, objects: CheckedObjects
) -> CheckerAmongObjects:
    """Create the checks of the robot among objects.

    Raises:
        G1DescriptionError: If a file cannot be read.
    """
    collisions = make_collisions(robot, parameters)
    checker = Checker(robot, parameters.read_thresholds(), collisions=collisions)
    return CheckerAmongObjects(checker, objects, parameters.visual_hulls)


def start(robot: Description, parameters: CheckerParameters) -> None:
    """Advertise services and topics.

    Raises:
        G1DescriptionError: If a file cannot be read.
    """
    log, lock = ThrottledLog(), threading.Lock()
    model, file = rospy.get_namespace().strip("/"), parameters.read_scene()
    objects = CheckedObjects(robot, model, file, parameters.gazebo, log)
    checker = make_checker(robot, parameters, objects)
    for note in checker.newest()[0].notes:
        rospy.loginfo("%s", note)
    make_another = partial(make_checker, robot, parameters, objects)
    map_frame = parameters.map_frame
    frame = MapFrame((map_frame, "world"))
    live: LiveChecks | None = None

    def present() -> RobotState | None:
        return None if live is None else live.newest

    CheckServices(checker, lock, make_another, present, frame)
    if parameters.rate:
        markers = LiveMarkers(robot, parameters)
        root = base_frame(robot, parameters)
        states = RobotStates(map_frame, root, 1.0 / parameters.rate, log)
        live = LiveChecks(checker, lock, states, markers, parameters.rate)
    make_shapes = partial(make_collisions, robot, parameters)
    IkService(robot, make_shapes, objects, present, frame)


def main() -> None:
    """Run the node ``checker``."""
    serve_as_roscpp()
    start_node("checker")
    try:
        parameters = read_parameters(CheckerParameters)
        start(wait_for_robot(parameters), parameters)
    except G1DescriptionError as error:
        rospy.logfatal("%s", error)
        sys.exit(1)
    except rospy.ROSInterruptException:  # shut down while waiting
        return
    rospy.spin()
