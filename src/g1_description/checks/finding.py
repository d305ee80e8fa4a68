"""What a check finds, and stretches of time in which something holds."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from g1_description.checks.thresholds import Level

FAILED, WARNING, PASSED = "failed", "warning", "passed"


AT_TIME = " at {time:.3f} s"
"""When it was; left out for a single configuration."""


@dataclass(frozen=True)
class Finding:
    """One fault of one joint, link or pair of links, over the whole motion."""

    check: str
    """Which check found it: position, velocity, self_collision ..."""

    severity: str
    """``failed`` or ``warning``."""

    subject: tuple[str, ...]
    """Names of the joint, of the link or of both links; empty for the whole robot."""

    worst: float
    """Size of the fault where it is largest, in ``unit``."""

    bound: float
    """What the size may be at most; the threshold that ``severity`` stands for."""

    unit: str
    first_time: float
    """When the fault first exceeds ``bound``, in [s]."""

    worst_time: float
    """When it is largest, in [s]."""

    share: float
    """Share of the motion's time in which it exceeds ``bound``, from 0 to 1."""

    intervals: tuple[tuple[float, float], ...]
    """First and last times of each stretch in which it exceeds ``bound``, in [s]."""

    text: str
    """A sentence on the worst of it."""

    points: tuple[tuple[float, float, float], ...] = ()
    """Where it is at its worst, in the map, in [m]; empty where it is nowhere."""

    @property
    def name(self) -> str:
        """The subject in a word or two."""
        return " - ".join(self.subject)


@dataclass(frozen=True)
class Fault:
    """Something that may be wrong, at each sample of a motion."""

    check: str
    subject: tuple[str, ...]
    sizes: np.ndarray
    """How large it is at each sample, shape (n_samples,); NaN where it is not known."""

    unit: str
    text: str
    """A sentence on the worst of it, with ``{worst}``, and ``AT_TIME`` in it."""

    points: np.ndarray | None = None
    """Where it is, in the map, in [m], shape (n_samples, 3) or (n_samples, k, 3)."""


def compared(fault: Fault, level: Level, times: np.ndarray) -> Finding | None:
    """Compare a fault with its thresholds.

    Args:
        fault: The fault.
        level: The thresholds.
        times: Of the samples in [s], rising, shape (n_samples,).

    Returns:
        What is found; None if it stays below both thresholds.
    """
    sizes = np.where(np.isnan(fault.sizes), -np.inf, fault.sizes)
    at = int(np.argmax(sizes))
    worst = float(sizes[at])
    severity, bound = level.severity(worst)
    if bound is None:
        return None
    is_beyond = sizes > bound
    points = () if fault.points is None else np.reshape(fault.points[at], (-1, 3))
    text = fault.text if len(times) > 1 else fault.text.replace(AT_TIME, "")
    return Finding(
        fault.check,
        severity,
        fault.subject,
        worst,
        bound,
        fault.unit,
        float(times[np.argmax(is_beyond)]),
        float(times[at]),
        time_share(times, is_beyond),
        intervals(times, is_beyond),
        text.format(worst=worst, time=float(times[at])),
        tuple((float(x), float(y), float(z)) for x, y, z in points),
    )


def sorted_findings(findings: Iterable[Finding | None]) -> tuple[Finding, ...]:
    """Sort findings: the failed ones first, then by time; leave out None."""
    return tuple(
        sorted(
            (finding for finding in findings if finding is not None),
            key=lambda f: (f.severity != FAILED, f.first_time, f.check, f.subject),
        )
    )


def runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """List the stretches of samples in which something holds.

    Args:
        mask: Where it holds, shape (n_samples,).

    Returns:
        First and last sample of each.
    """
    edges = np.diff(np.concatenate([[0], mask.astype(int), [0]]))
    firsts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return [*zip(firsts.tolist(), ends.tolist())]


def intervals(times: np.ndarray, mask: np.ndarray) -> tuple[tuple[float, float], ...]:
    """List the stretches of time in which something holds.

    Args:
        times: Of the samples in [s], rising, shape (n_samples,).
        mask: Where it holds, shape (n_samples,).

    Returns:
        First and last times of each, in [s].
    """
    return tuple((float(times[a]), float(times[b])) for a, b in runs(mask))


def without_short(times: np.ndarray, mask: np.ndarray, shortest: float) -> np.ndarray:
    """Leave out the stretches that are shorter than a time.

    Args:
        times: Of the samples in [s], rising, shape (n_samples,).
        mask: Where something holds, shape (n_samples,).
        shortest: In [s].
    """
    kept = mask.copy()
    for first, last in runs(mask):
        if times[last] - times[first] < shortest:
            kept[first : last + 1] = False
    return kept


def around(n_samples: int, begins: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Mark the samples of many stretches, which may overlap.

    Args:
        n_samples: How many there are.
        begins: First samples, shape (k,).
        ends: The samples behind the last ones, shape (k,).

    Returns:
        Shape (n_samples,).
    """
    edges = np.zeros(n_samples + 1, dtype=int)
    np.add.at(edges, np.clip(begins, 0, n_samples), 1)
    np.add.at(edges, np.clip(ends, 0, n_samples), -1)
    return np.cumsum(edges)[:-1] > 0


def time_share(times: np.ndarray, mask: np.ndarray) -> float:
    """Compute in how much of the time something holds.

    Each sample stands for the time that is nearer to it than to others.

    Args:
        times: Of the samples in [s], rising, shape (n_samples,).
        mask: Where it holds, shape (n_samples,).

    Returns:
        From 0 to 1.
    """
    if len(times) == 1:
        return float(mask[0])
    between = np.concatenate([times[:1], (times[1:] + times[:-1]) / 2.0, times[-1:]])
    return float(np.diff(between)[mask].sum() / (times[-1] - times[0]))
