"""Findings of the same cause: an arm that cuts into a leg, a jump of all joints."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from g1_description.checks.verdict import FAILED, Finding
from g1_description.robot.description import Description
from g1_description.robot.tree import below

GAP = 0.1
"""Longest time between findings of one cause, in [s]."""

BY_LIMBS, BY_TIME = "limbs", "time"
"""Findings of a check have the same cause if they are at the same time and between the
same two limbs, or at the same time."""


def limbs_of(description: Description) -> dict[str, str]:
    """Return the limb of each link, named by the first link of the limb.

    A limb is a chain of movable joints up to the next branch, with all links that are
    fixed to it: an arm, a leg, or the waist with the torso. The root is one of its own.
    """
    roots = description.roots
    joints = [*below(roots, description.joints)]
    moving = [joint for joint in joints if joint.kind != "fixed"]
    body = {root: root for root in roots}
    for joint in joints:
        is_fixed = joint.kind == "fixed"
        body[joint.child] = body[joint.parent] if is_fixed else joint.child
    branches = Counter(body[joint.parent] for joint in moving)
    limb = {root: root for root in roots}
    for joint in moving:
        parent = body[joint.parent]
        is_next = branches[parent] == 1 and parent not in roots
        limb[joint.child] = limb[parent] if is_next else joint.child
    return {link: limb[name] for link, name in body.items()}


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
        limbs: Of each link.
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
    more = len(findings) - 1
    if not more:
        return worst.text
    kind = "joint" if len(worst.subject) == 1 else "pair of links"
    kinds = "joints" if len(worst.subject) == 1 else "pairs of links"
    return f"{worst.text}, and {more} more {kinds if more > 1 else kind}"


def worst_of(findings: Collection[Finding]) -> Finding:
    """Return the worst of the findings of one cause."""
    return max(findings, key=lambda f: (f.severity == FAILED, f.badness))
