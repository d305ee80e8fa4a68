"""Judges the robot as it is now, again and again."""

from __future__ import annotations

import threading
import time
from dataclasses import replace

import numpy as np
import rospy

from g1_description.core.checks.verdict import Verdict
from g1_description.core.errors import G1DescriptionError, UnknownNameError
from g1_description.core.text import listed
from g1_description.ros.node.lifecycle import quiet_when_closing
from g1_description.sim.checks.checker import NAMES, Checker
from g1_description.sim.checks.plan import NO_BASE
from g1_description.sim.checks.timeline import Judged

from .health import CheckHealth
from .live_markers import LiveMarkers
from .live_states import LiveState, LiveStates
from .messages import positions_of, velocities_of

REPORT_PERIOD = 1.0
"""Time between two reports on /diagnostics in [s] of wall time."""

AT_REST = ("center_of_mass", "floating")
"""Checks that say something of a robot at rest only."""

LIVE = tuple(name for name in NAMES if name != "zero_moment_point")
"""Checks that are made: at rest the zero-moment point is below the centre of mass."""

STANDSTILL = 1e-6
"""States that are nearer in time than this, in [s], are of one time that stands
still: the robot is placed, it does not move."""


class LiveChecks:
    """A thread that judges, at most so often, and one that reports."""

    def __init__(
        self,
        checker: Checker,
        lock: threading.Lock,
        states: LiveStates,
        markers: LiveMarkers,
        rate: float,
    ) -> None:
        """Begin.

        Args:
            checker: Judges.
            lock: Held while it does.
            states: Where the robot is.
            markers: Shows what was found.
            rate: How often it is judged at most, in [Hz] of wall time.
        """
        self._checker, self._lock = checker, lock
        self._states, self._markers = states, markers
        self._period = 1.0 / rate
        joints = checker.description.movable_joints
        self._joints = frozenset(joint.name for joint in joints)
        self._health = CheckHealth()
        self._last: tuple[int, np.ndarray] | None = None
        self._newest: tuple[tuple, Judged] | None = None
        self._stopped = threading.Event()
        rospy.on_shutdown(self._stopped.set)
        for target in (self._judge_forever, self._report_forever):
            threading.Thread(target=target, daemon=True).start()

    def _judge_forever(self) -> None:
        """Judge what is new, until the node is shut down."""
        due = time.monotonic()
        try:
            while not self._stopped.wait(max(0.0, due - time.monotonic())):
                is_new = self._states.changed.wait(self._period)
                self._states.changed.clear()
                due = time.monotonic() + self._period
                state = self._states.newest() if is_new else None
                with quiet_when_closing():
                    if state is not None:
                        self._judge(state)
                    self._markers.keep_up()
        finally:  # after an error the node ends: what it told is no longer true
            rospy.signal_shutdown("no state is judged any more")

    def _report_forever(self) -> None:
        """Report, until the node is shut down."""
        while not self._stopped.wait(REPORT_PERIOD):
            with quiet_when_closing():
                self._health.publish()

    def _judge(self, state: LiveState) -> None:
        """Judge one state, and show what was found."""
        try:
            judged = self._judged(state)
        except G1DescriptionError as error:
            self._health.refuse(str(error))
            return
        verdict = judged.verdict
        if self._moves(state.stamp, judged):
            verdict = _without(verdict, AT_REST, "the robot moves")
        if state.base is None:
            verdict = _renamed(verdict, NO_BASE, self._states.no_base)
        self._health.add(verdict)
        self._markers.show(state, judged, verdict)

    def _judged(self, state: LiveState) -> Judged:
        """Judge one state, if it differs from the last one."""
        message, base = state.message, state.base
        place = None if base is None else base.tobytes()
        content = message.name, message.position, message.velocity, place
        if self._newest is None or content != self._newest[0]:
            positions = self._own(positions_of(message))
            velocities = self._own(velocities_of(message)) or None
            with self._lock:
                judged = self._checker.judge_state(positions, base, LIVE, velocities)
            self._newest = content, judged
        return self._newest[1]

    def _own(self, values: dict[str, float]) -> dict[str, float]:
        """Leave out joints of others, such as hands.

        Raises:
            UnknownNameError: If there are only such.
        """
        if values.keys() <= self._joints:
            return values
        own = {name: value for name, value in values.items() if name in self._joints}
        if not own:
            raise UnknownNameError(
                f"{self._checker.description.name} has none of the joints "
                f"{listed(values)}."
            )
        return own

    def _moves(self, stamp: int, judged: Judged) -> bool:
        """Tell whether the centre of mass has moved since the last state."""
        if self._states.began_again:
            self._states.began_again, self._last = False, None
        balance, last = judged.timeline.balance, self._last
        if balance is None:
            self._last = None
            return False
        center = balance.center[0]
        self._last = stamp, center
        if last is None or 1e-9 * (stamp - last[0]) < STANDSTILL:
            return False
        speed = np.linalg.norm(center - last[1]) / (1e-9 * (stamp - last[0]))
        return bool(speed > self._checker.thresholds.still_speed)


def _without(verdict: Verdict, checks: tuple[str, ...], reason: str) -> Verdict:
    """Leave out what some checks found."""
    left_out = [name for name in verdict.checked if name in checks]
    return replace(
        verdict,
        findings=tuple(f for f in verdict.findings if f.check not in checks),
        checked=tuple(name for name in verdict.checked if name not in checks),
        skipped={**verdict.skipped, **dict.fromkeys(left_out, reason)},
    )


def _renamed(verdict: Verdict, reason: str, better: str) -> Verdict:
    """Give another reason why checks were not made."""
    skipped = {
        name: why.replace(reason, better) for name, why in verdict.skipped.items()
    }
    return replace(verdict, skipped=skipped)
