"""Limits of joints, and jumps of joints and base."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from g1_description.core.robot.description import Joint

from .states import States, rotation_vectors
from .thresholds import Thresholds
from .verdict import Fault

QUIET_SAMPLES = 3
"""How many samples before and after a jump say nothing of speeds: differences of
third order reach so far."""


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
    for joint, bound, column in zip(joints, bounds, rates.T):
        values = np.abs(column)
        with np.errstate(divide="ignore", invalid="ignore"):
            sizes = np.where(values == 0.0, 0.0, values / bound)
            is_large = bool((sizes > least).any())
        if not is_large:
            continue
        length, effort = units(joint)
        unit = effort if suffix is None else length + suffix
        yield Fault(
            check,
            (joint.name,),
            sizes,
            "of the limit",
            f"{joint.name} has {np.nanmax(values):.4g} {unit} at {{time:.3f}} s, where "
            f"{bound:.4g} {unit} is its limit",
        )


def derivatives(
    times: np.ndarray, positions: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Compute accelerations and jerks by differences of neighbouring samples.

    Args:
        times: Of the samples in [s], shape (n,).
        positions: In [rad] or [m], shape (n, n_joints).

    Returns:
        Of second and third order, shape (n, n_joints) each; NaN at the ends, where
        neighbours are missing.
    """
    acceleration, jerk = np.full((2, *positions.shape), np.nan)
    if len(times) > 2:
        steps = np.diff(times)
        speed = np.diff(positions, axis=0) / steps[:, np.newaxis]
        middle = (times[2:] - times[:-2]) / 2.0
        acceleration[1:-1] = np.diff(speed, axis=0) / middle[:, np.newaxis]
        jerk[1:-2] = np.diff(acceleration[1:-1], axis=0) / steps[1:-1, np.newaxis]
    return acceleration, jerk


def jumps(steps: np.ndarray) -> np.ndarray:
    """Find how far steps are from both of their neighbours.

    A fast motion has fast steps before or after, and one that speeds up or slows down
    has a faster step on one side; what jumps differs from both in the same direction.

    Args:
        steps: From each sample to the next, shape (n - 1, k).

    Returns:
        Sizes at the samples that a jump leads to, shape (n, k).
    """
    still = np.zeros((1, steps.shape[1]))
    from_last = np.diff(np.concatenate([still, steps]), axis=0)
    from_next = -np.diff(np.concatenate([steps, still]), axis=0)
    sizes = np.minimum(np.abs(from_last), np.abs(from_next))
    sizes = np.minimum(sizes, np.abs(steps))
    return np.concatenate([still, np.where(from_last * from_next > 0.0, sizes, 0.0)])


def jump_faults(
    states: States,
    joints: Sequence[Joint],
    positions: np.ndarray,
    thresholds: Thresholds,
) -> list[Fault]:
    """Find jumps of joints and base.

    Args:
        states: The motion.
        joints: Its joints.
        positions: Theirs, shape (n, k).
        thresholds: Smaller jumps are none.
    """
    if len(states.times) == 1:
        return []
    faults = []
    for joint, places in zip(joints, positions.T):
        sizes = jumps(np.diff(places)[:, np.newaxis])[:, 0]
        if (sizes > thresholds.jump.least).any():
            unit = units(joint)[0]
            text = f"{joint.name} jumps by {{worst:.4g}} {unit} at {{time:.3f}} s"
            faults.append(Fault("jump", (joint.name,), sizes, unit, text))
    if not states.has_base:
        return faults
    poses = states.base_poses()
    moved = jumps(np.diff(poses[:, :3], axis=0))
    turned = jumps(rotation_vectors(poses[:-1, 3:], poses[1:, 3:]))
    for part, unit, verb in ((moved, "m", "jumps"), (turned, "rad", "turns at once")):
        text = f"the base {verb} by {{worst:.4g}} {unit} at {{time:.3f}} s"
        size = np.linalg.norm(part, axis=1)
        faults.append(Fault("base_jump", ("base",), size, unit, text))
    return faults


def near_jumps(
    faults: Sequence[Fault], times: np.ndarray, thresholds: Thresholds
) -> tuple[np.ndarray, np.ndarray]:
    """Mark what is near jumps, and says nothing of speeds and accelerations there.

    Args:
        faults: What ``jump_faults`` returned.
        times: Of the samples in [s], shape (n_samples,).
        thresholds: The thresholds.

    Returns:
        The samples whose neighbours are beyond a jump, and those with a jump in the
        window of their accelerations, shapes (n_samples,).
    """
    near, around = np.zeros((2, len(times)), dtype=bool)
    for fault in faults:
        level = thresholds.jump if fault.check == "jump" else thresholds.base_jump
        for at in np.flatnonzero(fault.sizes > level.least):
            near[max(0, at - QUIET_SAMPLES) : at + QUIET_SAMPLES] = True
            begin = times[max(0, at - 1)] - thresholds.window
            around |= (times >= begin) & (times <= times[at] + thresholds.window)
    return near, around
