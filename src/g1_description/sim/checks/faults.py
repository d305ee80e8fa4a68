"""All that may be wrong with a motion, from what was measured of it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from g1_description.core.checks import limits
from g1_description.core.checks.balance import balance_faults
from g1_description.core.checks.ground import (
    float_heights,
    ground_faults,
    sliding_speeds,
)
from g1_description.core.checks.states import States
from g1_description.core.checks.verdict import Fault

from .collision_faults import collision_faults
from .frames import Frames, Parts
from .timeline import Timeline


def all_faults(
    parts: Parts, states: States, frames: Frames, timeline: Timeline
) -> Iterator[Fault]:
    """Find everything that may be wrong; thresholds decide what is.

    One after the other: all faults of a long motion need more memory than it does.

    Args:
        parts: The robot.
        states: The motion.
        frames: What was measured.
        timeline: The same, for people.
    """
    joints = states.joints_of(parts.joints)
    jumps = limits.jump_faults(states, joints, timeline.positions, parts.thresholds)
    near, around = limits.near_jumps(jumps, states.times, parts.thresholds)
    yield from jumps
    yield from _joint_faults(parts, states, timeline, near)
    yield from _effort_faults(parts, frames.efforts)
    yield from _collision_faults(parts, frames, len(states.times))
    yield from _ground_faults(parts, states, frames, near)
    yield from _balance_faults(parts, states, frames, around)


def _joint_faults(
    parts: Parts, states: States, timeline: Timeline, near_jump: np.ndarray
) -> Iterator[Fault]:
    """Find what is wrong with single joints, besides jumps."""
    joints, thresholds = states.joints_of(parts.joints), parts.thresholds
    least = thresholds.position.least
    yield from limits.position_faults(joints, timeline.positions, least)
    names = timeline.joint_names
    bounds = {
        "velocity": np.array([joint.velocity for joint in joints]),
        "acceleration": thresholds.acceleration_bounds.of(names),
        "jerk": thresholds.jerk_bounds.of(names),
    }
    for check, bound in bounds.items():
        if np.isfinite(bound).any():
            known = _rates(check, timeline)
            known[near_jump] = np.nan
            least = getattr(thresholds, check).least
            yield from limits.rate_faults(check, joints, known, bound, least)


def _rates(check: str, timeline: Timeline) -> np.ndarray:
    """Return what a check compares with bounds, shape (n, n_joints)."""
    if check == "velocity":
        return timeline.velocities.copy()
    acceleration, jerk = limits.derivatives(timeline.times, timeline.positions)
    return acceleration if check == "acceleration" else jerk


def _effort_faults(parts: Parts, efforts: np.ndarray | None) -> Iterable[Fault]:
    """Find efforts beyond their limits."""
    if efforts is None:
        return ()
    most = np.array([joint.effort for joint in parts.joints])
    least = parts.thresholds.effort.least
    return limits.rate_faults("effort", parts.joints, efforts, most, least)


def _collision_faults(
    parts: Parts, frames: Frames, n_samples: int
) -> Iterable[Fault]:
    """Find links that touch each other."""
    if frames.contacts is None:
        return ()
    return collision_faults(frames.contacts, parts.collisions.pairs, n_samples)


def _ground_faults(
    parts: Parts, states: States, frames: Frames, near_jump: np.ndarray
) -> list[Fault]:
    """Find what is wrong with the robot on its floor."""
    ground, times, thresholds = frames.ground, states.times, parts.thresholds
    if ground is None:
        return []
    if frames.balance is None:
        center = states.base_poses()[:, :3]
    else:
        center = frames.balance.center
    heights = ground.heights.min(axis=1)
    floats = float_heights(heights, center[:, 2], times, thresholds.bearing_height)
    bears = parts.ground.bearing(ground, times)
    touches = ground.heights <= thresholds.contact_height
    touches &= bears & ~near_jump[:, np.newaxis]
    slides = sliding_speeds(ground.slide, touches, times)
    return ground_faults(parts.ground_links, ground, bears, slides, floats)


def _balance_faults(
    parts: Parts, states: States, frames: Frames, around_jump: np.ndarray
) -> list[Fault]:
    """Find where the robot would tip over."""
    if frames.balance is None:
        return []
    window, times = parts.thresholds.window, states.times
    at_end = (times < times[0] + window) | (times > times[-1] - window)
    is_known = ~around_jump & ~(at_end & (len(times) > 1))
    return balance_faults(frames.balance, is_known, parts.thresholds.floor_height)
