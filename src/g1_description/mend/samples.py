"""Single wrong samples, noise, the height of a motion, and which samples are solved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Callable

import numpy as np
from scipy.fftpack import dct, idct
from scipy.interpolate import CubicSpline, interp1d
from scipy.ndimage import median_filter
from scipy.optimize import minimize_scalar

from g1_description.checks.intervals import runs
from g1_description.checks.measured import Measured
from g1_description.mend.body import changed
from g1_description.motion.edit import moved
from g1_description.motion.motion import Motion
from g1_description.robot.description import Joint, limits_of
from g1_description.robot.rotation import conjugate, multiply, to_rotation_vector
from g1_description.robot.transform import IDENTITY

AROUND, MOST = 7, 3
"""Samples whose median an outlier is far from, and the most in a row that are ones."""

OUTLIER, OUTLIER_PLACE = 0.1, 0.04
"""How far outliers are from that median at least, in [rad], and of the base's place in
[m]."""

NOISE, NOISE_PLACE = 1.5e-3, 1e-3
"""Least standard deviations of noise that is removed, in [rad] and [m]."""

UNEVEN = 0.1
"""Largest difference of distances of samples of which noise is removed, in means."""

WHITE = 1.6
"""Least ratio of fourth to third differences of noise: 1.87 if it is white; smooth
motions have less than 1."""

OFF = 0.01
"""A motion is lifted or lowered if its lowest points are this far from the floor in
half of its samples, in [m]."""

KNOT = 1.0 / 60.0
"""Distance of samples at which the body is corrected, in [s]: the change of those
between them is a spline."""


def knots(times: np.ndarray) -> np.ndarray:
    """Choose samples, at most a sixtieth of a second apart where times are nearer."""
    rows, last = [0], len(times) - 1
    for row in range(1, len(times)):
        if row == last or times[row + 1] - times[rows[-1]] > KNOT + 1e-9:
            rows.append(row)
    return np.array(rows)


def spread(
    motion: Motion, rows: np.ndarray, found: Motion, joints: Sequence[Joint]
) -> Motion:
    """Apply the change of some samples to all of them.

    Args:
        motion: The motion before.
        rows: Samples of it, with the first and the last one.
        found: These samples, changed.
        joints: Those of the motion, which stay within limits where ``found`` does.
    """
    if len(rows) == len(motion.times):
        return found
    was, bases, new = motion.positions[rows], motion.base_poses, found.base_poses
    places, turns = np.zeros((2, len(rows), 3))
    if bases is None or new is None:
        bases = np.tile(IDENTITY, (len(motion.times), 1))
    else:
        places = new[:, :3] - bases[rows, :3]
        turned = multiply(new[:, 3:], conjugate(bases[rows, 3:]))
        turns = to_rotation_vector(turned)
    change = np.concatenate([places, turns, found.positions - was], axis=1)
    spline = CubicSpline(found.times, change)(motion.times)
    bases, positions = changed(bases, motion.positions, spline)
    lower, upper = limits_of(joints)
    beyond = found.positions != found.positions.clip(lower, upper)
    stays = interp1d(found.times, beyond.astype(float), axis=0)(motion.times) > 0.0
    positions = np.where(stays, positions, positions.clip(lower, upper))
    return replace(
        motion,
        positions=positions,
        velocities=None,
        base_poses=None if new is None else bases,
    )


def on_floor(measured: Measured) -> Motion:
    """Lift or lower a motion that is above or below the floor as a whole."""
    motion, ground = measured.motion, measured.ground
    if motion.base_poses is None or ground is None or not ground.heights.size:
        return motion
    height = float(np.median(ground.heights.min(axis=1)))
    if abs(height) < OFF:
        return motion
    return moved(motion, np.append([0.0, 0.0, -height], IDENTITY[3:]))


def without_outliers(measured: Measured) -> Motion:
    """Replace single wrong samples by the straight line between their neighbours."""
    return _each(measured, _without_outliers, (OUTLIER, OUTLIER_PLACE, OUTLIER))


def without_noise(measured: Measured) -> Motion:
    """Remove white noise by splines of the smoothness that fits it best.

    Smoothing by cosines with generalized cross-validation, which has no lag. Source:
    Garcia, Computational Statistics & Data Analysis 54, 2010.
    """
    return _each(measured, _without_noise, (NOISE, NOISE_PLACE, NOISE))


Filter = Callable[[np.ndarray, np.ndarray, float], np.ndarray]
"""Filters columns, given also their times and a bound."""


def _each(
    measured: Measured, filtered: Filter, least: tuple[float, float, float]
) -> Motion:
    """Filter joints, and place and rotation of the base, each by itself."""
    motion, times = measured.motion, measured.motion.times
    if len(times) < AROUND + 2:
        return motion
    before, (lower, upper) = motion.positions, limits_of(measured.joints)
    positions = filtered(before, times, least[0])
    positions = positions.clip(np.minimum(lower, before), np.maximum(upper, before))
    bases = motion.base_poses
    if bases is not None:
        places = filtered(bases[:, :3], times, least[1])
        signs = np.sign((bases[1:, 3:] * bases[:-1, 3:]).sum(axis=1))
        signs = np.cumprod(np.append(1.0, np.where(signs == 0.0, 1.0, signs)))
        even = bases[:, 3:] * signs[:, np.newaxis]
        # A small turn changes the numbers by half of its angle.
        turns = filtered(even, times, least[2] / 2.0)
        turns = turns / np.linalg.norm(turns, axis=1, keepdims=True)
        bases = np.concatenate([places, turns], axis=1)
    if np.array_equal(positions, before) and (
        bases is None or np.abs(bases - motion.base_poses).max() < 1e-12
    ):
        return motion
    return replace(motion, positions=positions, velocities=None, base_poses=bases)


def _without_outliers(
    values: np.ndarray, times: np.ndarray, least: float
) -> np.ndarray:
    """Replace outliers of columns, shape (n, k)."""
    found = values.copy()
    away = np.abs(values - median_filter(values, (AROUND, 1), mode="nearest"))
    for column in np.flatnonzero((away > least).any(axis=0)):
        for first, last in runs(away[:, column] > least):
            if last - first < MOST and first > 0 and last < len(values) - 1:
                ends, rows = [first - 1, last + 1], slice(first, last + 1)
                found[rows, column] = np.interp(
                    times[rows], times[ends], values[ends, column]
                )
    return found


def _without_noise(values: np.ndarray, times: np.ndarray, least: float) -> np.ndarray:
    """Remove noise of columns that are sampled evenly, shape (n, k)."""
    found, gaps = values.copy(), np.diff(times)
    if np.ptp(gaps) > UNEVEN * gaps.mean():
        return found
    third, fourth = (np.diff(values, order, axis=0).std(axis=0) for order in (3, 4))
    is_noisy = third / np.sqrt(20.0) > least
    is_noisy &= fourth > WHITE * third
    for column in np.flatnonzero(is_noisy):
        found[:, column] = _smoothed(values[:, column])
    return found


def _smoothed(values: np.ndarray) -> np.ndarray:
    """Smooth values, shape (n,)."""
    # About the straight line between the ends, which cosines do not have.
    line = np.linspace(values[0], values[-1], len(values))
    waves = dct(values - line, norm="ortho")
    squares = (2.0 - 2.0 * np.cos(np.pi * np.arange(len(values)) / len(values))) ** 2

    def kept(exponent: float) -> np.ndarray:
        return 1.0 / (1.0 + 10.0**exponent * squares)

    def error(exponent: float) -> float:
        share = kept(exponent)
        lost = ((1.0 - share) * waves) ** 2
        return float(lost.sum() / (1.0 - share.mean()) ** 2)

    best = minimize_scalar(error, bounds=(-4.0, 8.0), method="bounded").x
    return np.asarray(line + idct(kept(best) * waves, norm="ortho"))
