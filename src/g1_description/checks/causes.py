"""Findings of the same cause: an arm that cuts into a leg, a jump of all joints."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from g1_description.checks.verdict import FAILED, Finding

GAP = 0.1
"""Longest time between findings of one cause, in [s]."""

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
        same = [
            group
            for group in groups
            if how
            and any(
                _is_same(finding, findings[n], limbs if how == BY_LIMBS else {})
                for n in group
            )
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
