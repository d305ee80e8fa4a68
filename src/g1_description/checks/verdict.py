"""The findings of checks, and the verdict that holds all of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from g1_description.checks.measured import Measured

FAILED, WARNING, PASSED = "failed", "warning", "passed"


@dataclass(frozen=True)
class Finding:
    """What one check found of one joint, link or pair of links in a whole motion."""

    check: str
    """Which check found it: position, velocity, self_collision ..."""

    severity: str
    """``failed`` or ``warning``."""

    subject: tuple[str, ...]
    """Names of the joint, of the link or of both links; empty for the whole robot."""

    worst: float
    """The size where it is worst, in ``unit``."""

    bound: float
    """The threshold that ``severity`` stands for. The worst size is above it; or below,
    for checks such as of distances."""

    unit: str
    first_time: float
    """When the size first exceeds ``bound``, in [s]."""

    worst_time: float
    """When it is worst, in [s]."""

    share: float
    """Fraction of the motion's time in which it exceeds ``bound``, from 0 to 1."""

    intervals: tuple[tuple[float, float], ...]
    """First and last times of each interval in which it exceeds ``bound``, in [s]."""

    text: str
    """A sentence on the worst of it."""

    points: tuple[tuple[float, float, float], ...] = ()
    """Where it is at its worst, in the map, in [m]; empty where it is nowhere."""

    @property
    def name(self) -> str:
        """The subject in a word or two."""
        return " - ".join(self.subject)

    @property
    def badness(self) -> float:
        """A number that is larger for the worse one of two findings of a check."""
        return -self.worst if self.worst < self.bound else self.worst


def sorted_findings(findings: Iterable[Finding | None]) -> tuple[Finding, ...]:
    """Sort findings: the failed ones first, then by time; ignore None."""
    return tuple(
        sorted(
            (finding for finding in findings if finding is not None),
            key=lambda f: (f.severity != FAILED, f.first_time, f.check, f.subject),
        )
    )


@dataclass(frozen=True)
class Verdict:
    """The findings of all checks of a motion, or of a configuration."""

    robot: str
    findings: tuple[Finding, ...] = ()
    """The failed ones first, then by the time of their first appearance."""

    checked: tuple[str, ...] = ()
    """Names of the checks that were made."""

    skipped: dict[str, str] = field(default_factory=dict)
    """Names of those that were not, and why not."""

    figures: dict[str, float] = field(default_factory=dict)
    """Figures of the motion by name, such as ``duration`` and ``largest_speed``."""

    bearing: dict[str, tuple[tuple[float, float], ...]] = field(default_factory=dict)
    """First and last time of each contact with the floor, in [s], by link."""

    notes: tuple[str, ...] = ()
    """Messages on what was assumed."""

    measured: Measured | None = field(default=None, compare=False, repr=False)
    """Arrays over the samples that the findings are from; None in reports."""

    @property
    def severity(self) -> str:
        """``failed``, ``warning`` or ``passed``."""
        found = {finding.severity for finding in self.findings}
        return next((s for s in (FAILED, WARNING) if s in found), PASSED)

    @property
    def first_time(self) -> float | None:
        """When the first failure begins, or else the first warning, in [s]."""
        times = [f.first_time for f in self.findings if f.severity == self.severity]
        return min(times, default=None)

    @property
    def nothing_made(self) -> str:
        """A sentence on why no check was made at all; empty where one was."""
        if self.checked:
            return ""
        reasons = "; ".join(f"{name}: {why}" for name, why in self.skipped.items())
        return f"No check could be made: {reasons}."

    @property
    def passed(self) -> bool:
        """Whether nothing failed; there may be warnings."""
        return self.severity != FAILED

    def of(self, check: str) -> tuple[Finding, ...]:
        """Return what one check found.

        Args:
            check: Its name.

        Raises:
            KeyError: If it was neither made nor skipped.
        """
        if check not in self.checked and check not in self.skipped:
            known = ", ".join([*self.checked, *self.skipped])
            raise KeyError(f"there is no check {check}; there are {known}")
        return tuple(finding for finding in self.findings if finding.check == check)

    def as_dict(self) -> dict[str, Any]:
        """Return it for JSON, without what was measured."""
        parts = replace(self, measured=None)
        content = {**asdict(parts), "severity": self.severity}
        del content["measured"]
        return {key: _plain(value) for key, value in content.items()}


def _plain(value: Any) -> Any:
    """Replace tuples by lists."""
    if isinstance(value, dict):
        return {key: _plain(part) for key, part in value.items()}
    return [*map(_plain, value)] if isinstance(value, (list, tuple)) else value
