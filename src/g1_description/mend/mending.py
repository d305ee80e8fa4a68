"""Motions whose findings are removed by small changes, and what that changed."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Tuple

import numpy as np

from g1_description.checks.checker import Checker
from g1_description.checks.intervals import runs
from g1_description.checks.verdict import FAILED, Verdict
from g1_description.mend.certificate import LARGER, Certificate, moved_parts, rows_of
from g1_description.mend.correction import Correction
from g1_description.mend.options import FINDINGS, MendOptions
from g1_description.mend.samples import on_floor, without_noise, without_outliers
from g1_description.motion.motion import Motion
from g1_description.text import listed

SAMPLES = {"outliers": without_outliers, "noise": without_noise, "floor": on_floor}
"""Parts that change samples by themselves."""

PASSES = 6
"""Most changes that follow each other."""

LESS = 0.05
"""A part is kept if it removes this much: a failure counts 1 and its fraction of time,
a warning a fifth of that."""

SPREAD = 0.4
"""Nothing is corrected as near to a place that would change too far, in [s]."""

TRIES = 3
"""Times that a correction is tried with more places left alone."""

AWAY = 0.01
"""The base keeps near its path if it would else be this far from it, rms in [m]."""

MORE, SMALL, NEARLY = 1.5, 2e-3, 0.5
"""Largest ratio and rms in [rad] of the joints' changes that this is worth, and what
may stay more, as for ``LESS``."""

EARLY = 0.1
"""A change is not kept if the simulated robot falls this much earlier, in [s]."""

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
    mending = _Mending(checker.without_physics(), motion, parts, wanted)
    first, given = mending.now.verdict, motion
    for _ in range(PASSES):
        found = mending.next()
        if found is None:
            break
        mending.now = found
    motion, verdict, left = mending.now
    is_free = wanted.max_change == wanted.max_base == np.inf
    reasons = [*_reasons(verdict, parts, left, WORSE if is_free else TOO_FAR)]
    falls = None
    if checker.physics is not None:
        before, after = (_fall(checker, one) for one in (given, motion))
        falls = before, after
        if after is not None and after < (np.inf if before is None else before) - EARLY:
            motion, verdict, falls = given, first, (before, before)
            reasons = [f"with changes the simulated robot falls at {after:.2f} s"]
    is_changed = motion is not given
    moved = moved_parts(checker.checked_robot, given, motion) if is_changed else ()
    certificate = Certificate(rows_of(first, verdict), moved, tuple(reasons), falls)
    return Mended(motion, certificate, first, verdict)


def _fall(checker: Checker, motion: Motion) -> float | None:
    """Simulate a motion; return when the robot falls, in [s]."""
    return checker.check(motion, ["fall"]).figures.get("fall_time")


class _State(NamedTuple):
    """A motion on the way."""

    motion: Motion
    verdict: Verdict
    left: Sequence[Span]
    """Times that are not corrected."""


class _Mending:
    """Looks for changes that are worth it, one after the other."""

    def __init__(
        self,
        checker: Checker,
        given: Motion,
        parts: Collection[str],
        options: MendOptions,
    ) -> None:
        self._checker, self._parts, self._options = checker, parts, options
        self._given = given
        self.now = _State(given, checker.check(given), ())
        self._first = self.now.verdict

    def next(self) -> _State | None:
        """Return a better motion; None if there is none.

        Samples are tried first; then all of the body, then each of its parts; at last
        samples together with what they uncover.
        """
        start = None
        for name in self._due(self.now):
            if name in SAMPLES:
                found = self._filtered(start or self.now, name)
                if found and self._is_better(found, name):
                    return found
                start = found or start
        body = self._body(self.now)
        for some in dict.fromkeys((body, *((name,) for name in body))):
            found = self._corrected(self.now, some)
            if found and self._is_better(found):
                return self._near_path(found, some)
        if start:
            found = self._corrected(start, self._body(start))
            if found and self._is_better(found):
                return found
        return None

    def _due(self, state: _State) -> list[str]:
        """List the parts that remove something of what was found."""
        checks = {finding.check for finding in state.verdict.findings}
        return [name for name in self._parts if checks & {*FINDINGS[name]}]

    def _body(self, state: _State) -> tuple[str, ...]:
        """List the parts of them that move the body as a whole."""
        return tuple(name for name in self._due(state) if name not in SAMPLES)

    def _is_better(self, found: _State, part: str = "") -> bool:
        """Return whether a change is kept."""
        for before in (self._first, self.now.verdict):
            if any(row.is_worse for row in rows_of(before, found.verdict)):
                return False
        gain = _score(self.now.verdict) - _score(found.verdict)
        return gain > (0.0 if part == "noise" else LESS)

    def _filtered(self, state: _State, part: str) -> _State | None:
        """Change samples within the bounds; None: no change."""
        measured = state.verdict.measured
        assert measured is not None
        found = SAMPLES[part](measured)
        if found is state.motion:
            return None
        found = _bounded(self._given, state.motion, found, self._options)
        return _State(found, self._checker.check(found), state.left)

    def _corrected(
        self, state: _State, parts: tuple[str, ...], keeps_base: bool = False
    ) -> _State | None:
        """Correct the body within the bounds; None: that is not possible."""
        measured = state.verdict.measured
        if not parts or measured is None:
            return None
        correction = Correction(measured, parts, self._options.keep_hands, keeps_base)
        for _ in range(TRIES):
            found = correction.find()
            wrong = _too_far(self._given, found, self._options)
            if not wrong.any():
                judged = self._checker.check(found)
                wrong = _worse(self.now.motion, self.now.verdict, judged)
                if not wrong.any():
                    break
            correction.left_alone |= wrong
        else:
            return None
        times, alone = found.times, runs(correction.left_alone)
        return _State(
            found, judged, [(float(times[a]), float(times[b])) for a, b in alone]
        )

    def _near_path(self, found: _State, parts: tuple[str, ...]) -> _State:
        """Keep the base near its path, if the joints hardly change more for that."""
        joints, base = _sizes(self.now.motion, found.motion)
        if base < AWAY:
            return found
        near = self._corrected(self.now, parts, keeps_base=True)
        if near is None or _score(near.verdict) > _score(found.verdict) + NEARLY:
            return found
        is_near = _sizes(self.now.motion, near.motion)[0] < MORE * joints + SMALL
        return near if is_near and self._is_better(near) else found


def _sizes(before: Motion, after: Motion) -> tuple[float, float]:
    """Measure changes, rms: of the joints in [rad], of the base's place in [m]."""
    joints = np.sqrt(((after.positions - before.positions) ** 2).mean())
    if before.base_poses is None or after.base_poses is None:
        return float(joints), 0.0
    away = (after.base_poses - before.base_poses)[:, :3]
    return float(joints), float(np.sqrt((away**2).sum(axis=1).mean()))


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


def _near(times: np.ndarray, spans: Sequence[Span]) -> np.ndarray:
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
    if left:
        spans = listed([f"{begin:.2f} to {end:.2f} s" for begin, end in left])
        yield f"{spans}: not corrected further, {alone}"
