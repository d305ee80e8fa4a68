"""Judges the robot as it is now, again and again."""

from __future__ import annotations

import threading
import time
from dataclasses import replace

import rospy

from g1_description.core.checks.verdict import Verdict
from g1_description.core.errors import G1DescriptionError
from g1_description.ros.node.lifecycle import quiet_when_closing
from g1_description.sim.checks.checker import Checker
from g1_description.sim.checks.plan import NO_BASE
from g1_description.sim.live.live_judge import LiveJudge

from .health import CheckHealth
from .live_markers import LiveMarkers
from .live_states import LiveState, LiveStates
from .messages import positions_of, velocities_of

REPORT_PERIOD = 1.0
"""Time between two reports on /diagnostics in [s] of wall time."""


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
        self._lock = lock
        self._states, self._markers = states, markers
        self._period = 1.0 / rate
        self._judge = LiveJudge(checker)
        self._health = CheckHealth()
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
                        self._tell(state)
                    self._markers.keep_up()
        finally:  # after an error the node ends: what it told is no longer true
            rospy.signal_shutdown("no state is judged any more")

    def _report_forever(self) -> None:
        """Report, until the node is shut down."""
        while not self._stopped.wait(REPORT_PERIOD):
            with quiet_when_closing():
                self._health.publish()

    def _tell(self, state: LiveState) -> None:
        """Judge one state, and show what was found."""
        if self._states.began_again:
            self._states.began_again = False
            self._judge.begin_again()
        try:
            positions = positions_of(state.message)
            velocities = velocities_of(state.message)
            with self._lock:
                judged, verdict = self._judge.judge(
                    1e-9 * state.stamp, positions, state.base, velocities
                )
        except G1DescriptionError as error:
            self._health.refuse(str(error))
            return
        if state.base is None:
            verdict = _renamed(verdict, NO_BASE, self._states.no_base)
        self._health.add(verdict)
        self._markers.show(state, judged, verdict)


def _renamed(verdict: Verdict, reason: str, better: str) -> Verdict:
    """Give another reason why checks were not made."""
    skipped = {
        name: why.replace(reason, better) for name, why in verdict.skipped.items()
    }
    return replace(verdict, skipped=skipped)
