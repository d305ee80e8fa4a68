"""What is found of the robot as it is now, on /diagnostics.

Publishes: /diagnostics (diagnostic_msgs/DiagnosticArray)
"""

from __future__ import annotations

import threading
import time

from diagnostic_msgs.msg import DiagnosticStatus
from diagnostic_updater import Updater

from g1_description.core.checks.verdict import FAILED, WARNING, Finding, Verdict
from g1_description.core.text import listed

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
LEVELS = {FAILED: ERROR, WARNING: WARN}

MAX_AGE = 2.0
"""Age of the last state in [s] of wall time from which on only that is reported: what
was found of it may no longer be true."""

SHOWN_IF_SKIPPED = ("self_collision", "penetration", "center_of_mass")
"""Checks of which it is told why they are not made."""

MAX_TEXTS = 3
"""Most findings whose words are in the summary; values tell all of them."""


class CheckHealth:
    """Gathers what was found since the last report, so that nothing short is missed."""

    def __init__(self) -> None:
        """Begin without a state."""
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
        """Add what was found of a state."""
        with self._lock:
            if self._count == 0:
                self._found = {}
            self._count += 1
            self._verdict, self._problem = verdict, ""
            self._time = time.monotonic()
            for finding in verdict.findings:
                key = finding.check, finding.subject
                last = self._found.get(key)
                if last is None or last.worst < finding.worst:
                    self._found[key] = finding

    def refuse(self, problem: str) -> None:
        """Take note that a state cannot be judged."""
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
                status.summary(WARN, "no joint_states come")
            elif age > MAX_AGE:
                status.summary(WARN, f"no joint_states have come for {age:.0f} s")
                status.add("age of the last state in s", f"{age:.1f}")
            else:
                self._summarize(status)
                if self._verdict is not None:
                    status.add("states judged per s", f"{rate:.1f}")
                    self._add_values(status, self._verdict)
            self._count, self._reported = 0, now
        return status

    def _summarize(self, status) -> None:
        """Say what is wrong in few words."""
        if self._problem:
            status.summary(ERROR, f"joint_states cannot be judged: {self._problem}")
            return
        found = sorted(self._found.values(), key=lambda f: f.severity != FAILED)
        status.summary(OK, "nothing is wrong")
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
            status.add("centre of mass inside of what bears, at rest, in m", margin)
        if "penetration" in verdict.checked:
            status.add("bears", listed(verdict.bearing) or "nothing")
        for name in SHOWN_IF_SKIPPED:
            if name in verdict.skipped:
                status.add(f"{name} is not judged", verdict.skipped[name])
