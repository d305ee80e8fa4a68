"""What all checks say of a motion."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import Any

from g1_description.checks.finding import FAILED, PASSED, WARNING, Finding
from g1_description.checks.measured import Measured


@dataclass(frozen=True)
class Verdict:
    """What all checks say of a motion, or of a configuration."""

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
    """Links that bear on the floor: first and last time of each stretch, in [s]."""

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
