"""Limits of joints, and jumps of joints and base."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from g1_description.checks.finding import Fault, around
from g1_description.checks.measured import Measured, rotation_vectors
from g1_description.checks.thresholds import BOUNDS, Thresholds
from g1_description.errors import ThresholdError
from g1_description.motion.trajectory import Trajectory
from g1_description.robot.description import Description, Joint
from g1_description.text import listed, similar_first

QUIET_SAMPLES = 3
"""How many samples before and after a jump say nothing of speeds: differences of
third order reach so far."""

LONGEST_STEP = 0.0501
"""Samples that are farther apart are way points, between which nothing jumps, in [s]:
20 Hz is the least rate of recorded motions."""


def units(joint: Joint) -> tuple[str, str]:
    """Return the units of a joint's position and effort."""
    return ("m", "N") if joint.kind == "prismatic" else ("rad", "N m")


def position_faults(
    joints: Sequence[Joint], positions: np.ndarray, least: float
) -> Iterator[Fault]:
    """Compare positions with their limits.

    Args:
        joints: Movable joints.
        positions: Theirs in [rad] or [m], shape (n_samples, n_joints).
        least: A smaller fault is none, in [rad] or [m].
    """
    above = positions - np.array([joint.upper for joint in joints])
    below = np.array([joint.lower for joint in joints]) - positions
    sizes = np.maximum(above, below)
    for column in np.flatnonzero((sizes > least).any(axis=0)):
        joint = joints[column]
        is_above = above[:, column].max() >= below[:, column].max()
        bound, word = (joint.upper, "upper") if is_above else (joint.lower, "lower")
        unit = units(joint)[0]
        yield Fault(
            "position",
            (joint.name,),
            sizes[:, column],
            unit,
            f"{joint.name} is {{worst:.4g}} {unit} beyond its {word} limit of "
            f"{bound:.4g} {unit} at {{time:.3f}} s",
        )


def rate_faults(
    check: str,
    joints: Sequence[Joint],
    rates: np.ndarray,
    bounds: np.ndarray,
    least: float,
) -> Iterator[Fault]:
    """Compare velocities, accelerations, jerks or efforts with their bounds.

    Args:
        check: Name of the check.
        joints: Movable joints.
        rates: Theirs, shape (n_samples, n_joints); NaN where they are not known.
        bounds: Their largest magnitudes, shape (n_joints,); infinite where there are
            none.
        least: A smaller fault is none, as a share of its bound.
    """
    suffix = {"velocity": "/s", "acceleration": "/s^2", "jerk": "/s^3"}.get(check)
    is_bounded = bounds > 0.0  # URDF exporters write 0 where they know none
    values = np.abs(rates)
    with np.errstate(invalid="ignore"):
        shares = values / np.where(is_bounded, bounds, np.inf)
        is_large = (shares > least).any(axis=0) & is_bounded
    for column in np.flatnonzero(is_large):
        joint, bound = joints[column], bounds[column]
        largest = np.nanmax(values[:, column])
        length, effort = units(joint)
        unit = effort if suffix is None else length + suffix
        yield Fault(
            check,
            (joint.name,),
            shares[:, column],
            "of the limit",
            f"{joint.name} has {largest:.4g} {unit} at {{time:.3f}} s, where "
            f"{bound:.4g} {unit} is its limit",
        )


def derivatives(trajectory: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Compute the accelerations and jerks of a motion's samples.

    Args:
        trajectory: The motion.

    Returns:
        In [rad/s^2] and [rad/s^3], or [m/s^2] and [m/s^3], shape (n, n_joints) each:
        of the cubic polynomials between samples where the motion has velocities, the
        larger acceleration of both sides; else differences of neighbouring samples. NaN
        at the ends, where neighbours are missing.
    """
    times, positions = trajectory.times, trajectory.positions
    acceleration, jerk = np.full((2, *positions.shape), np.nan)
    h, step = np.diff(times)[:, np.newaxis], np.diff(positions, axis=0)
    if len(times) > 2 and trajectory.velocities is None:
        middle = (times[2:] - times[:-2])[:, np.newaxis] / 2.0
        acceleration[1:-1] = np.diff(step / h, axis=0) / middle
        jerk[1:-2] = np.diff(acceleration[1:-1], axis=0) / h[1:-1]
    elif len(times) > 1 and trajectory.velocities is not None:
        v0, v1 = h * trajectory.velocities[:-1], h * trajectory.velocities[1:]
        begin = (6.0 * step - 4.0 * v0 - 2.0 * v1) / h**2
        end = (2.0 * v0 + 4.0 * v1 - 6.0 * step) / h**2
        acceleration[:-1] = begin
        is_larger = ~(np.abs(acceleration[1:]) > np.abs(end))
        acceleration[1:][is_larger] = end[is_larger]
        jerk[:-1] = (6.0 * (v0 + v1) - 12.0 * step) / h**3
    return acceleration, jerk


def jumps(times: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Find how far steps are from what the steps beside them explain.

    A fast motion is fast before or after, and one that speeds up or slows down is
    faster on one side; what jumps is faster, or slower, than both. Between way points
    that are far apart nothing jumps: the motion goes evenly.

    Args:
        times: Of the samples in [s], rising, shape (n,).
        steps: From each sample to the next, shape (n - 1, k).

    Returns:
        Sizes at the samples that a jump leads to, shape (n, k).
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


def jump_faults(
    measured: Measured, joints: Sequence[Joint], thresholds: Thresholds
) -> list[Fault]:
    """Find jumps of joints and base between the motion's own samples.

    Args:
        measured: The motion.
        joints: Its joints.
        thresholds: Smaller jumps are none.
    """
    motion, faults = measured.trajectory, []
    for joint, places in zip(joints, motion.positions.T):
        sizes = jumps(motion.times, np.diff(places)[:, np.newaxis])[:, 0]
        if (sizes > thresholds.jump.least).any():
            unit = units(joint)[0]
            text = f"{joint.name} jumps by {{worst:.4g}} {unit} at {{time:.3f}} s"
            sizes = measured.spread(sizes, 0.0)
            faults.append(Fault("jump", (joint.name,), sizes, unit, text))
    poses = motion.base_poses
    if poses is None:
        return faults
    moved = jumps(motion.times, np.diff(poses[:, :3], axis=0))
    turns = rotation_vectors(poses[:-1, 3:], poses[1:, 3:])
    turned = jumps(motion.times, turns)
    for part, unit, verb in ((moved, "m", "jumps"), (turned, "rad", "turns at once")):
        text = f"the base {verb} by {{worst:.4g}} {unit} at {{time:.3f}} s"
        size = measured.spread(np.linalg.norm(part, axis=1), 0.0)
        faults.append(Fault("base_jump", ("base",), size, unit, text))
    return faults


@dataclass(frozen=True, eq=False)
class NearJumps:
    """Samples whose rates say nothing, as a joint or the base jumps."""

    joints: dict[str, np.ndarray]
    """Of each joint that jumps: where its rates say nothing, shape (n,)."""

    body: np.ndarray
    """Where the velocities of links say nothing, shape (n,)."""

    window: np.ndarray
    """Where accelerations over the window of the thresholds say nothing, shape (n,)."""


def near_jumps(
    faults: Sequence[Fault], times: np.ndarray, thresholds: Thresholds
) -> NearJumps:
    """Mark what is near jumps.

    Args:
        faults: What ``jump_faults`` returned.
        times: Of the samples in [s], shape (n,).
        thresholds: Jumps that are only warned of hide nothing.
    """
    joints, rows = {}, [np.zeros(0, dtype=int)]
    for fault in faults:
        level = thresholds.jump if fault.check == "jump" else thresholds.base_jump
        bound = level.least if level.failure is None else level.failure
        at = np.flatnonzero(fault.sizes > bound)
        rows.append(at)
        if fault.check == "jump" and len(at):
            near = around(len(times), at - QUIET_SAMPLES, at + QUIET_SAMPLES)
            joints[fault.subject[0]] = near
    at = np.unique(np.concatenate(rows))
    begin = times[np.maximum(at - 1, 0)] - thresholds.window
    end = np.searchsorted(times, times[at] + thresholds.window, side="right")
    return NearJumps(
        joints,
        around(len(times), at - QUIET_SAMPLES, at + QUIET_SAMPLES),
        around(len(times), np.searchsorted(times, begin), end),
    )


def check_bounds(thresholds: Thresholds, description: Description) -> None:
    """Check that bounds are of joints that a robot has.

    Raises:
        ThresholdError: If it has no such joint.
    """
    own = [joint.name for joint in description.movable_joints]
    for name in BOUNDS:
        for joint in getattr(thresholds, name).joints:
            if joint not in own:
                raise ThresholdError(
                    f"{name} names {joint}; {description.name} has "
                    f"{listed(similar_first(joint, own))}."
                )


def zero_limits(description: Description) -> tuple[str, ...]:
    """Tell of limits of zero, which exporters write where they know none."""
    notes = []
    for what in ("velocity", "effort"):
        joints = description.movable_joints
        names = [joint.name for joint in joints if getattr(joint, what) == 0.0]
        if names:
            notes.append(
                f"{description.name} limits the {what} of {listed(names)} to 0: it is "
                "not judged."
            )
    return tuple(notes)
