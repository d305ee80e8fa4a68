"""Jumps of joints and base from one sample to the next."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from g1_description.checks.intervals import around
from g1_description.checks.measured import Measured, rotation_vectors
from g1_description.checks.rule import Rule, units
from g1_description.checks.thresholds import Level
from g1_description.checks.verdict import BY_TIME, Finding

QUIET_SAMPLES = 3
"""Samples before and after a jump without usable speeds: third-order differences span
this many."""

LONGEST_STEP = 0.0501
"""Samples farther apart than this, in [s], are waypoints, which are never jumps:
recorded motions have at least 20 Hz."""


def _jumps(times: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Compute the part of each step that its neighbours do not explain.

    In a fast or accelerating motion a neighbouring step is about as fast. A jump is
    faster, or slower, than both neighbours. Steps between waypoints are not jumps.

    Args:
        times: Times of the samples in [s], rising, shape (n,).
        steps: From each sample to the next, shape (n - 1, k).

    Returns:
        Sizes of the jumps, at the sample after each, shape (n, k).
    """
    still = np.zeros((1, steps.shape[1]))
    if len(times) < 3:
        return np.zeros((len(times), steps.shape[1]))
    gaps = np.diff(times)[:, np.newaxis]
    speeds = steps / gaps
    from_last = np.diff(np.concatenate([still, speeds]), axis=0)
    from_next = -np.diff(np.concatenate([speeds, still]), axis=0)
    sizes = np.minimum(np.abs(from_last), np.abs(from_next))
    sizes = gaps * np.minimum(sizes, np.abs(speeds))
    is_jump = (from_last * from_next > 0.0) & (gaps < LONGEST_STEP)
    return np.concatenate([still, np.where(is_jump, sizes, 0.0)])


def _joint_jumps(measured: Measured) -> np.ndarray:
    """Compute jumps of joints, in [rad] or [m], shape (n, n_joints)."""
    motion = measured.motion
    return measured.spread(_jumps(motion.times, np.diff(motion.positions, axis=0)), 0.0)


def _base_jumps(measured: Measured) -> np.ndarray:
    """Compute jumps of the base, in [m] and in [rad], shape (n, 2)."""
    motion = measured.motion
    if motion.base_poses is None:
        return np.zeros((len(measured.times), 2))
    places, turns = motion.base_poses[:, :3], motion.base_poses[:, 3:]
    steps = np.diff(places, axis=0), rotation_vectors(turns[:-1], turns[1:])
    sizes = [np.linalg.norm(_jumps(motion.times, step), axis=1) for step in steps]
    return measured.spread(np.stack(sizes, axis=1), 0.0)


@dataclass(frozen=True, eq=False)
class NearJumps:
    """Samples whose rates are not usable because of a jump nearby."""

    joints: np.ndarray
    """Where the rates of a joint are not usable, shape (n, n_joints)."""

    body: np.ndarray
    """Where the velocities of links are not usable, shape (n,)."""

    is_known: np.ndarray
    """Where the window of accelerations contains no jump and lies inside the motion,
    shape (n,)."""


def near_jumps(measured: Measured) -> NearJumps:
    """Mark the samples near jumps that are failures."""
    times, thresholds = measured.times, measured.robot.thresholds
    jumps = [
        measured.once(find) > _failure(rule.level_in(thresholds))
        for rule, find in ((JUMP, _joint_jumps), (BASE_JUMP, _base_jumps))
    ]
    joints = np.zeros(jumps[0].shape, dtype=bool)
    for column in np.flatnonzero(jumps[0].any(axis=0)):
        joints[:, column] = _quiet(np.flatnonzero(jumps[0][:, column]), len(times))
    at = np.flatnonzero(np.concatenate(jumps, axis=1).any(axis=1))
    begin = times[np.maximum(at - 1, 0)] - thresholds.window
    end = np.searchsorted(times, times[at] + thresholds.window, side="right")
    is_near = around(len(times), np.searchsorted(times, begin), end)
    is_early = times < times[0] + thresholds.window
    is_late = times > times[-1] - thresholds.window
    is_at_end = (is_early | is_late) & (len(times) > 1)
    return NearJumps(joints, _quiet(at, len(times)), ~is_near & ~is_at_end)


def _quiet(at: np.ndarray, n_samples: int) -> np.ndarray:
    """Mark the samples near jumps at some samples, shape (n_samples,)."""
    return around(n_samples, at - QUIET_SAMPLES, at + QUIET_SAMPLES)


def _failure(level: Level) -> float:
    """Return the threshold of failures, or else of warnings; infinite without both."""
    bounds = (level.failure, level.warning, np.inf)
    return next(bound for bound in bounds if bound is not None)


def _find_joint_jumps(rule: Rule, measured: Measured) -> Iterator[Finding | None]:
    """Find joints that jump."""
    sizes = measured.once(_joint_jumps)
    for column in rule.columns(measured, sizes):
        joint = measured.joints[column]
        unit = units(joint)[0]
        text = f"{joint.name} jumps by {{worst:.4g}} {unit}{{when}}"
        yield rule.compared(measured, (joint.name,), sizes[:, column], text, unit)


def _find_base_jumps(rule: Rule, measured: Measured) -> Iterator[Finding | None]:
    """Find jumps and turns of the base."""
    sizes = measured.once(_base_jumps)
    for size, unit, verb in zip(sizes.T, ("m", "rad"), ("jumps", "turns abruptly")):
        text = f"the base {verb} by {{worst:.4g}} {unit}{{when}}"
        yield rule.compared(measured, ("base",), size, text, unit)


JUMP = Rule(
    name="jump",
    grouping=BY_TIME,
    about="a discontinuity of a joint between neighbouring samples",
    level=Level(0.1, 0.2),
    limit="rad or m, between two samples",
    find=_find_joint_jumps,
    needs=("neighbours",),
)
BASE_JUMP = Rule(
    name="base_jump",
    about="a discontinuity of the base between neighbouring samples",
    level=Level(0.03, 0.04),
    limit="m or rad, between two samples; 0.013 m and 0.030 rad in three clips",
    find=_find_base_jumps,
    needs=("base", "neighbours"),
    requires="base",
)
