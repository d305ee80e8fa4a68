"""Motions whose findings are removed by small changes, and what that changed."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Tuple

import numpy as np

from g1_description.checks.checker import Checker
from g1_description.checks.intervals import intervals, near
from g1_description.checks.measured import Measured
from g1_description.checks.verdict import FAILED, Finding, Verdict
from g1_description.mend.certificate import (
    LOW_IS_WORSE,
    Certificate,
    moved_parts,
    rows_of,
)
from g1_description.mend.correction import Correction
from g1_description.mend.options import FINDINGS, MendOptions
from g1_description.mend.samples import (
    knots,
    on_floor,
    spread,
    without_noise,
    without_outliers,
)
from g1_description.motion.motion import Motion
from g1_description.text import listed

SAMPLES = {"outliers": without_outliers, "noise": without_noise, "floor": on_floor}
"""Parts that change samples by themselves."""

LESS, LEAST = 0.05, 1e-6
"""A part is kept if it removes this much, and noise if it removes the second one: a
failure counts 1 and its fraction of time, a warning a fifth of that."""

LARGER = 1.1
"""A failure is larger from this multiple of its worst size on."""

NEEDED = ("skating", "center_of_mass")
"""Checks that measure what corrections need: the ground and balance."""

WIDTHS = (0.2, 0.4)
"""Nothing is corrected this near to where the first and the second of three tries
changed too much or made something worse, in [s]."""

AWAY = 0.01
"""The base keeps near its path if it would else be this far from it, rms in [m]."""

MORE, SMALL, NEARLY = 1.5, 2e-3, 0.5
"""Largest ratio and rms in [rad] of the joints' changes that this is worth, and what
may stay more, as for ``LESS``."""

EARLY = 0.1
"""A change is not kept if the simulated robot falls this much earlier, in [s]."""

SLOWER = "only slower or other movements need less"
STAYS = "no small change was found that removes this"
BEYOND = "no change within the bounds was found that removes this"
"""Why efforts stay, and other failures without bounds of changes and with them."""

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

    A motion above or below the floor is put there first. Parts are tried where checks
    found something, and kept if no check has a new failure or one that is larger by a
    tenth. This ends when none is kept.

    Args:
        checker: The checks.
        motion: Must fit the robot, as by ``fitted``.
        options: What is mended; None: everything.

    Raises:
        G1DescriptionError: If the motion cannot be checked.
    """
    found = deque(mending_steps(checker, motion, options), maxlen=1).pop()
    assert isinstance(found, Mended)
    return found


def mending_steps(
    checker: Checker, motion: Motion, options: MendOptions | None = None
) -> Iterator[Verdict | Mended]:
    """Yield the verdict on the motion and on each better one, and then the outcome.

    Args and errors are those of ``mended``.
    """
    options = options or MendOptions()
    parts = [name for name in FINDINGS if not options.only or name in options.only]
    mending = _Mending(checker.without_physics(), motion, parts, options)
    before = mending.before
    found: _State | None = mending.now
    while found is not None:
        mending.now = found
        yield found.verdict
        found = mending.next()
    after, verdict, left = mending.now
    is_free = options.max_change == options.max_base == np.inf
    why = STAYS if is_free else BEYOND
    reasons = [*_reasons(verdict, parts, why)]
    if reasons and mending.worse:
        reasons.append(f"changes that were tried made {listed(mending.worse)} worse")
    if left:
        spans = listed([f"{begin:.2f} to {end:.2f} s" for begin, end in left])
        far = "" if is_free else "are larger than allowed, or "
        reasons.append(
            f"{spans}: left alone, as changes there {far}make other findings worse"
        )
    falls = _falls(checker, motion, after)
    if falls and _or_never(falls[1]) < _or_never(falls[0]) - EARLY:
        reasons = [f"with changes the simulated robot falls at {falls[1]:.2f} s"]
        after, verdict, falls = motion, before, (falls[0], falls[0])
    is_changed = after is not motion
    moved = moved_parts(checker.checked_robot, motion, after) if is_changed else ()
    certificate = Certificate(rows_of(before, verdict), moved, tuple(reasons), falls)
    yield Mended(after, certificate, before, verdict)


def _falls(
    checker: Checker, before: Motion, after: Motion
) -> tuple[float | None, float | None] | None:
    """Simulate two motions; say when the robot falls, in [s]."""
    if checker.physics is None:
        return None
    found = []
    for motion in (before, after) if after is not before else (before,):
        verdict = checker.check(motion, ["fall"])
        if "fall" in verdict.skipped:
            return None
        found.append(verdict.figures.get("fall_time"))
    return found[0], found[-1]


def _or_never(time: float | None) -> float:
    return np.inf if time is None else time


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
        self.before = self.now.verdict
        self._lower()
        self._first = self.now.verdict
        """The verdict on the motion, or on that on the floor."""
        self.worse: dict[str, None] = {}
        """Checks that tries of the last ``next`` made worse."""

    def _lower(self) -> None:
        """Put the motion on the floor; what feet do there is only known then."""
        is_due = "floor" in self._due(self.now)
        found = self._filtered(self.now, "floor") if is_due else None
        rows = rows_of(self.now.verdict, found.verdict) if found else ()
        if found and sum(row.failures[1] - row.failures[0] for row in rows) < 0:
            self.now = found

    def next(self) -> _State | None:
        """Return a better motion; None if there is none.

        Samples are tried first, with what they uncover in the body; then all of the
        body, and each of its parts; then samples that are only better with the body.
        """
        self.worse.clear()
        filtered, better = self.now, None
        for name in self._due(self.now):
            if name in SAMPLES:
                found = self._filtered(filtered, name)
                if found and better is None and self._is_better(found, name):
                    better = found
                filtered = found or filtered
        if better:
            return self._moved(filtered, self._body(filtered)) or better
        body = self._body(self.now)
        for some in dict.fromkeys((body, *((name,) for name in body))):
            found = self._moved(self.now, some)
            if found:
                return found
        if filtered is self.now:
            return None
        return self._moved(filtered, self._body(filtered))

    def _moved(self, state: _State, parts: tuple[str, ...]) -> _State | None:
        """Correct the body, near its path if that is worth it; None: not better."""
        found = self._corrected(state, parts)
        if not found or not self._is_better(found):
            return None
        joints, base = _sizes(state.motion, found.motion)
        if base < AWAY:
            return found
        kept = self._corrected(state, parts, keeps_base=True)
        if kept is None or _score(kept.verdict) > _score(found.verdict) + NEARLY:
            return found
        is_near = _sizes(state.motion, kept.motion)[0] < MORE * joints + SMALL
        return kept if is_near and self._is_better(kept) else found

    def _due(self, state: _State) -> list[str]:
        """List the parts that remove something of what was found."""
        checks = {finding.check for finding in state.verdict.findings}
        return [name for name in self._parts if checks & {*FINDINGS[name]}]

    def _body(self, state: _State) -> tuple[str, ...]:
        """List the parts of them that move the body as a whole."""
        return tuple(name for name in self._due(state) if name not in SAMPLES)

    def _is_better(self, found: _State, part: str = "") -> bool:
        """Return whether a change is kept."""
        if self._worse_at(found.verdict):
            return False
        for before in (self._first, self.now.verdict):
            rows = rows_of(before, found.verdict)
            if any(row.failures[1] > row.failures[0] for row in rows):
                return False
        gain = _score(self.now.verdict) - _score(found.verdict)
        return gain > (LEAST if part == "noise" else LESS)

    def _worse_at(self, verdict: Verdict) -> list[Span]:
        """List the intervals of failures that were not there, or were smaller."""
        found = [*_worse(self._first, verdict), *_worse(self.now.verdict, verdict)]
        self.worse.update(dict.fromkeys(finding.check for finding in found))
        return [span for finding in found for span in finding.intervals]

    def _filtered(self, state: _State, part: str) -> _State | None:
        """Change samples within the bounds; None: no change."""
        measured = state.verdict.measured
        assert measured is not None
        found = SAMPLES[part](measured)
        if found is state.motion:
            return None
        found = _bounded(self._given, state.motion, found, self._options)
        found = _with_velocities(state.motion, found)
        return _State(found, self._checker.check(found), state.left)

    def _corrected(
        self, state: _State, parts: tuple[str, ...], keeps_base: bool = False
    ) -> _State | None:
        """Correct the body within the bounds; None: that is not possible."""
        if not parts:
            return None
        motion, rows = state.motion, knots(state.motion.times)
        if parts == ("speed",):  # what is fast for less than the distance of knots
            rows = np.arange(len(motion.times))
        measured = self._at(state, rows)
        correction = Correction(measured, parts, self._options.keep_hands, keeps_base)
        for width in (*WIDTHS, 0.0):
            found = spread(motion, rows, correction.find(), measured.joints)
            found = _with_velocities(motion, found)
            far = _far(self._given, found, self._options)
            wrong = [*intervals(found.times, far)]
            if not wrong:
                judged = self._checker.check(found)
                wrong = self._worse_at(judged)
                if not wrong:
                    break
            correction.excluded |= near(found.times, wrong, width)[rows]
        else:
            return None
        left = intervals(found.times[rows], correction.excluded)
        return _State(found, judged, left)

    def _at(self, state: _State, rows: np.ndarray) -> Measured:
        """Measure some samples of a motion."""
        verdict, motion = state.verdict, state.motion
        if len(rows) < len(motion.times):
            some = replace(motion, velocities=None).sampled(motion.times[rows])
            verdict = self._checker.check(some, NEEDED)
        assert verdict.measured is not None
        return verdict.measured


def _with_velocities(before: Motion, after: Motion) -> Motion:
    """Change known velocities as positions change, or not if that fits these better."""
    rates, times = before.velocities, before.times
    if rates is not None and len(times) > 1:
        old, new = (
            np.gradient(motion.positions, times, axis=0) for motion in (before, after)
        )
        fits_old, fits_new = (((rates - v) ** 2).sum(axis=0) for v in (old, new))
        rates = np.where(fits_old < fits_new, rates + new - old, rates)
    return replace(after, velocities=rates)


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


def _far(motion: Motion, found: Motion, options: MendOptions) -> np.ndarray:
    """Mark the samples that change more than allowed, shape (n,)."""
    away = np.abs(found.positions - motion.positions).max(axis=1, initial=0.0)
    far = away > options.max_change
    if motion.base_poses is not None and found.base_poses is not None:
        away = np.linalg.norm((found.base_poses - motion.base_poses)[:, :3], axis=1)
        far |= away > options.max_base
    return np.asarray(far)


def _worse(before: Verdict, after: Verdict) -> list[Finding]:
    """List the failures that are new or larger."""
    worst: dict[tuple[str, tuple[str, ...]], float] = {}
    for finding in before.findings:
        if finding.severity == FAILED:
            key = finding.check, finding.subject
            worst[key] = max(_size(finding), worst.get(key, 0.0))
    return [
        finding
        for finding in after.findings
        if finding.severity == FAILED
        and _size(finding) > LARGER * worst.get((finding.check, finding.subject), 0.0)
    ]


def _size(finding: Finding) -> float:
    """Return a number that is the larger, the worse a finding is."""
    if finding.check in LOW_IS_WORSE:
        return 1.0 / max(finding.worst, 1e-9)
    return finding.worst


def _score(verdict: Verdict) -> float:
    """Add up failures, with their fractions of time, and a fifth of warnings."""
    weights = [1.0 if f.severity == FAILED else 0.2 for f in verdict.findings]
    sizes = [1.0 + finding.share for finding in verdict.findings]
    return float(np.dot(weights, sizes))


def _reasons(verdict: Verdict, parts: Collection[str], why: str) -> Iterator[str]:
    """Say why failures stay that could have been mended."""
    known = {check for name in parts for check in FINDINGS[name]}
    for finding in verdict.findings:
        if finding.severity == FAILED and finding.check in known:
            yield f"{finding.text}: {SLOWER if finding.check == 'effort' else why}"
