"""The findings of checks, their causes, and the verdict that holds all of them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any

from g1_description.checks.intervals import GAP
from g1_description.former import former

if TYPE_CHECKING:
    from g1_description.checks.measured import Measured

FAILED, WARNING, PASSED = "failed", "warning", "passed"

FIGURES = {
    "duration": ("length", "s"),
    "samples": ("samples", ""),
    "samples_beyond_limits": ("samples beyond a limit", ""),
    "root_path": ("path of the base", "m"),
    "root_speed.max": ("fastest base", "m/s"),
    "joint_speed.max": ("fastest joint", "rad/s"),
    "contact_share": ("time in contact with the floor", "%"),
    "largest_drift": ("largest slip in a contact", "m"),
    "energy": ("energy", "J"),
    "deepest_self_collision": ("deepest self-collision", "m"),
    "lowest_height": ("lowest point", "m"),
    "least_center_margin": ("least margin of the centre of mass", "m"),
    "largest_missing_wrench": ("largest missing contact force", "% of the weight"),
    "infeasible_share": ("time without feasible contact forces", "%"),
    "needed_friction": ("largest friction needed", ""),
    "fall_time": ("fall at", "s"),
    "rms_tracking_error": ("tracking error, rms", "rad"),
    "largest_tracking_error": ("largest tracking error", "rad"),
    "least_clearance": ("least distance from an object", "m"),
}
"""The figures of a motion, in the order of reports: by name, a description and the
unit. A share is a fraction of 1, and shown in per cent."""


def figure_text(name: str, value: float) -> str:
    """Describe a figure, as "path of the base 1.2 m"."""
    about, unit = FIGURES[name]
    scale = 100.0 if unit.startswith("%") else 1.0
    return f"{about} {round(scale * value, 6):.4g} {unit}".rstrip()


NOTES, WORST = "notes", ".worst"
"""Further names in rules: of the number of notes, and the ending of ``CHECK.worst``,
the worst size of a check's findings."""

COUNTS = ("failed", "warnings")
"""Names of the numbers of findings."""


@dataclass(frozen=True)
class Finding:
    """A finding of one check on one joint, link or pair of links, in a whole motion."""

    check: str
    """Name of the check: position, velocity, self_collision ..."""

    severity: str
    """``failed`` or ``warning``."""

    subject: tuple[str, ...]
    """Names of the joint, of the link or of both links; empty for the whole robot."""

    worst: float
    """The worst size, in ``unit``."""

    bound: float
    """The exceeded threshold of ``severity``. The worst size is above it, or below it
    for checks such as distances."""

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
    """Message on the worst size."""

    points: tuple[tuple[float, float, float], ...] = ()
    """Points of the worst size in the map, in [m]; may be empty."""

    cause: int = 0
    """Number of its cause, which other findings of the motion may have, too."""

    @property
    def name(self) -> str:
        """The subject as text."""
        return " - ".join(self.subject)

    @property
    def badness(self) -> float:
        """Sort key: larger for the worse of two findings of a check."""
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
    """Reasons by the names of the skipped checks."""

    figures: dict[str, float] = field(default_factory=dict)
    """Figures of the motion by name, some of ``FIGURES``."""

    floor_contacts: dict[str, tuple[tuple[float, float], ...]] = field(
        default_factory=dict
    )
    """First and last time of each contact with the floor, in [s], by link."""

    notes: tuple[str, ...] = ()
    """Messages on assumptions."""

    excluded_by: tuple[str, ...] = ()
    """Rules over figures that exclude the motion, such as ``root_speed.max > 10``."""

    measured: Measured | None = field(default=None, compare=False, repr=False)
    """The measurements; None in reports."""

    bearing = former("Verdict.bearing", "floor_contacts")

    @property
    def severity(self) -> str:
        """``failed``, ``warning`` or ``passed``."""
        found = {finding.severity for finding in self.findings}
        return next((s for s in (FAILED, WARNING) if s in found), PASSED)

    @property
    def causes(self) -> tuple[tuple[Finding, ...], ...]:
        """The findings, those of one cause together, in the order of the first ones."""
        by_cause: dict[int, list[Finding]] = {}
        for finding in self.findings:
            by_cause.setdefault(finding.cause, []).append(finding)
        return tuple(map(tuple, by_cause.values()))

    @property
    def counts(self) -> dict[str, int]:
        """Number of failures and of warnings: of ``failed`` and ``warnings``."""
        severities = [finding.severity for finding in self.findings]
        return dict(zip(COUNTS, map(severities.count, (FAILED, WARNING))))

    @property
    def rule_figures(self) -> dict[str, float]:
        """The values that rules compare: figures, counts, notes and ``CHECK.worst``."""
        worst = sorted(self.findings, key=lambda finding: finding.badness)
        return {
            **self.figures,
            **self.counts,
            NOTES: len(self.notes),
            **{f"{finding.check}{WORST}": finding.worst for finding in worst},
        }

    @property
    def first_time(self) -> float | None:
        """When the first failure begins, or else the first warning, in [s]."""
        times = [f.first_time for f in self.findings if f.severity == self.severity]
        return min(times, default=None)

    @property
    def nothing_made(self) -> str:
        """Why all checks were skipped; empty if any was made."""
        if self.checked:
            return ""
        reasons = "; ".join(f"{name}: {why}" for name, why in self.skipped.items())
        return f"All checks were skipped: {reasons}."

    @property
    def passed(self) -> bool:
        """Whether nothing failed; there may be warnings."""
        return self.severity != FAILED

    def of(self, check: str) -> tuple[Finding, ...]:
        """Return the findings of one check.

        Args:
            check: Its name.

        Raises:
            KeyError: If it was neither made nor skipped.
        """
        if check not in self.checked and check not in self.skipped:
            known = ", ".join([*self.checked, *self.skipped])
            raise KeyError(f"unknown check '{check}'; known: {known}")
        return tuple(finding for finding in self.findings if finding.check == check)

    def as_dict(self) -> dict[str, Any]:
        """Return a dictionary for JSON, without the measurements."""
        parts = replace(self, measured=None)
        content = {**asdict(parts), "severity": self.severity}
        del content["measured"]
        return {key: _plain(value) for key, value in content.items()}


def _plain(value: Any) -> Any:
    """Replace tuples by lists."""
    if isinstance(value, dict):
        return {key: _plain(part) for key, part in value.items()}
    return [*map(_plain, value)] if isinstance(value, (list, tuple)) else value


BY_LIMBS, BY_TIME = "limbs", "time"
"""Findings of a check have the same cause if they are at the same time and between the
same two limbs, or at the same time."""


def with_causes(
    findings: Sequence[Finding],
    grouping: Mapping[str, str],
    limbs: Mapping[str, str],
) -> tuple[Finding, ...]:
    """Number the findings by their causes, in the order of the first finding of each.

    Args:
        findings: All of a motion.
        grouping: ``BY_LIMBS`` or ``BY_TIME``, by name of the check; findings of other
            checks have causes of their own.
        limbs: Limbs of each link.
    """
    groups: list[list[int]] = []
    for number, finding in enumerate(findings):
        how = grouping.get(finding.check, "")
        ends = limbs if how == BY_LIMBS else {}
        same = [
            group
            for group in groups
            if how and any(_is_same(finding, findings[n], ends) for n in group)
        ]
        merged = sorted([number, *(n for group in same for n in group)])
        groups = [group for group in groups if group not in same] + [merged]
    groups.sort(key=min)
    causes = {n: cause for cause, group in enumerate(groups) for n in group}
    return tuple(replace(f, cause=causes[n]) for n, f in enumerate(findings))


def _is_same(one: Finding, other: Finding, limbs: Mapping[str, str]) -> bool:
    """Return whether two findings have the same cause."""
    if one.check != other.check:
        return False
    if {limbs.get(n) for n in one.subject} != {limbs.get(n) for n in other.subject}:
        return False
    return any(
        first <= end + GAP and start <= last + GAP
        for first, last in one.intervals
        for start, end in other.intervals
    )


def cause_text(findings: Collection[Finding]) -> str:
    """Describe the findings of one cause by the worst, and count the others."""
    worst = worst_of(findings)
    others = [finding for finding in findings if finding is not worst]
    if not others:
        return worst.text
    if len(others) == 1:
        return f"{worst.text}, also {others[0].name}"
    pairs = " pairs" if len(worst.subject) == 2 else ""
    return f"{worst.text}, and {len(others)} more{pairs}"


def worst_of(findings: Collection[Finding]) -> Finding:
    """Return the worst of the findings of one cause."""
    return max(findings, key=lambda f: (f.severity == FAILED, f.badness))
