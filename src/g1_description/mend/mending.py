"""Motions whose findings are removed by small changes, and what that changed."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Tuple

import numpy as np

from g1_description.checks.checker import Checker
from g1_description.checks.intervals import runs
from g1_description.checks.verdict import FAILED, Verdict
from g1_description.mend.certificate import LARGER, Certificate, moved_parts, rows_of
from g1_description.mend.correction import Correction
from g1_description.mend.options import FINDINGS, MendOptions
from g1_description.mend.samples import without_noise, without_outliers
from g1_description.motion.motion import Motion

SAMPLES = {"outliers": without_outliers, "noise": without_noise}
"""Parts that change each joint by itself."""

PASSES = 3
"""Most times that all parts are tried."""

LESS = 0.05
"""A part is kept if it removes this much: a failure counts 1 and its fraction of time,
a warning a fifth of that."""

SPREAD = 0.4
"""Nothing is corrected as near to a place that would change too far, in [s]."""

TRIES = 3
"""Times that a correction is tried with more places left alone."""

REASONS = {
    "contact_forces": "only slower or other movements need less",
    "effort": "only slower or other movements need less",
    "center_of_mass": "the robot is too far out of balance, or does not stay",
    "skating": "nothing else carries the robot meanwhile",
    "self_collision": "small changes do not push the links apart",
}
"""Why findings of checks stay."""

WORSE = "a change would make other findings worse"
TOO_FAR = "a change would be larger than allowed, or make other findings worse"
"""Why places are left alone, without bounds of changes and with them."""

Span = Tuple[float, float]
"""First and last time in [s]."""


@dataclass(frozen=True, eq=False)
class Mended:
    """The outcome of mending."""

    motion: Motion
    """The mended motion, or the given one if nothing was changed."""

    certificate: Certificate
    before: Verdict
    after: Verdict


def mended(
    checker: Checker, motion: Motion, options: MendOptions | None = None
) -> Mended:
    """Remove the findings of a motion by small changes.

    Parts are tried where checks found something, and kept if no check has a new failure
    or a larger one. So the result cannot be mended further.

    Args:
        checker: The checks.
        motion: Must fit the robot, as by ``fitted``.
        options: What is mended; None: everything.

    Raises:
        G1DescriptionError: If the motion cannot be checked.
    """
    wanted = options or MendOptions()
    parts = [name for name in FINDINGS if not wanted.only or name in wanted.only]
    first = verdict = checker.check(motion)
    given: Motion = motion
    left: list[Span] = []
    for _ in range(PASSES):
        is_mended = False
        for some in _tried(verdict, parts):
            found = _changed(checker, given, motion, verdict, some, wanted)
            if found and _is_better(first, verdict, found[1], some):
                (motion, verdict, left), is_mended = found, True
        if not is_mended:
            break
    moved = (
        moved_parts(checker.checked_robot, given, motion) if motion is not given else ()
    )
    is_free = wanted.max_change == wanted.max_base == np.inf
    reasons = tuple(_reasons(verdict, parts, left, WORSE if is_free else TOO_FAR))
    certificate = Certificate(rows_of(first, verdict), moved, reasons)
    return Mended(motion, certificate, first, verdict)


def _tried(verdict: Verdict, parts: Collection[str]) -> Iterator[tuple[str, ...]]:
    """List the parts that are tried: samples first, then all of the body, then each."""
    checks = {finding.check for finding in verdict.findings}
    due = [name for name in parts if checks & {*FINDINGS[name]}]
    yield from ((name,) for name in due if name in SAMPLES)
    body = tuple(name for name in due if name not in SAMPLES)
    sure = tuple(name for name in body if name != "balance")
    for some in dict.fromkeys((body, sure, *((name,) for name in body))):
        if some:
            yield some


def _changed(
    checker: Checker,
    given: Motion,
    motion: Motion,
    verdict: Verdict,
    parts: tuple[str, ...],
    options: MendOptions,
) -> tuple[Motion, Verdict, list[Span]] | None:
    """Correct a motion within the bounds.

    Returns:
        The motion, its verdict, and what is left alone; None without a change.
    """
    if parts[0] in SAMPLES:
        found = SAMPLES[parts[0]](motion)
        if found is motion:
            return None
        found = _bounded(given, motion, found, options)
        return found, checker.check(found), []
    measured = verdict.measured
    assert measured is not None
    correction = Correction(measured, parts, options.keep_hands)
    for _ in range(TRIES):
        found = correction.find()
        wrong = _too_far(given, found, options)
        if not wrong.any():
            judged = checker.check(found)
            wrong = _worse(motion, verdict, judged)
            if not wrong.any():
                break
        correction.left_alone |= wrong
    else:
        return None
    times = motion.times
    alone = [(float(times[a]), float(times[b])) for a, b in runs(correction.left_alone)]
    return found, judged, alone


def _bounded(
    given: Motion, motion: Motion, found: Motion, options: MendOptions
) -> Motion:
    """Leave samples as they were that change more than allowed."""
    far = _far(given, found, options)[:, np.newaxis]
    bases = found.base_poses
    if bases is not None and motion.base_poses is not None:
        bases = np.where(far, motion.base_poses, bases)
    positions = np.where(far, motion.positions, found.positions)
    return replace(found, positions=positions, base_poses=bases)


def _too_far(motion: Motion, found: Motion, options: MendOptions) -> np.ndarray:
    """Mark the samples near those that change more than allowed, shape (n,)."""
    times, far = motion.times, _far(motion, found, options)
    return _near(times, [(times[a], times[b]) for a, b in runs(far)])


def _far(motion: Motion, found: Motion, options: MendOptions) -> np.ndarray:
    """Mark the samples that change more than allowed, shape (n,)."""
    far = np.abs(found.positions - motion.positions).max(axis=1) > options.max_change
    if motion.base_poses is not None and found.base_poses is not None:
        away = np.linalg.norm((found.base_poses - motion.base_poses)[:, :3], axis=1)
        far |= away > options.max_base
    return np.asarray(far)


def _near(times: np.ndarray, spans: Sequence[tuple[float, float]]) -> np.ndarray:
    """Mark the times near intervals, shape (n,)."""
    found = np.zeros(len(times), dtype=bool)
    for begin, end in spans:
        found |= (times >= begin - SPREAD) & (times <= end + SPREAD)
    return found


def _worse(motion: Motion, before: Verdict, after: Verdict) -> np.ndarray:
    """Mark the samples near failures that are new or larger, shape (n,)."""
    worst: dict[tuple[str, tuple[str, ...]], float] = {}
    for finding in before.findings:
        if finding.severity == FAILED:
            key = finding.check, finding.subject
            worst[key] = max(finding.worst, worst.get(key, 0.0))
    spans = [
        span
        for finding in after.findings
        if finding.severity == FAILED
        and finding.worst > LARGER * worst.get((finding.check, finding.subject), 0.0)
        for span in finding.intervals
    ]
    return _near(motion.times, spans)


def _score(verdict: Verdict) -> float:
    """Add up failures, with their fractions of time, and a fifth of warnings."""
    weights = [1.0 if f.severity == FAILED else 0.2 for f in verdict.findings]
    sizes = [1.0 + finding.share for finding in verdict.findings]
    return float(np.dot(weights, sizes))


def _is_better(
    first: Verdict, before: Verdict, after: Verdict, parts: tuple[str, ...]
) -> bool:
    """Return whether a change is kept."""
    if any(row.is_worse for row in rows_of(first, after)):
        return False
    if any(row.is_worse for row in rows_of(before, after)):
        return False
    gain = _score(before) - _score(after)
    return gain > (0.0 if parts == ("noise",) else LESS)


def _reasons(
    verdict: Verdict, parts: Collection[str], left: Collection[Span], alone: str
) -> Iterator[str]:
    """Say why failures stay that could have been mended, and what was left alone."""
    known = {check for name in parts for check in FINDINGS[name]} | {"effort"}
    for finding in verdict.findings:
        if finding.severity == FAILED and finding.check in known:
            why = REASONS.get(finding.check, WORSE)
            if any(begin <= finding.worst_time <= end for begin, end in left):
                why = alone
            yield f"{finding.text}: {why}"
    for begin, end in left:
        yield f"{begin:.2f} s to {end:.2f} s is not corrected further: {alone}"
